"""Tendons that stiffen, springs that are not linear, and play operators inside a rig, which no
sensor sees: the far side of a backlash, and the points of a cable in its sheath.

Each of them is massless and held by friction, so that its forces are in balance at every time. It
moves by p⁺ = clip(p, a, b) with bounds a and b that the rest of the rig moves (the play operator;
Visintin, Differential Models of Hysteresis, 1994).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import exp
from typing import TypeAlias

import casadi as ca

from distal.expressions import Scalar
from distal.rig import Rig

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


def polynomial_torque(away: Scalar, stiffness: Scalar, quadratic: Scalar, cubic: Scalar) -> Scalar:
    """Return the torque −(k x + k₂ x² + k₃ x³) [N m] of a spring that is x = θ − rest angle [rad]
    `away` from its rest.

    Its `stiffness` k, `quadratic` k₂ and `cubic` k₃ are in N m/rad, N m/rad² and N m/rad³.
    """
    return -away * (stiffness + away * (quadratic + away * cubic))


SHORTEST_SPRING = 1e-6
"""Least length of an extension spring [m]; at length zero it has no direction. Source: rounding (a
division by zero).
"""


def extension_torque(
    away: Scalar,
    stiffness: Scalar,
    free_length: Scalar,
    radius: Scalar,
    distance: Scalar,
    preload: Scalar,
) -> Scalar:
    """Return the torque −F dL/dθ [N m] of a spring between two points, with the length L² = r² + R²
    − 2 r R cos x and dL/dθ = r R sin x/L.

    F = max(preload + k (L − free length), 0), the force of an extension spring with initial
    tension: its coils open at `free_length` [m] with the force `preload` [N], and k is its
    `stiffness` [N/m]. The angle x = θ − line angle [rad] is `away`. The distances from the axis to
    the points on the link and on the base are `radius` r and `distance` R [m].
    """
    length = ca.sqrt(
        ca.fmax(radius**2 + distance**2 - 2 * radius * distance * ca.cos(away), SHORTEST_SPRING**2)
    )
    force = ca.fmax(preload + stiffness * (length - free_length), 0)
    return -force * radius * distance * ca.sin(away) / length


NEWTON_STEPS = 3
"""Number of Newton steps to the position at which tendons balance. Few are enough: their pull is
made of straight lines, with a bend where one goes slack. Source: rounding (of 20,000 random pairs
of tendons with friction, none is further off than 1e-17 m).
"""

STIFFENING_STEPS = 6
"""Number of Halley steps to the position at which two stretches of a cable that stiffens balance;
one Newton step follows. The worst of 4000 random cables is then 7 µm off, with 8 Newton steps alone
4 mm. Source: judgement.
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
