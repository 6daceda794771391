"""The tendons of a rig: lengths as functions of the joints' angles and the drives' positions, the
internal state along each (backlash, points of friction in a sheath, creep), tensions and forces,
with springs that stiffen.

The far side of a backlash and the points of a cable in its sheath (`Sheath`) are seen by no
sensor. Each of them is massless and held by friction, so that its forces are in balance at every
time. It moves by p⁺ = clip(p, a, b) with bounds a and b that the rest of the rig moves (the play
operator; Visintin, Differential Models of Hysteresis, 1994).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import exp
from typing import TypeAlias

import casadi as ca

from distal.expressions import Matrix, Scalar, Vector
from distal.model.parameters import NOTHING_DERIVED, Derived, Parameters
from distal.rig import Meeting, Polynomial, Rig, Size

STEEPEST = 2.0
"""Largest a δ [1] up to which `stretched` is exponential. Beyond it the curve goes on as a straight
line, whose slope is e² = 7.4 times the first one. Source: judgement.
"""


def stretched(elongation: Scalar, stiffening: Scalar) -> Scalar:
    """Return (e^{a δ} − 1)/a, the stretch of a linear tendon with the same tension: T = T_pre + k
    (e^{aδ} − 1)/a.

    Stiffness then grows in a straight line with tension, dT/dδ = k + a (T − T_pre): Fung's law of
    soft tissue (Am. J. Physiol. 213, 1967), which fibre ropes and wire ropes that bed in follow as
    well. For a → 0 it is Hooke's law. The `elongation` δ [m] is counted from the pre-tensioned
    length; the `stiffening` is a ≥ 0 [1/m].
    """
    x = stiffening * elongation
    small = ca.fabs(x) < 1e-5
    safe = ca.if_else(small, 1, stiffening)
    curve = ca.if_else(
        x < STEEPEST, ca.expm1(ca.fmin(x, STEEPEST)), exp(STEEPEST) * (x - STEEPEST + 1) - 1
    )
    return ca.if_else(small, elongation * (1 + x / 2), curve / safe)


NEWTON_STEPS = 3
"""Number of Newton steps to the position at which tendons balance. Few are enough: their pull is
made of straight lines, with a bend where one goes slack. Source: rounding (of 20,000 random pairs
of tendons with friction, none is further off than 1e-17 m).
"""

SOFTEST = 1e-9
"""Stiffness that is added to that of tendons, which may all be slack [N/m, N m/rad]. Source:
rounding (a division by zero).
"""

Pull: TypeAlias = Callable[[Scalar], tuple[Scalar, Scalar]]
"""Function of a position → (what the tendons pull back with there, its slope)."""


@dataclass(frozen=True)
class Bounds:
    """The positions between which a play operator rests: it is pushed up to `low` and down to
    `high`.
    """

    low: Scalar
    high: Scalar

    @property
    def middle(self) -> Scalar:
        """Return the position halfway between the bounds, which stands for one that is not
        remembered.
        """
        return (self.low + self.high) / 2

    def hold(self, position: Scalar) -> Scalar:
        """Return clip(p, a, b) of the `position` p before, with these bounds a and b."""
        return ca.fmin(ca.fmax(position, self.low), self.high)


def gap(position: Scalar, width: Scalar) -> Bounds:
    """Return the bounds of the far side of a backlash: half its `width` to both sides of the
    `position` of the near side [m, rad].
    """
    return Bounds(position - width / 2, position + width / 2)


def balanced(position: Scalar, bounds: Bounds, pull: Pull, friction: Scalar = 0) -> Scalar:
    """Return the position within `bounds` at which the far side of a backlash comes to rest,
    because its tendons pull no more than `friction` holds.

    Newton's steps p ← clip(p − soft(g(p), F)/g'(p)) start from its `position` before, for a `pull`
    g that grows with p, and friction F.
    """
    position = bounds.hold(position)
    for _ in range(NEWTON_STEPS):
        force, slope = pull(position)
        left = ca.fmax(force - friction, 0) + ca.fmin(force + friction, 0)
        position = bounds.hold(position - left / (slope + SOFTEST))
    return position


def plays_of(rig: Rig) -> tuple[str, ...]:
    """Return the names of a rig's play operators: the far sides of drives' backlashes, then the
    points in sheaths.
    """
    backlashes = [
        f"drives.{i}.backlash.place"
        for i, drive in enumerate(rig.drives)
        if drive.backlash is not None
    ]
    counts = [0 if tendon.path is None else tendon.path.nodes for tendon in rig.tendons]
    return (
        *backlashes,
        *(f"tendons.{i}.path.point.{k}" for i, count in enumerate(counts) for k in range(count)),
    )


STIFFENING_STEPS = 6
"""Number of Halley steps to the position at which two stretches of a cable that stiffens balance;
one Newton step follows. The worst of 4000 random cables is then 7 µm off, with 8 Newton steps alone
4 mm. Source: judgement.
"""


@dataclass(frozen=True)
class Sheath:
    """A cable in its sheath, as springs in series with points of friction between them.

    With N points each of the two stretches at the ends is 1/(2N) of the cable's length and each one
    between two points is 1/N, so that all together have the cable's stiffness. At each point the
    tensions on its two sides differ by a factor of at most e^{μβ/N} (the capstan equation).

    The points, (N,), and the ends, `drive` and `joint`, are given by their displacements [m].

    Args:
        stiffness: of the whole cable, k [N/m].
        drawn: e^{μβ/N} while the cable is drawn in.
        let_out: e^{μβ/N} while the cable is let out.
        count: number of points, N.
        stiffening: a [1/m] of the whole cable, None for a linear spring; see `stretched`.
        pretension: tension about which it stiffens [N].
    """

    stiffness: Scalar
    drawn: Scalar
    let_out: Scalar
    count: int
    stiffening: Scalar | None = None
    pretension: Scalar = 0.0

    @property
    def shares(self) -> list[float]:
        """The shares of the cable's length that the stretches are, from the drive to the joint, (N
        + 1,).
        """
        return [1 / (2 * self.count), *([1 / self.count] * (self.count - 1)), 1 / (2 * self.count)]

    def tension(self, stretch: int, extension: Scalar) -> Scalar:
        """Return the tension of a stretch of the cable [N], negative where slack.

        The `stretch` is its index, counted from the drive; its `extension` [m] is counted from its
        length without tension.
        """
        share = self.shares[stretch]
        if self.stiffening is None:
            return self.stiffness / share * extension
        return _tension(extension, share, self.stiffness, self.stiffening, self.pretension)

    def bounds(self, point: int, before: Scalar, after: Scalar) -> Bounds:
        """Return the bounds of a point m [m] between its two neighbours.

        The neighbour `before` it, towards the drive, is displaced by l [m], and the neighbour
        `after` it, towards the joint, by r [m]. The point is drawn in where T₁(l − m) > e T₂(m −
        r), and let out where T₂(m − r) > e T₁(l − m).
        """
        drawn = self._held_at(point, before, after, 1, self.drawn)
        let_out = self._held_at(point, before, after, self.let_out, 1)
        # where the cable is slack, both "tensions" are negative and the bounds change sides
        return Bounds(ca.fmin(drawn, let_out), ca.fmax(drawn, let_out))

    def _held_at(
        self, point: int, before: Scalar, after: Scalar, near: Scalar, far: Scalar
    ) -> Scalar:
        """Return the position m at which a T₁(l − m) = b T₂(m − r), with a = `near` and b =
        `far`.
        """
        shares = self.shares[point : point + 2]
        if self.stiffening is None:
            return _linear_balance(before, after, near, far, *shares)
        cable = (self.stiffness, self.stiffening, self.pretension)
        inputs = (before, after, near, far, *shares, *cable)
        search, step = _equal_tensions()
        near_it, _ = search(*inputs)
        return step(near_it, *inputs)

    def settled(self, points: list[Scalar], drive: Scalar, joint: Scalar) -> list[Scalar]:
        """Return the positions at which the `points` come to rest between the ends `drive` and
        `joint`, (N,) [m], by sweeps to and fro.
        """
        line = [drive, *points, joint]
        for point in self.order():
            line[point + 1] = self.bounds(point, line[point], line[point + 2]).hold(line[point + 1])
        return line[1:-1]

    def order(self) -> list[int]:
        """Return the points in the order in which `settled` visits them: from the drive to the
        joint and back, N times.
        """
        forth = list(range(self.count))
        back = forth[-2::-1]
        return forth + back + (forth[1:] + back) * (self.count - 1)

    def middle(self, drive: Scalar, joint: Scalar) -> list[Scalar]:
        """Return the displacements of the points between the ends `drive` and `joint` for which the
        tension is equal all along the cable, (N,) [m].
        """
        return [drive + (joint - drive) * (2 * i + 1) / (2 * self.count) for i in range(self.count)]

    def tensions(self, points: list[Scalar], drive: Scalar, joint: Scalar) -> tuple[Scalar, Scalar]:
        """Return the tensions [N] at the ends `drive` and `joint` of a cable whose points are at
        `points`, zero where slack.
        """
        near = self.tension(0, drive - points[0])
        far = self.tension(self.count, points[-1] - joint)
        return ca.fmax(near, 0), ca.fmax(far, 0)


def _tension(
    extension: Scalar, share: float, stiffness: Scalar, stiffening: Scalar, pretension: Scalar
) -> Scalar:
    """Return the tension of a share of a cable that stiffens [N] at its `extension` [m]; the rest
    are of the whole cable.
    """
    stretch = stretched(extension / share - pretension / stiffness, stiffening)
    return pretension + stiffness * stretch


def _linear_balance(
    before: Scalar, after: Scalar, near: Scalar, far: Scalar, share: Scalar, next_share: Scalar
) -> Scalar:
    """Return the position at which a T₁(l − m) = b T₂(m − r) on a cable that does not stiffen."""
    first = near / share
    last = far / next_share
    return (first * before + last * after) / (first + last)


@lru_cache(maxsize=1)
def _equal_tensions() -> tuple[ca.Function, ca.Function]:
    """Return two functions: a search for the position m at which a T₁(l − m) = b T₂(m − r) on a
    cable that stiffens, by Halley's steps (Phil. Trans. 18, 1694), which have the second derivative
    too; and a last step of Newton from there.

    Both stay calls: copies of them for each point, sweep and derivative are millions of characters
    of C. The search has no derivative; the last step has the position's derivative by all inputs.
    """
    names = ("m", "l", "r", "a", "b", "share_1", "share_2", "stiffness", "stiffening", "pretension")
    position, *inputs = symbols = [ca.SX.sym(name) for name in names]
    before, after, near, far, share, next_share, *cable = inputs
    lacking = near * _tension(before - position, share, *cable)
    lacking -= far * _tension(position - after, next_share, *cable)
    slope = SOFTEST - ca.jacobian(lacking, position)
    bend = lacking * ca.hessian(lacking, position)[0] / (2 * slope)
    farthest = ca.fabs(before - after) + cable[2] / cable[0]
    newton, halley = (
        position + ca.fmax(ca.fmin(lacking / divisor, farthest), -farthest)
        for divisor in (slope, slope - ca.fmax(ca.fmin(bend, slope / 2), -slope / 2))
    )
    nearer = ca.Function("nearer", symbols, [ca.cse(halley)])
    found = begin = _linear_balance(*inputs[:6])
    for _ in range(STIFFENING_STEPS):
        found = nearer(found, *inputs)
    # with a second output the function differs from its derivative in their number
    options = {
        "never_inline": True,
        "is_diff_in": [False] * len(inputs),
        "is_diff_out": [True, False],
    }
    return (
        ca.Function("near_equal_tensions", inputs, [found, found - begin], options),
        ca.Function("equal_tensions", symbols, [ca.cse(newton)], {"never_inline": True}),
    )


@dataclass(frozen=True)
class Body:
    """A joint or a drive as the time step sees it: a coordinate with inertia, damping, friction and
    stops.
    """

    path: str
    name: str
    has_stops: bool


@dataclass(frozen=True)
class InternalState:
    """The internal state of the transmissions, and the coordinates that the tendons see.

    Args:
        q: coordinates with the far sides of backlashes in place of the near ones, (n_bodies,) [rad,
            m].
        inside: positions of the far sides of drives' backlashes, then of the points in sheaths,
            (n_inside,) [rad, m].
    """

    q: Vector
    inside: tuple[Scalar, ...]


@dataclass(frozen=True)
class Pulls:
    """Tensions of the tendons and the forces that they exert on the bodies.

    Args:
        joint: tensions at the joints' ends, (n_tendons,) [N].
        drive: tensions at the drives' ends, (n_tendons,) [N]; they are those at the joints unless a
            tendon runs in a sheath.
        forces: on the bodies, −(∂ℓ/∂q)ᵀ T, (n_bodies,) [N m, N].
    """

    joint: Vector
    drive: Vector
    forces: Vector


class Tendons:
    """The tendons of a rig: lengths, internal state, tensions [N] and forces; `Mechanism` adds the
    other forces.

    Coordinates q, (n_bodies,) [rad, m], are those of the joints, then of the drives; velocities v,
    (n_bodies,), are theirs. Elongations ℓ − l [m] are (n_tendons,).

    Args:
        inputs: numbers of the description that stay inputs whatever their values; see `Parameters`.
        remembers: whether the internal state (backlash, points in a sheath, creep) is remembered,
            as `inside` among the parameters. Otherwise positions are taken to be in the middle of
            their bounds, and creep to be as settled as at the start.
        derived: values that are computed from the description; see `Parameters`.
    """

    def __init__(
        self,
        rig: Rig,
        inputs: Sequence[str] = (),
        remembers: bool = False,
        derived: Derived = NOTHING_DERIVED,
    ) -> None:
        self.rig = rig
        self.remembers = remembers
        self.plays = plays_of(rig)
        self.strains = tuple(
            f"tendons.{i}.creep.strain"
            for i, tendon in enumerate(rig.tendons)
            if tendon.creep is not None
        )
        # points in sheaths come last
        self._first_point = sum(drive.backlash is not None for drive in rig.drives)
        inside = (*self.plays, *self.strains) if remembers else ()
        self.parameters = Parameters(rig, inputs, inside, derived)
        self.bodies = tuple(
            Body(f"{kind}.{i}", part.name, part.stops is not None)
            for kind, parts in (("joints", rig.joints), ("drives", rig.drives))
            for i, part in enumerate(parts)
        )
        self.n_joints = len(rig.joints)
        self.n_drives = len(rig.drives)
        self.n_tendons = len(rig.tendons)
        self.n_bodies = len(self.bodies)
        self._joint = {joint.name: i for i, joint in enumerate(rig.joints)}
        drives = {drive.name: self.n_joints + i for i, drive in enumerate(rig.drives)}
        self.joints_of = tuple(
            tuple(self._joint[name] for name in tendon.joints) for tendon in rig.tendons
        )
        self.drive_of = tuple(drives[tendon.drive] for tendon in rig.tendons)

    def displacement(self, tendon: int, q: Vector) -> Scalar:
        """Return the displacement [m] of a tendon's proximal end at q: the position of its slider,
        or side · R φ of its capstan.
        """
        drive = self.drive_of[tendon]
        return self.winds(tendon) * self.lever(drive) * q[drive]

    def winds(self, tendon: int) -> int:
        """Return +1 where a tendon is drawn in as its drive's position grows, else −1."""
        drive = self.rig.drives[self.drive_of[tendon] - self.n_joints]
        return self.rig.tendons[tendon].winding if drive.kind == "capstan" else 1

    def lever(self, body: int) -> Scalar:
        """Return the radius of a drive's capstan, or 1 for a slider."""
        path = f"{self.bodies[body].path}.radius"
        return self.parameters[path] if path in self.parameters else ca.SX(1)

    def pulled_by(self, body: int) -> list[int]:
        """Return which tendons a drive pulls."""
        return [i for i in range(self.n_tendons) if self.drive_of[i] == body]

    def elongations(self, q: Vector) -> Vector:
        """Return the elongations ℓ_i(q) − l_i of all tendons, (n_tendons,) [m], from the
        coordinates alone: slack, backlash and creep are not in them.
        """
        elongations = []
        for i, tendon in enumerate(self.rig.tendons):
            # each joint on its way changes what the one before it has left of the displacement
            left = self.displacement(i, q)
            for meeting in tendon.meetings:
                angles = [q[self._joint[name]] for name in meeting.joints]
                left = meeting.shape.elongation(self._size(i, meeting), meeting.side, angles, left)
            elongations.append(left)
        return ca.vertcat(*elongations)

    def angle_at(self, tendon: int, elongated: Scalar, q: Vector) -> Scalar:
        """Return the angle [rad] at which a tendon of one joint has the elongation ℓ − l =
        `elongated` [m], with the drives at their positions in q.
        """
        (meeting,) = self.rig.tendons[tendon].meetings
        shape = meeting.shape
        size = self._size(tendon, meeting)
        assert not isinstance(shape, Polynomial)  # it has several joints
        return shape.angle_at(size, meeting.side, elongated, self.displacement(tendon, q))

    def _size(self, tendon: int, meeting: Meeting) -> Size:
        """Return the function name → parameter of how a tendon meets a joint."""
        return lambda name: self.parameters[f"tendons.{tendon}.{meeting.path}.{name}"]

    def length_jacobian(self, q: Vector) -> Matrix:
        """Return ∂ℓ/∂q at q, (n_tendons, n_bodies): the moment arms, with the opposite sign of the
        torque.
        """
        at = ca.SX.sym("q", self.n_bodies)
        return ca.substitute(ca.jacobian(self.elongations(at), at), at, q)

    def stretch(self, drive: int, q: Vector) -> Scalar:
        """Return the stretch of a drive's tendons at q in the drive's own coordinate, Σ h_i ℓ_i/Σ
        h_i² with h_i = ∂ℓ_i/∂s.

        For a capstan with two pulleys it is φ − r θ/R, for a slider with one tendon ℓ. The index
        `drive` counts the drives alone.
        """
        body = self.n_joints + drive
        elongations = self.elongations(q)
        levers = self.length_jacobian(q)[:, body]
        tendons = self.pulled_by(body)
        total = sum(levers[i] * elongations[i] for i in tendons)
        return total / sum(levers[i] ** 2 for i in tendons)

    def wrapped(self, tendon: int) -> Scalar:
        """Return μ β of a tendon's path, for the capstan equation."""
        if self.rig.tendons[tendon].path is None:
            return ca.SX(0)
        path = f"tendons.{tendon}.path"
        return self.parameters[f"{path}.friction"] * self.parameters[f"{path}.wrap"]

    def internal_state(self, q: Vector, settled: bool = False) -> InternalState:
        """Return the internal state after the bodies have moved to q from where it is remembered.
        Where `settled`, what is remembered belongs to q already and is kept.
        """
        remembered = [self.parameters[name] for name in self.plays] if self.remembers else None
        points = None if remembered is None else remembered[self._first_point :]
        tied, far_sides = self._tied(q, remembered, points, settled)
        elongated = self.elongations(tied)
        inside = list[Scalar]()
        for i in range(self.n_tendons):
            if (sheath := self.sheath(i)) is None:
                continue
            ends = self._ends(i, tied, elongated)
            if points is None:
                inside += sheath.middle(*ends)
            else:
                along = points[len(inside) : len(inside) + sheath.count]
                inside += along if settled else sheath.settled(along, *ends)
        if (
            points and not settled
        ):  # the points have moved: the far sides of backlashes find their balance with them
            tied, far_sides = self._tied(q, far_sides, inside, settled)
        return InternalState(tied, (*far_sides, *inside))

    def _tied(
        self,
        q: Vector,
        remembered: Sequence[Scalar] | None,
        points: Sequence[Scalar] | None,
        settled: bool,
    ) -> tuple[Vector, list[Scalar]]:
        """Return q with the far sides of backlashes in place of the near ones, and the far sides of
        the drives' backlashes alone.
        """
        tied = [q[i] for i in range(self.n_bodies)]
        far_sides = list[Scalar]()
        for i in range(self.n_drives):
            if self.rig.drives[i].backlash is not None:
                held = None if remembered is None else remembered[len(far_sides)]
                at = ca.vertcat(*tied)
                far_sides.append(held if settled else self._far_side(i, at, held, points))
                tied[self.n_joints + i] = far_sides[-1]
        for j, joint in enumerate(self.rig.joints):
            if joint.backlash is not None:
                # the tendons turn the pulley until it meets the link
                near = gap(q[j], self.parameters[f"joints.{j}.backlash.width"])
                at = ca.vertcat(*tied)
                tied[j] = balanced(at[j], near, self._pull_along(j, at, points))
        return ca.vertcat(*tied), far_sides

    def bounds(self, which: int, q: Vector) -> Bounds:
        """Return the bounds of a play operator at q, the other ones being where they are remembered
        to be. `which` is its index in `plays`.
        """
        keys = self.plays[which].split(".")
        index = int(keys[1])
        if keys[0] == "drives":
            near = gap(q[self.n_joints + index], self.parameters[f"drives.{index}.backlash.width"])
            if self.rig.drives[index].backlash.held:  # type: ignore[union-attr]
                return near
            points = [self.parameters[name] for name in self.plays[self._first_point :]]
            rests = self._far_side(index, q, self.parameters[self.plays[which]], points)
            return Bounds(rests, rests)
        state = self.internal_state(q, settled=True)
        sheath = self.sheath(index)
        point = int(keys[-1])
        assert sheath is not None
        drive, joint = self._ends(index, state.q, self.elongations(state.q))
        first = which - point
        line = [drive, *state.inside[first : first + sheath.count], joint]
        return sheath.bounds(point, line[point], line[point + 2])

    def _far_side(
        self, drive: int, q: Vector, before: Scalar | None, points: Sequence[Scalar] | None
    ) -> Scalar:
        """Return where the far side of a drive's backlash is."""
        part = self.rig.drives[drive].backlash
        body = self.n_joints + drive
        p = self.parameters
        assert part is not None  # it is asked for drives with backlash
        path = f"drives.{drive}.backlash"
        near = gap(q[body], p[f"{path}.width"])
        start = near.middle if before is None else before
        if part.held:
            return near.hold(start)
        return balanced(start, near, self._pull_along(body, q, points), p[f"{path}.friction"])

    def _pull_along(self, body: int, q: Vector, points: Sequence[Scalar] | None) -> Pull:
        """Return the function position → (Σ T ∂ℓ/∂q, its slope) of the tendons along the coordinate
        of one body, with the others at q.

        The points of sheaths stay at `points` meanwhile; without these a cable is a spring.
        """
        moved = ca.SX.sym("moved")
        at = ca.vertcat(*(moved if i == body else q[i] for i in range(self.n_bodies)))
        forces = self.elastic_forces(at)
        if points:
            joint, drive = self._end_forces(at, points)
            forces = ca.vertcat(*(joint if body < self.n_joints else drive))
        pull = ca.dot(self.length_jacobian(at)[:, body], self._taut(forces))
        slope = ca.jacobian(pull, moved)
        return lambda position: ca.substitute([pull, slope], [moved], [ca.SX(position)])

    def sheath(self, tendon: int) -> Sheath | None:
        """Return the cable of a tendon as springs and points of friction; None where it has no
        points, since all friction of its path acts at its drive.
        """
        path = self.rig.tendons[tendon].path
        if path is None or path.nodes == 0:
            return None
        p = self.parameters
        name = f"tendons.{tendon}"
        exponent = self.wrapped(tendon) / path.nodes
        out = ca.exp(exponent * p[f"{name}.path.let_out"])
        stiffening = p[f"{name}.stiffening"] if p.has(f"{name}.stiffening") else None
        cable = p[f"{name}.stiffness"], ca.exp(exponent), out, path.nodes
        return Sheath(*cable, stiffening, p[f"{name}.pretension"])

    def stiffest(self, tendon: int) -> Scalar:
        """Return the stiffness of a tendon against a fast motion of one end [N/m]. In a sheath with
        N points this is 2 N k, the stiffness of the stretch next to that end.
        """
        sheath = self.sheath(tendon)
        k = self.parameters[f"tendons.{tendon}.stiffness"]
        return k if sheath is None else 2 * sheath.count * k

    def _ends(self, tendon: int, q: Vector, elongated: Vector) -> tuple[Scalar, Scalar]:
        """Return the displacements of a cable's ends at the drive and at the joint [m], whose
        difference is its stretch from the length without tension.
        """
        drive = self.displacement(tendon, q)
        stretch = self._beyond(tendon, elongated[tendon])
        p = self.parameters
        name = f"tendons.{tendon}"
        return drive, drive - stretch - p[f"{name}.pretension"] / p[f"{name}.stiffness"]

    def pulls(self, q: Vector, v: Vector, settled: bool = False) -> Pulls:
        """Return the tensions at both ends of the tendons, T_i = max(k δ + T_pre + c δ̇, 0), zero
        where slack, and their forces on the bodies.

        These are equations (8) and (9) at q and v, in the general form with damping and
        pre-tension. The max(·, 0) corrects them, since a tendon cannot push. For `settled` see
        `internal_state`.
        """
        p = self.parameters
        state = self.internal_state(q, settled)
        nj = self.n_joints
        jacobian = self.length_jacobian(state.q)
        rates = ca.mtimes(jacobian, v)

        def tension(tendon: int, elastic: Scalar) -> Scalar:
            path = f"tendons.{tendon}.damping"
            if not p.has(path):
                return self._taut(elastic)
            damped = elastic + p[path] * rates[tendon]
            return ca.if_else(ca.logic_and(elastic > 0, damped > 0), damped, 0)

        joint, drive = (
            ca.vertcat(*(tension(i, force) for i, force in enumerate(forces)))
            for forces in self._end_forces(state.q, state.inside[self._first_point :])
        )
        forces = -ca.vertcat(
            ca.mtimes(jacobian[:, :nj].T, joint), ca.mtimes(jacobian[:, nj:].T, drive)
        )
        return Pulls(joint, drive, forces)

    def _end_forces(self, q: Vector, points: Sequence[Scalar]) -> tuple[list[Scalar], list[Scalar]]:
        """Return `elastic_forces` at the joints' and at the drives' ends [N], with the points of
        sheaths at `points`.
        """
        elongated = self.elongations(q)
        left = list(points)
        joint = ca.vertsplit(self.elastic_forces(q))
        drive = list(joint)
        for i in range(self.n_tendons):
            if (sheath := self.sheath(i)) is not None:
                drive[i], joint[i] = sheath.tensions(
                    left[: sheath.count], *self._ends(i, q, elongated)
                )
                del left[: sheath.count]
        return joint, drive

    def tensions(self, q: Vector, v: Vector) -> Vector:
        """Return the tensions of all tendons at their drives at q and v, (n_tendons,) [N]; see
        `pulls`.
        """
        return self.pulls(q, v).drive

    @staticmethod
    def _taut(elastic: Vector) -> Vector:
        return ca.if_else(elastic > 0, elastic, 0)

    def elastic_forces(self, q: Vector) -> Vector:
        """Return T_pre + k δ of all tendons at q, (n_tendons,) [N], negative where slack. The δ of
        a tendon that stiffens is that of `stretched`.
        """
        p = self.parameters
        elongated = self.elongations(q)
        forces = []
        for i in range(self.n_tendons):
            path = f"tendons.{i}"
            stretch = stretched(self._beyond(i, elongated[i]), p[f"{path}.stiffening"])
            forces.append(p[f"{path}.stiffness"] * stretch + p[f"{path}.pretension"])
        return ca.vertcat(*forces)

    def _beyond(self, tendon: int, elongated: Scalar) -> Scalar:
        """Return the part of an elongation that is left after slack and creep [m]."""
        p = self.parameters
        path = f"tendons.{tendon}"
        elongated = elongated - p[f"{path}.slack"]
        creep = self.rig.tendons[tendon].creep
        if creep is not None:
            # a creep that is not remembered is taken as settled as it is at the start
            if self.remembers:
                elongated = elongated - p[f"{path}.creep.strain"]
            else:
                elongated = elongated / (1 + p[f"{path}.creep.share"] * creep.settled.value)
        return elongated

    def crept(self, q: Vector, dt: Scalar) -> list[Scalar]:
        """Return all creep `strains` [m] after an interval dt [s] with the bodies at q: c⁺ = λ c +
        (1 − λ) γ/(1 + γ) (T/k + c), λ = e^{−(1 + γ) dt/τ}.

        This is the exact response of τ ċ = γ T/k − c while the tendon's whole stretch, T/k + c,
        stays constant, and so it is stable for every dt.
        """
        p = self.parameters
        pulls = self.pulls(q, ca.SX.zeros(self.n_bodies), settled=True)
        after = []
        for i, tendon in enumerate(self.rig.tendons):
            if tendon.creep is not None:
                path = f"tendons.{i}"
                stretch = (pulls.joint[i] + pulls.drive[i]) / 2 / p[f"{path}.stiffness"]
                share = p[f"{path}.creep.share"]
                strain = p[f"{path}.creep.strain"]
                left = ca.exp(-(1 + share) * dt / p[f"{path}.creep.time"])
                after.append(left * strain + (1 - left) * share / (1 + share) * (stretch + strain))
        return after

    def tendon_damping(self, q: Vector, tensions: Vector) -> Vector:
        """Return the damping Σ c (∂ℓ/∂q_j)² that the taut tendons, those with `tensions` > 0, give
        to each body's own coordinate at q, (n_bodies,).
        """
        jacobian = self.length_jacobian(self.internal_state(q).q)
        total = ca.SX(self.n_bodies, 1)
        for i in range(self.n_tendons):
            if self.parameters.has(f"tendons.{i}.damping"):
                taut = ca.if_else(tensions[i] > 0, self.parameters[f"tendons.{i}.damping"], 0)
                total += taut * (jacobian[i, :] ** 2).T
        return total
