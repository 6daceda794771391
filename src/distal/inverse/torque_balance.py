"""What commands take from the rig beside the parameters of the equations: limits, ranges, stds and
servos.

Balance of the joints: the torques that they need, the pulls of the drives that make them, and
the forces of the drives.

At a desired angle θ, speed ω and acceleration α a joint needs from its tendons the torque  τ = M α
+ b ω − passive(θ) + d l(T) − τ_ext,  with the inertia M, the damping b, the friction limit l at the
tensions T, the direction of motion d, and the external torque τ_ext. All terms are those of
`Mechanism`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from inspect import signature
from math import inf

import casadi as ca
import numpy as np
from scipy.sparse.csgraph import connected_components

from distal.arrays import Floats
from distal.confidence import BAND
from distal.expressions import Matrix, Vector
from distal.model import Mechanism
from distal.model.parameters import Derived, Symbolic
from distal.model.tendon_tensions import Pulls
from distal.rig import Rig

DERIVED = "command."
"""Prefix of the names of these inputs."""


def command_inputs(rig: Rig) -> dict[str, float]:
    """Return the inputs of the commands' kernels beside the equations' parameters: name with the
    prefix `DERIVED` → value.
    """
    return {f"{DERIVED}{name}": value for name, value in _inputs(rig)}


def _inputs(rig: Rig) -> Iterator[tuple[str, float]]:
    # the slowest drive sets how far ahead angles are commanded
    yield "lead", max((drive.servo.lag for drive in rig.drives if drive.servo), default=0.0)
    for j, joint in enumerate(rig.joints):
        yield from _ends(f"joints.{j}", joint.stops)
    for d, drive in enumerate(rig.drives):
        path = f"drives.{d}"
        limit = inf if drive.limit is None else drive.limit
        servo = drive.servo
        yield from _ends(path, drive.stops)
        yield f"{path}.limit", limit
        yield f"{path}.radius", drive.lever
        yield f"{path}.most_pull", limit / drive.lever
        # so far are pulls commanded above the least tension that all but 2.5 % of the rigs as built
        # keep it: at a given position, softer tendons pull less, in proportion to their stiffness
        stiffnesses = [tendon.stiffness for tendon in rig.tendons_of(drive.name)]
        spread = max(stiffness.total_std / stiffness.value for stiffness in stiffnesses)
        yield f"{path}.margin", 1.0 + BAND * spread
        # a servo of stiffness K and dead band δ, with the force F in the direction d, is at
        # s = u − F/K − δ d
        yield f"{path}.soft", 0.0 if servo is None or not servo.stiffness else 1 / servo.stiffness
        yield f"{path}.dead", 0.0 if servo is None else servo.dead_band
    parameters = Mechanism(rig).parameters
    for name, std in zip(parameters.names, parameters.independent_stds):
        if std > 0.0:
            yield f"{name}.std", float(std)
    for name, (std, _) in parameters.shared.items():
        yield f"shared.{name}.std", std


def _ends(path: str, stops: tuple[float, float] | None) -> Iterator[tuple[str, float]]:
    low, high = stops or (-inf, inf)
    yield f"{path}.low", low
    yield f"{path}.high", high


def traced(method: Callable[..., Iterable[Vector]]) -> cached_property[ca.Function]:
    """Return a method of a `Balance` as a CasADi function, which is made once for each object.

    The arguments are symbols: `p` are the parameters of the equations, and the others have the
    shapes in `Balance.shapes`, by their names, or else one number for each drive.
    """

    def made(balance: Balance) -> ca.Function:
        _, *names = signature(method).parameters
        p = balance.mechanism.parameters.symbols
        symbols = [
            p if name == "p" else ca.SX.sym(name, *balance.shapes.get(name, (balance.nd,)))
            for name in names
        ]
        outputs = [ca.densify(ca.SX(each)) for each in method(balance, *symbols)]
        return ca.Function(method.__name__.strip("_"), symbols, ca.cse(outputs))

    made.__doc__ = method.__doc__
    return cached_property(made)


class Balance:
    """Torques and pulls that hold the joints of a rig, as expressions of the joints' angles and the
    drives' positions.

    A free joint is one whose angle follows no other joint's. The pull f of a drive [N] is the force
    along its first tendon, at the joint's end, that acts on the joints as all of its tendons do.

    In the functions, θ are the angles of all joints, θ_free, ω_free and α_free angles, speeds and
    accelerations of the free joints, s the drives' positions, d the directions of motion, from −1
    to 1, and τ_ext the external torques on all joints.
    """

    def __init__(self, rig: Rig, folded: bool = False) -> None:
        derived = Derived(command_inputs(rig), folded)
        mechanism = Mechanism(rig, remembers=True, derived=derived)
        self.mechanism = mechanism
        self.rig = rig
        self.free = list(mechanism.free)
        self.joints = [rig.joints[j] for j in self.free]
        self.nj = mechanism.n_joints
        self.nd = mechanism.n_drives
        self.nt = mechanism.n_tendons
        self.nf = len(self.free)
        self.n_inside = len(mechanism.plays) + len(mechanism.strains)
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

    @cached_property
    def moved_by(self) -> Matrix:
        """Torque on each free joint per pull of each drive at all angles, by its pattern alone."""
        q = ca.SX.sym("q", self.nj)
        s = ca.SX.sym("s", self.nd)
        return ca.sparsify(self.arms(q, s, self.mechanism.parameters.symbols))

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
        return ca.mtimes(ca.SX(mechanism.spread), free) + (mechanism.offsets if offsets else 0)

    def _levers(self, angles: Vector, positions: Vector) -> Matrix:
        return self.mechanism.length_jacobian(ca.vertcat(angles, positions))

    def arms(self, angles: Vector, positions: Vector, p: Vector) -> Matrix:
        """Return the torque on each free joint per pull of each drive, (n_free, n_drives) [m], at
        `angles`, `positions` and parameters `p`.
        """
        first = [tendons[0] for tendons in self.tendons_of]
        levers = self._levers(angles, positions)[first, : self.nj]
        arms = -ca.mtimes(levers, ca.SX(self.mechanism.spread)).T
        return ca.substitute(arms, self.mechanism.parameters.symbols, p)

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
        """Function (θ, s, p) → moment arms (n_free, n_drives), shares (n_tendons,), and the largest
        possible derivative of each drive's pull by its position (n_drives,).

        The share of a tendon's tension in its drive's pull is its moment arms projected onto those
        of the drive's first tendon.
        """
        levers = self._levers(angles, positions)
        shares = ca.SX.ones(self.nt)
        steepest = ca.SX.zeros(self.nd)
        for d, tendons in enumerate(self.tendons_of):
            first = levers[tendons[0], : self.nj]
            for i in tendons[1:]:
                shares[i] = ca.dot(levers[i, : self.nj], first) / ca.dot(first, first)
            for i in tendons:
                pulled = ca.fabs(shares[i] * levers[i, self.nj + d])
                steepest[d] += pulled * self.mechanism.stiffest(i)
        return [self.arms(angles, positions, p), shares, steepest]

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
        spread = ca.SX(mechanism.spread)
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
        made = ca.mtimes(self.arms(self.all_joints(free), positions, p), pulls)
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
        return ca.mtimes(ca.SX(self.mechanism.spread).T, forces[: self.nj]) - needed, friction

    @traced
    def spread(self, free: Vector) -> list[Vector]:
        """Function θ_free → angles of all joints, (n_joints,)."""
        return [self.all_joints(free)]

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
