"""Balance of the joints: the torques that they need, the pulls of the drives that make them, and
the forces of the drives.

At a desired angle θ, speed ω and acceleration α a joint needs from its tendons the torque  τ = M α
+ b ω − passive(θ) + d l(T) − τ_ext,  with the inertia M, the damping b, the friction limit l at the
tensions T, the direction of motion d, and the external torque τ_ext. All terms are those of
`Mechanism`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from distal.arrays import Floats
from distal.expressions import Matrix, Vector
from distal.inverse.setpoint_inputs import DERIVED, command_inputs
from distal.model import Mechanism
from distal.model.parameters import Derived, Symbolic
from distal.rig import Rig


@dataclass(frozen=True)
class CoupledJoints:
    """Free joints and the drives that move them, which move no other joint: indices among the free
    joints, and among the drives.
    """

    joints: tuple[int, ...]
    drives: tuple[int, ...]


class Balance:
    """Torques and pulls that hold the joints of a rig, as expressions of the joints' angles and the
    drives' positions.

    A free joint is one whose angle follows no other joint's. The pull f of a drive [N] is the force
    along its first tendon, at the joint's end, that acts on the joints as all of its tendons do.
    """

    def __init__(self, rig: Rig, folded: bool = False) -> None:
        derived = Derived(command_inputs(rig), folded)
        mechanism = Mechanism(rig, remembers=True, derived=derived)
        self.mechanism = mechanism
        self.rig = rig
        self.free = list(mechanism.free)
        self.nj = mechanism.n_joints
        self.nd = mechanism.n_drives
        self.nt = mechanism.n_tendons
        self.nf = len(self.free)
        self.tendons_of = [
            [i for i in range(self.nt) if mechanism.drive_of[i] == self.nj + d]
            for d in range(self.nd)
        ]

    @cached_property
    def parts(self) -> tuple[CoupledJoints, ...]:
        """Groups of free joints and drives that are not coupled to one another."""
        pattern = self.arms(
            ca.SX.sym("q", self.nj), ca.SX.sym("s", self.nd), self.mechanism.parameters.symbols
        )
        moved = {(int(r), int(c)) for r, c in zip(*ca.sparsify(pattern).sparsity().get_triplet())}
        left = set(range(self.nf))
        parts = []
        while left:
            joints = {min(left)}
            drives = set[int]()
            while True:
                drives_now = {d for j, d in moved if j in joints}
                joints_now = joints | {j for j, d in moved if d in drives_now}
                if drives_now == drives and joints_now == joints:
                    break
                joints = joints_now
                drives = drives_now
            left -= joints
            parts.append(CoupledJoints(tuple(sorted(joints)), tuple(sorted(drives))))
        return tuple(parts)

    @property
    def one_sided(self) -> list[bool]:
        """Whether each drive can pull one way only, since it winds one tendon, (n_drives,)."""
        return [len(tendons) == 1 for tendons in self.tendons_of]

    def all_joints(self, free: Vector, offsets: bool = True) -> Vector:
        """Return the angles of all joints, (n_joints,) [rad], from those of the `free` joints,
        (n_free,).

        Without `offsets` it does the same for speeds and accelerations.
        """
        mechanism = self.mechanism
        return ca.mtimes(ca.SX(mechanism.spread), free) + (mechanism.offsets if offsets else 0)

    def _levers(self, angles: Vector, positions: Vector) -> Matrix:
        return self.mechanism.length_jacobian(ca.vertcat(angles, positions))

    def _shares(self, angles: Vector, positions: Vector) -> Vector:
        """Return the share of each tendon's tension in its drive's pull, (n_tendons,): its moment
        arms projected onto those of the drive's first tendon.
        """
        levers = self._levers(angles, positions)[:, : self.nj]
        shares = ca.SX.ones(self.nt)
        for tendons in self.tendons_of:
            first = levers[tendons[0], :]
            for i in tendons[1:]:
                shares[i] = ca.dot(levers[i, :], first) / ca.dot(first, first)
        return shares

    def arms(self, angles: Vector, positions: Vector, p: Vector) -> Matrix:
        """Return the torque on each free joint per pull of each drive, (n_free, n_drives) [m], at
        `angles`, `positions` and parameters `p`.
        """
        first = [tendons[0] for tendons in self.tendons_of]
        levers = self._levers(angles, positions)[first, : self.nj]
        arms = -ca.mtimes(levers, ca.SX(self.mechanism.spread)).T
        return ca.substitute(arms, self.mechanism.parameters.symbols, p)

    @cached_property
    def pull(self) -> ca.Function:
        """Function (θ, s, shares, p) → pulls of the drives [N], and their derivatives by the
        drives' positions [N/m, N/rad], (n_drives,) each.
        """
        mechanism = self.mechanism
        angles = ca.SX.sym("angles", self.nj)
        positions = ca.SX.sym("positions", self.nd)
        shares = ca.SX.sym("c", self.nt)
        tensions = mechanism.pulls(
            ca.vertcat(angles, positions), ca.SX.zeros(mechanism.n_bodies)
        ).joint
        pulls = ca.vertcat(
            *(sum((shares[i] * tensions[i] for i in own), ca.SX(0)) for own in self.tendons_of)
        )
        slopes = ca.jtimes(pulls, positions, ca.SX.ones(self.nd))
        arguments = [angles, positions, shares, mechanism.parameters.symbols]
        return ca.Function("pull", arguments, ca.cse([ca.densify(pulls), ca.densify(slopes)]))

    @cached_property
    def geometry(self) -> ca.Function:
        """Function (θ, s, p) → moment arms (n_free, n_drives), shares (n_tendons,), and the largest
        possible derivative of each drive's pull by its position (n_drives,).
        """
        angles = ca.SX.sym("angles", self.nj)
        positions = ca.SX.sym("positions", self.nd)
        p = self.mechanism.parameters.symbols
        levers = self._levers(angles, positions)
        steepest = []
        shares = self._shares(angles, positions)
        for d, tendons in enumerate(self.tendons_of):
            stiff = (
                ca.fabs(shares[i] * levers[i, self.nj + d]) * self.mechanism.stiffest(i)
                for i in tendons
            )
            steepest.append(sum(stiff, ca.SX(0)))
        outputs = [ca.densify(self.arms(angles, positions, p)), shares, ca.vertcat(*steepest)]
        return ca.Function("geometry", [angles, positions, p], outputs)

    @cached_property
    def needed(self) -> ca.Function:
        """Function (θ_free, ω_free, α_free, s, d, τ_ext, p) → torques τ that the tendons have to
        make, and friction limits, (n_free,) each [N m].

        The direction d of each free joint's friction is −1 to 1, and τ_ext acts on all joints.
        """
        mechanism = self.mechanism
        nf = self.nf
        free, speeds, accelerations, turned = (
            ca.SX.sym(name, nf) for name in ("free", "omega", "alpha", "turned")
        )
        positions = ca.SX.sym("positions", self.nd)
        external = ca.SX.sym("tau", self.nj)
        q = ca.vertcat(self.all_joints(free), positions)
        v = ca.vertcat(self.all_joints(speeds, False), ca.SX.zeros(self.nd))
        pulls = mechanism.pulls(q, ca.SX.zeros(mechanism.n_bodies))
        limits = mechanism.friction_limits(q, v, pulls.joint, pulls.drive)[: self.nj]
        spread = ca.SX(mechanism.spread)
        moving = mechanism.moving_forces(q, v, self.all_joints(accelerations, False))
        moving += (mechanism.dampings() * v - mechanism.passive_forces(q))[: self.nj] - external
        friction = ca.mtimes(ca.fabs(spread).T, ca.vertcat(*(limit.mean for limit in limits)))
        torques = ca.mtimes(spread.T, moving) + turned * friction
        arguments = [
            free,
            speeds,
            accelerations,
            positions,
            turned,
            external,
            mechanism.parameters.symbols,
        ]
        return ca.Function("needed", arguments, ca.cse([ca.densify(torques), ca.densify(friction)]))

    @cached_property
    def driven(self) -> ca.Function:
        """Function (θ, s, s limited to its range, ṡ, d_s, p) → force of each drive, and tensions at
        the drives; d_s is the direction of the drives' friction, −1 to 1.
        """
        mechanism = self.mechanism
        angles = ca.SX.sym("angles", self.nj)
        positions, within, rates, turned = (
            ca.SX.sym(name, self.nd) for name in ("s", "within", "r", "d")
        )
        q = ca.vertcat(angles, positions)
        v = ca.vertcat(ca.SX.zeros(self.nj), rates)
        pulls = mechanism.pulls(q, ca.SX.zeros(mechanism.n_bodies))
        limits = mechanism.friction_limits(q, v, pulls.joint, pulls.drive)[self.nj :]
        friction = [
            limit.mean * turned[d] + limit.asymmetry * ca.fabs(turned[d])
            for d, limit in enumerate(limits)
        ]
        drag = mechanism.dampings() * v - mechanism.passive_forces(ca.vertcat(angles, within))
        force = drag[self.nj :] - pulls.forces[self.nj :] + ca.vertcat(*friction)
        return ca.Function(
            "driven",
            [angles, positions, within, rates, turned, mechanism.parameters.symbols],
            [force, pulls.drive],
        )

    @cached_property
    def moved(self) -> ca.Function:
        """Function (q, dt, p) → internal state after a time dt at q = (θ, s): backlash, points of
        sheaths, creep.
        """
        mechanism = self.mechanism
        q = ca.SX.sym("q", self.mechanism.n_bodies)
        dt = ca.SX.sym("dt")
        p = self.mechanism.parameters.symbols
        inside = [*mechanism.internal_state(q).inside, *mechanism.crept(q, dt)]
        return ca.Function("moved", [q, dt, p], [ca.densify(ca.vertcat(*inside))])

    @cached_property
    def tangent(self) -> ca.Function:
        """Function (θ_free, f, s, d, τ_ext, p) → residual torque A f − τ of the free joints at
        rest, and its derivatives by θ_free at constant pulls f.
        """
        nf = self.nf
        p = self.mechanism.parameters.symbols
        free = ca.SX.sym("free", nf)
        pulls = ca.SX.sym("pulls", self.nd)
        positions = ca.SX.sym("positions", self.nd)
        turned = ca.SX.sym("turned", nf)
        external = ca.SX.sym("tau", self.nj)
        zeros = ca.SX.zeros(nf)
        arms = self.arms(self.all_joints(free), positions, p)
        lacking = (
            ca.mtimes(arms, pulls)
            - self.needed(free, zeros, zeros, positions, turned, external, p)[0]
        )
        arguments = [free, pulls, positions, turned, external, p]
        return ca.Function(
            "tangent", arguments, ca.cse([lacking, ca.densify(ca.jacobian(lacking, free))])
        )

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
        at = [i for i, name in enumerate(parameters.names) if name.startswith(DERIVED)]
        return parameters.values[at]

    def within_stops(self, angles: Symbolic, p: Symbolic) -> Symbolic:
        """Return angles of free joints, (n_free,) [rad], limited to their stops."""
        low, high = (
            self.number(p, [f"joints.{j}.{end}" for j in self.free]) for end in ("low", "high")
        )
        return ca.fmin(ca.fmax(angles, low), high)

    def of_drives(self, p: Symbolic, key: str) -> Symbolic:
        """Return one input of every drive, (n_drives,), by its key, such as `radius`."""
        return self.number(p, [f"drives.{d}.{key}" for d in range(self.nd)])

    def winds(self, drive: int) -> int:
        """Return +1 where a drive draws its first tendon in as its position grows, else −1."""
        return (
            self.rig.tendons[self.tendons_of[drive][0]].winding
            if self.rig.drives[drive].kind == "capstan"
            else 1
        )

    def spread(self) -> ca.Function:
        """Return the function that gives the angles of all joints from those of the free joints."""
        free = ca.SX.sym("free", self.nf)
        return ca.Function("spread", [free], [ca.densify(self.all_joints(free))])
