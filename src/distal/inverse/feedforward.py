"""One sample of the inverse: from desired angles to the setpoints of the drives.

At a desired angle θ, speed ω and acceleration α a joint needs from its tendons the torque τ = M α +
b ω − passive(θ) + d l(T) − τ_ext, with the inertia M, the damping b, the friction limit l at the
tensions T, the direction of motion d, and the external torque τ_ext, all as `Mechanism` has them.
The pulls f solve A f = τ with f ≥ f_min. Where tendons are more than the joints and all stay taut,
they have the least Σ f, a linear programme: at its solution as many pulls are at their minimum as
there are more pulls than torques (a vertex), and the few sets of pulls that may be are tried one by
one, without iteration, in exported C too. Each drive goes to the position s at which its tendons
pull so by the model, T(θ, s) = f. Since T grows with s, Newton's steps within a bracket find it.
The internal state (backlash, points of sheaths, creep) is kept from sample to sample and follows
the commands.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from inspect import signature
from itertools import combinations
from math import inf, radians

import casadi as ca
import numpy as np
from scipy.sparse.csgraph import connected_components

from distal.arrays import Floats
from distal.confidence import BAND
from distal.errors import CommandError
from distal.expressions import Matrix, Scalar, Vector
from distal.kernels import Layout
from distal.model import Mechanism
from distal.model.parameters import Derived, Symbolic
from distal.model.tendon_tensions import Pulls
from distal.rig import Rig, check_scales
from distal.rig.components import Servo
from distal.simulation.plant import hysteretic, settled_function
from distal.units import rounded, to_si

DERIVED = "command."
"""Prefix of the names of these inputs."""


def command_inputs(rig: Rig) -> dict[str, float]:
    """Return the inputs of the commands' kernels beside the equations' parameters: name with the
    prefix `DERIVED` → value.
    """
    return {f"{DERIVED}{name}": value for name, value in _inputs(rig)}


def _inputs(rig: Rig) -> Iterator[tuple[str, float]]:
    # the slowest drive sets how far ahead angles are commanded
    yield "lead", max((drive.servo or Servo()).lag for drive in rig.drives)
    for j, joint in enumerate(rig.joints):
        yield from zip((f"joints.{j}.low", f"joints.{j}.high"), joint.stops or (-inf, inf))
    for d, drive in enumerate(rig.drives):
        servo = drive.servo or Servo()
        low, high = drive.stops or (-inf, inf)
        stiffnesses = [tendon.stiffness for tendon in rig.tendons_of(drive.name)]
        spread = max(stiffness.total_std / stiffness.value for stiffness in stiffnesses)
        of_drive = {
            "low": low,
            "high": high,
            "limit": inf if drive.limit is None else drive.limit,
            "radius": drive.lever,
            # so far are pulls commanded above the least tension that all but 2.5 % of the rigs as
            # built keep it: at a given position, softer tendons pull less, in proportion to their
            # stiffness
            "margin": 1.0 + BAND * spread,
            # a servo of stiffness K and dead band δ, with the force F in the direction d, is at
            # s = u − F/K − δ d
            "soft": 1 / (servo.stiffness or inf),
            "dead": servo.dead_band,
        }
        for key, value in of_drive.items():
            yield f"drives.{d}.{key}", value
    parameters = Mechanism(rig).parameters
    for name, std in zip(parameters.names, parameters.independent_stds.tolist()):
        if std > 0.0:
            yield f"{name}.std", std
    for name, (std, _) in parameters.shared.items():
        yield f"shared.{name}.std", std


def limited(value: Vector, most: Scalar) -> Vector:
    """Return a value within ± `most`."""
    return ca.fmin(ca.fmax(value, -most), most)


VIOLATED = 1e6
"""Cost of a newton below the minimum beside that of a newton above it [1]: where no solution keeps
all tendons taut, the nearest to that is taken. Source: definition (a penalty: any number far above
ratios of moment arms).
"""

SINGULAR = 1e-12
"""Magnitude of a determinant per product of the rows' lengths, which bounds it (Hadamard), up to
which its matrix counts as singular [1]. Source: rounding (division by a determinant of zero).
"""

LEAST_TENSION = 1.0
"""Default of the tension that commands keep in the tendons [N]. Source: judgement."""

FARTHEST = 0.1
"""Largest distance along its tendon, from where a drive is, at which its next position is looked
for, and by which the least tension may stretch a tendon [m]. Source: judgement.
"""


def least_tension_of(value: float | str, rig: Rig) -> float:
    """Return a least tension [N], checked for a rig.

    Args:
        value: newtons, or a text with a unit.
        rig: whose tendons shall keep it.

    Raises:
        CommandError: the value is no tension of 0 N or more, stretches a tendon too far, or the
            rig's scale of force was taken.
    """
    check_scales(rig, "a command that keeps tendons taut", "tension")
    try:
        tension = to_si(value, "N")
    except ValueError as problem:
        raise CommandError(f"least_tension: {problem}") from None
    if not 0.0 <= tension < inf:
        raise CommandError(f"least_tension: at least 0 N, {value} came")
    for tendon in rig.tendons:
        most = FARTHEST * tendon.stiffness.value
        if tension > most:
            raise CommandError(
                f"least_tension: {value} would stretch tendon '{tendon.name}' by more than "
                f"{FARTHEST:g} m; up to {rounded(most, 3)} N can be"
            )
    return tension


def least_pulls(arms: Matrix, torques: Vector, lowest: Vector, one_sided: Sequence[bool]) -> Vector:
    """Return the pulls f, (m,) [N], that solve A f = τ with the least sum.

    Where n < m, one-sided pulls are at least `lowest`, if any solution allows that. Where n = m,
    the one solution is returned as it is.

    Args:
        arms: A, (n, m), n ≤ m: torque per pull [m].
        torques: τ, (n,) [N m].
        lowest: f_min, (m,) [N].
        one_sided: which pulls are of drives with a single tendon; a motor that winds two tendons
            pulls either way.
    """
    n, m = arms.shape
    if n == m:
        return solved(arms, torques)
    best = ca.SX.zeros(m)
    cost = ca.SX(ca.inf)
    sided = [i for i in range(m) if one_sided[i]]
    for at in map(list, combinations(sided, m - n)):
        free = [i for i in range(m) if i not in at]
        own = arms[:, free]
        if ca.sprank(own) < n:
            continue
        pulls = ca.SX(m, 1)
        pulls[at] = lowest[at]
        pulls[free] = solved(own, torques - ca.mtimes(arms[:, at], lowest[at]))
        total = ca.sum1(ca.fabs(pulls))
        for i in free:
            if one_sided[i]:
                total += VIOLATED * ca.fmax(lowest[i] - pulls[i], 0)
        better = total < cost
        best = ca.if_else(better, pulls, best)
        cost = ca.if_else(better, total, cost)
    return ca.densify(best)


def solved(matrix: Matrix, right: Matrix) -> Matrix:
    """Return M⁻¹ b, by its adjugate and determinant up to three rows and by CasADi's `solve`
    beyond.

    Up to three rows a singular M gives zero. The `matrix` is M, (n, n), and `right` is b, (n, k).
    """
    if matrix.size1() > 3:
        return ca.solve(ca.densify(matrix), right)
    bound = ca.SX(1)
    for row in ca.vertsplit(matrix):
        bound *= ca.norm_2(row)
    determinant = ca.det(matrix)
    usable = ca.fabs(determinant) > SINGULAR * bound
    found = ca.mtimes(ca.adj(matrix), right) / ca.if_else(usable, determinant, 1)
    return ca.if_else(usable, found, 0)


TURNS = radians(0.1)
"""Turn of a joint over which the direction of its friction changes by 1, which is as near as it
comes to its desired angle [rad]. Source: judgement.
"""

DRIVE_TURNS = 0.1e-3
"""Motion of a drive along its tendon over which the direction of its friction changes by 1 [m].
Source: judgement.
"""

ROUNDS = 3
"""Number of rounds in which what depends on one another is made to agree: friction and tensions in
a sample, the drives' positions and the internal state at the start. Source: judgement.
"""

STEPS = 14
"""Number of Newton's steps to the drives' positions (or halvings of the bracket, where a tendon is
slack or in its backlash) and to the angles at which joints rest. Source: rounding (half as many
change the commands of the shipped rigs by less than 1e-12 m or rad).
"""

TINY_PULL = 1e-9
"""Least friction in a transmission that is divided by [N]. Source: rounding (division by a friction
of zero).
"""

REACHES = 6
"""Number of Gauss-Newton steps to the nearest angles that can be held, where drives are fewer than
joints. Source: rounding (further steps change the angles by less than 1e-14 rad).
"""


def traced(method: Callable[..., Iterable[Vector]]) -> cached_property[ca.Function]:
    """Return a method of a `CommandModel` as a CasADi function, which is made once for each object.

    The arguments are symbols: `p` are the parameters of the equations, and the others have the
    shapes in `CommandModel.shapes`, by their names, or else one number for each drive.
    """

    def made(model: CommandModel) -> ca.Function:
        _, *names = signature(method).parameters
        p = model.mechanism.parameters.symbols
        symbols = [
            p if name == "p" else ca.SX.sym(name, *model.shapes.get(name, (model.nd,)))
            for name in names
        ]
        outputs = [ca.densify(ca.SX(each)) for each in method(model, *symbols)]
        return ca.Function(method.__name__.strip("_"), symbols, ca.cse(outputs))

    made.__doc__ = method.__doc__
    return cached_property(made)


class CommandModel:
    """The inverse of a rig as a kernel: its function, and the layouts of its kernel state, of a
    desired sample and of its output; and the torques and pulls that hold the joints, as expressions
    of the joints' angles and the drives' positions.

    A free joint is one whose angle follows no other joint's. The pull f of a drive [N] is the force
    along its first tendon, at the joint's end, that acts on the joints as all of its tendons do.

    In the functions, θ are the angles of all joints, θ_free, ω_free and α_free angles, speeds and
    accelerations of the free joints, s the drives' positions, d the directions of motion, from −1
    to 1, and τ_ext the external torques on all joints.
    """

    def __init__(self, rig: Rig, folded: bool = False) -> None:
        self.mechanism = mechanism = Mechanism(
            rig, remembers=True, derived=Derived(command_inputs(rig), folded)
        )
        self.rig = rig
        self.free = list(mechanism.free)
        self.joints = [rig.joints[j] for j in self.free]
        self.joint_names = tuple(joint.name for joint in self.joints)
        self.nj = mechanism.n_joints
        self.nd = mechanism.n_drives
        self.nt = mechanism.n_tendons
        self.nf = len(self.free)
        self.n_inside = len(mechanism.parameters.inside)
        self.tendons_of = [mechanism.pulled_by(self.nj + d) for d in range(self.nd)]
        self.one_sided = [len(tendons) == 1 for tendons in self.tendons_of]
        """Whether each drive can pull one way only, since it winds one tendon, (n_drives,)."""
        of_free = ("free", "desired", "speeds", "accelerations", "turned", "torques")
        self.shapes = dict.fromkeys(of_free, (self.nf,)) | {
            "angles": (self.nj,),
            "external": (self.nj,),
            "arms": (self.nf, self.nd),
            "shares": (self.nt,),
            "lowest": (1,),
        }
        self.n_parameters = len(self.mechanism.parameters) - self.n_inside
        """Number of the parameters without the internal state, which is the last of them."""
        self.rubbing = hysteretic(self.mechanism)
        self.kernel_state = Layout(
            positions=self.nd,
            pulls=self.nd,
            turned=self.nf,
            drives_turned=self.nd,
            rubbed=self.nd,
            inside=self.n_inside,
            begun=1,
        )
        self.x = Layout(
            dt=1, angles=self.nf, speeds=self.nf, accelerations=self.nf, torques=self.nj, lowest=1
        )
        self.y = Layout(
            angles=self.nf,
            positions=self.nd,
            speeds=self.nd,
            forces=self.nd,
            tensions=self.nt,
            short=self.nd,
            gives=self.nd,
        )

    @cached_property
    def moved_by(self) -> Matrix:
        """Torque on each free joint per pull of each drive at all angles, by its pattern alone."""
        q = ca.SX.sym("q", self.nj)
        s = ca.SX.sym("s", self.nd)
        return ca.sparsify(self.arms(q, s))

    @cached_property
    def parts(self) -> list[tuple[list[int], list[int]]]:
        """Groups of free joints and the drives that move them, which move no other joint: indices
        among the free joints, and among the drives.
        """
        moves = np.array(ca.DM.ones(self.moved_by.sparsity())) > 0.0
        count, groups = connected_components(moves @ moves.T)
        joints = [np.flatnonzero(groups == k) for k in range(count)]
        return [(of.tolist(), np.flatnonzero(moves[of].any(axis=0)).tolist()) for of in joints]

    def all_joints(self, free: Vector, offsets: bool = True) -> Vector:
        """Return the angles of all joints, (n_joints,) [rad], from those of the `free` joints,
        (n_free,).

        Without `offsets` it does the same for speeds and accelerations.
        """
        mechanism = self.mechanism
        return ca.mtimes(mechanism.spread, free) + (mechanism.offsets if offsets else 0)

    def _levers(self, angles: Vector, positions: Vector) -> Matrix:
        return self.mechanism.length_jacobian(ca.vertcat(angles, positions))

    def arms(self, angles: Vector, positions: Vector) -> Matrix:
        """Return the torque on each free joint per pull of each drive, (n_free, n_drives) [m], at
        `angles` and `positions`.
        """
        first = [tendons[0] for tendons in self.tendons_of]
        levers = self._levers(angles, positions)[first, : self.nj]
        return -ca.mtimes(levers, self.mechanism.spread).T

    @traced
    def pull(self, angles: Vector, positions: Vector, shares: Vector, p: Vector) -> list[Vector]:
        """Function (θ, s, shares, p) → pulls of the drives [N], and their derivatives by the
        drives' positions [N/m, N/rad], (n_drives,) each.
        """
        tensions = self._pulls_at(angles, positions).joint
        pulls = ca.vertcat(*(ca.dot(shares[own], tensions[own]) for own in self.tendons_of))
        return [pulls, ca.jtimes(pulls, positions, ca.SX.ones(self.nd))]

    def _pulls_at(self, angles: Vector, positions: Vector, settled: bool = False) -> Pulls:
        """Return the pulls of the tendons at rest."""
        bodies = ca.vertcat(angles, positions)
        return self.mechanism.pulls(bodies, ca.SX.zeros(self.mechanism.n_bodies), settled=settled)

    @traced
    def geometry(self, angles: Vector, positions: Vector, p: Vector) -> list[Vector]:
        """Function (θ, s, p) → moment arms (n_free, n_drives), and shares (n_tendons,).

        The share of a tendon's tension in its drive's pull is its moment arms projected onto those
        of the drive's first tendon.
        """
        levers = self._levers(angles, positions)
        shares = ca.SX.ones(self.nt)
        for tendons in self.tendons_of:
            first = levers[tendons[0], : self.nj]
            for i in tendons[1:]:
                shares[i] = ca.dot(levers[i, : self.nj], first) / ca.dot(first, first)
        return [self.arms(angles, positions), shares]

    @traced
    def needed(
        self,
        free: Vector,
        speeds: Vector,
        accelerations: Vector,
        positions: Vector,
        turned: Vector,
        external: Vector,
        p: Vector,
    ) -> list[Vector]:
        """Function (θ_free, ω_free, α_free, s, d, τ_ext, p) → torques τ that the tendons have to
        make, and friction limits, (n_free,) each [N m].
        """
        mechanism = self.mechanism
        q = ca.vertcat(self.all_joints(free), positions)
        v = ca.vertcat(self.all_joints(speeds, False), ca.SX.zeros(self.nd))
        pulls = mechanism.pulls(q, ca.SX.zeros(mechanism.n_bodies))
        limits = mechanism.friction_limits(q, v, pulls.joint, pulls.drive)[: self.nj]
        spread = mechanism.spread
        moving = mechanism.moving_forces(q, v, self.all_joints(accelerations, False))
        moving += (mechanism.dampings() * v - mechanism.passive_forces(q))[: self.nj] - external
        friction = ca.mtimes(ca.fabs(spread).T, ca.vertcat(*(limit.mean for limit in limits)))
        return [ca.mtimes(spread.T, moving) + turned * friction, friction]

    @traced
    def driven(
        self,
        angles: Vector,
        positions: Vector,
        within: Vector,
        rates: Vector,
        drives_turned: Vector,
        p: Vector,
    ) -> list[Vector]:
        """Function (θ, s, s limited to its range, ṡ, d of the drives, p) → force of each drive, and
        tensions at the drives.
        """
        mechanism = self.mechanism
        q = ca.vertcat(angles, positions)
        v = ca.vertcat(ca.SX.zeros(self.nj), rates)
        pulls = self._pulls_at(angles, positions)
        limits = mechanism.friction_limits(q, v, pulls.joint, pulls.drive)[self.nj :]
        friction = [
            limit.mean * drives_turned[d] + limit.asymmetry * ca.fabs(drives_turned[d])
            for d, limit in enumerate(limits)
        ]
        drag = mechanism.dampings() * v - mechanism.passive_forces(ca.vertcat(angles, within))
        force = drag[self.nj :] - pulls.forces[self.nj :] + ca.vertcat(*friction)
        return [force, pulls.drive]

    @traced
    def tangent(
        self,
        free: Vector,
        pulls: Vector,
        positions: Vector,
        turned: Vector,
        external: Vector,
        p: Vector,
    ) -> list[Vector]:
        """Function (θ_free, f, s, d, τ_ext, p) → residual torque A f − τ of the free joints at
        rest, and its derivatives by θ_free at constant pulls f.
        """
        still = ca.SX.zeros(self.nf)
        needed, _ = self.needed(free, still, still, positions, turned, external, p)
        made = ca.mtimes(self.arms(self.all_joints(free), positions), pulls)
        return [made - needed, ca.jacobian(made - needed, free)]

    def lacking(self, free: Vector, positions: Vector, turned: Vector) -> tuple[Vector, Vector]:
        """Return the residual torques of joints at rest and their friction limits, (n_free,) each
        [N m].

        Args:
            free: angles of the free joints [rad], (n_free,).
            positions: of the drives [m, rad], (n_drives,).
            turned: direction in which friction acts, −1 to 1, (n_free,).
        """
        still = ca.SX.zeros(self.nf)
        none = ca.SX.zeros(self.nj)
        p = self.mechanism.parameters.symbols
        needed, friction = self.needed(free, still, still, positions, turned, none, p)
        forces = self._pulls_at(self.all_joints(free), positions, settled=True).forces
        return ca.mtimes(self.mechanism.spread.T, forces[: self.nj]) - needed, friction

    def number(self, p: Symbolic, names: Sequence[str]) -> Symbolic:
        """Return the inputs with these `names`, those of `command_inputs` without its prefix, out
        of all inputs `p`.
        """
        return self.mechanism.parameters.of(p, [f"{DERIVED}{name}" for name in names])

    @property
    def derived(self) -> Floats:
        """Values of the inputs that `command_inputs` adds to the equations' parameters, (n,), in
        their order.
        """
        parameters = self.mechanism.parameters
        return parameters.values[[name.startswith(DERIVED) for name in parameters.names]]

    def within_stops(self, angles: Symbolic, p: Symbolic) -> Symbolic:
        """Return angles of free joints, (n_free,) [rad], limited to their stops."""
        low, high = (
            self.number(p, [f"joints.{j}.{end}" for j in self.free]) for end in ("low", "high")
        )
        return ca.fmin(ca.fmax(angles, low), high)

    def of_drives(self, p: Symbolic, key: str) -> Symbolic:
        """Return one input of every drive, (n_drives,), by its key, such as `radius`."""
        return self.number(p, [f"drives.{d}.{key}" for d in range(self.nd)])

    def possible(self, forces: Vector, p: Vector) -> Vector:
        """Return forces that drives can have with the parameters p, (n_drives,): a slider cannot
        push.
        """
        high = self.of_drives(p, "limit")
        # no product with a limit that may be infinite
        pushes = ca.DM([drive.kind != "slider" for drive in self.rig.drives])
        return ca.fmin(ca.fmax(forces, ca.if_else(pushes, -high, 0)), high)

    def function(self) -> ca.Function:
        """Return the kernel (kernel_state, x, p) → (kernel_state⁺, y) of the next command, with the
        parameters p without the internal state.
        """
        kernel_state = ca.MX.sym("kernel_state", self.kernel_state.size)
        x = ca.MX.sym("x", self.x.size)
        own = ca.MX.sym("p", self.n_parameters)
        was = self.kernel_state.parts(kernel_state)
        desired = self.x.parts(x)
        p = ca.vertcat(own, was["inside"])
        dt = desired["dt"]
        lowest = desired["lowest"]
        external = desired["torques"]
        before = was["positions"]
        turned = limited(was["turned"] + desired["speeds"] * dt / TURNS, 1)
        held = desired["angles"]
        s = before
        f = was["pulls"]
        high = self.of_drives(p, "limit")
        radius = self.of_drives(p, "radius")
        for _ in range(ROUNDS):
            if any(len(drives) < len(joints) for joints, drives in self.parts):
                held, f = self._reached(desired["angles"], held, f, s, turned, external, lowest, p)
            torques, _ = self.needed(
                held, desired["speeds"], desired["accelerations"], s, turned, external, p
            )
            joints = self.all_joints(held)
            arms, shares = self.geometry(joints, s, p)
            asked = self._pulls(arms, torques, lowest * self.of_drives(p, "margin"), f)
            f = limited(asked, high / radius)
            sprung = f
            rubbed = was["rubbed"]
            if self.rubbing:
                sprung, rubbed = self._sprung(joints, s, f, was["pulls"], rubbed, p)
            s = self._positions(joints, s, sprung, shares, p)
        begun = was["begun"]
        rates = ca.if_else(begun > 0, (s - before) / ca.if_else(dt > 0, dt, 1), 0)
        moved = begun * radius * (s - before)
        drives_turned = limited(was["drives_turned"] + moved / DRIVE_TURNS, 1)
        # a drive goes no further than its range; its force is still that of the desired position
        within = ca.fmin(ca.fmax(s, self.of_drives(p, "low")), self.of_drives(p, "high"))
        forces, tensions = self.driven(joints, s, within, rates, drives_turned, p)
        # servos give way: by their stiffness, and by their dead band in the direction of motion
        gives = self.of_drives(p, "soft") * self.possible(forces, p)
        gives += self.of_drives(p, "dead") * drives_turned
        inside = ca.MX(0, 1)
        if self.n_inside:
            inside = settled_function(self.mechanism)(ca.vertcat(joints, s), dt, p)
        after = self.kernel_state.joined(
            positions=s,
            pulls=f,
            turned=turned,
            drives_turned=drives_turned,
            rubbed=rubbed,
            inside=inside,
            begun=ca.MX(1),
        )
        y = self.y.joined(
            angles=held,
            positions=within,
            speeds=rates,
            forces=forces,
            tensions=tensions,
            short=asked - f,
            gives=gives,
        )
        return ca.Function("command", [kernel_state, x, own], [after, y])

    @traced
    def _pulls(self, arms: Matrix, torques: Vector, least: Vector, before: Vector) -> list[Vector]:
        """Function (arms, τ, least, f) → pulls of the drives, not below `least` for one-sided ones.
        Where drives are fewer than the joints that they move, f stays.
        """
        pulls = ca.SX(before)
        # an arm that is zero at all angles is none
        moving = ca.project(arms, self.moved_by.sparsity())
        for joints, drives in self.parts:
            if len(drives) >= len(joints):
                sided = [self.one_sided[d] for d in drives]
                found = least_pulls(moving[joints, drives], torques[joints], least[drives], sided)
                for d, is_sided, pull in zip(drives, sided, ca.vertsplit(found)):
                    pulls[d] = ca.fmax(pull, least[d]) if is_sided else pull
        return [pulls]

    @traced
    def _reached(
        self,
        desired: Vector,
        free: Vector,
        pulls: Vector,
        positions: Vector,
        turned: Vector,
        external: Vector,
        lowest: Vector,
        p: Vector,
    ) -> list[Vector]:
        """Function (desired, θ_free, f, s, d, τ_ext, lowest, p) → the nearest angles that pulls can
        hold, and these pulls.

        At θ and f the residual torque of the joints is r = A f − τ; after a change df of the pulls
        they rest at θ − (∂r/∂θ)⁻¹ (r + A df).
        """
        held = ca.SX(free)
        f = ca.SX(pulls)
        for _ in range(REACHES):
            lacking, slopes = self.tangent(held, f, positions, turned, external, p)
            arms = self.arms(self.all_joints(held), positions)
            for joints, drives in self.parts:
                if len(drives) >= len(joints):
                    continue
                own = slopes[joints, joints]
                rest = held[joints] - solved(own, lacking[joints])
                moves = -solved(own, arms[joints, drives])
                away = desired[joints] - rest
                change = solved(ca.mtimes(moves.T, moves), ca.mtimes(moves.T, away))
                after = ca.fmax(f[drives] + change, lowest)
                held[joints] = rest + ca.mtimes(moves, after - f[drives])
                f[drives] = after
        return [held, f]

    @cached_property
    def _positions(self) -> ca.Function:
        """Function (θ, s, f, shares, p) → positions at which the drives pull with f."""
        angles = ca.MX.sym("angles", self.nj)
        before = s = ca.MX.sym("before", self.nd)
        pulls = ca.MX.sym("pulls", self.nd)
        shares = ca.MX.sym("shares", self.nt)
        p = ca.MX.sym("p", len(self.mechanism.parameters))
        rising = ca.DM([self.mechanism.winds(own[0]) for own in self.tendons_of])
        wide = FARTHEST / self.of_drives(p, "radius")
        low = before - wide
        high = before + wide
        for _ in range(STEPS):
            value, slope = self.pull(angles, s, shares, p)
            s, low, high = self._refined(s, low, high, rising * (value - pulls), rising * slope)
        return ca.Function("positions", [angles, before, pulls, shares, p], [s])

    @traced
    def _sprung(
        self,
        angles: Vector,
        positions: Vector,
        pulls: Vector,
        before: Vector,
        rubbed: Vector,
        p: Vector,
    ) -> list[Vector]:
        """Function (θ, s, f, f before, e, p) → pulls that are left for the springs, and e⁺, after
        friction in the transmissions (`Hysteresis`).

        This friction is e h, with e in [−1, 1] that turns over as the pull changes by h: f_spring =
        f − e h.
        """
        mechanism = self.mechanism
        sprung = ca.SX(pulls)
        after = ca.SX(rubbed)
        q = ca.vertcat(angles, positions)
        tensions = mechanism.tensions(q, ca.SX.zeros(mechanism.n_bodies))
        for d in self.rubbing:
            limit = mechanism.hysteresis_limit(d, q, tensions) / self.of_drives(p, "radius")[d]
            turned = (pulls[d] - before[d]) / ca.fmax(limit, TINY_PULL)
            after[d] = limited(rubbed[d] + turned, 1)
            sprung[d] -= after[d] * limit
        return [sprung, after]

    @traced
    def _refined(
        self, positions: Vector, low: Vector, high: Vector, excess: Vector, slope: Vector
    ) -> list[Vector]:
        """Function (s, low, high, excess, slope) → next s, low and high, by Newton's step, or to
        the middle of the bracket.
        """
        below = excess < 0
        lower = ca.if_else(below, positions, low)
        upper = ca.if_else(below, high, positions)
        newton = positions - excess / ca.if_else(slope > 0, slope, 1)
        inner = ca.logic_and(slope > 0, ca.logic_and(newton >= lower, newton <= upper))
        return [ca.if_else(inner, newton, (lower + upper) / 2), lower, upper]
