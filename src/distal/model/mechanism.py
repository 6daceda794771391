"""The forces of a rig, from one length function per tendon; and its motion at one moment, from
which the sensors' readings follow.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from distal.expressions import Matrix, Scalar, Vector
from distal.model.chain import Chain
from distal.model.friction import Limit, axle_limit, capstan_limit, stribeck
from distal.model.parameters import NOTHING_DERIVED, Derived
from distal.model.tendon_tensions import Tendons
from distal.rig import Joint, Motion, Rig, Sensor, measurand_of, part_of

SMALLEST_CHAIN = 2
"""Number of joints from which on joints with links are a chain, in which they move one another. The
link of one joint alone is a constant inertia and a weight. Source: physics (one joint has no other
that it could move).
"""

SHORTEST_SPRING = 1e-6
"""Least length of an extension spring [m]; at length zero it has no direction. Source: rounding (a
division by zero).
"""

GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s²]. Source: definition (standard gravity)."""


class Mechanism(Tendons):
    """The equations of a tendon-driven rig in general form: coordinates q = (joint angles, drive
    displacements) and their rates v.

        stretch  δ_i = ℓ_i(q) − ℓ_i⁰
        tension  T_i = max(k_i δ_i + c_i δ̇_i, 0) for δ_i > 0, else 0
        joints   J θ̈ + b θ̇ + friction(θ̇, T) = −(∂ℓ/∂θ)ᵀ T + spring + gravity + τ_ext
        drives   m s̈ + b ṡ + friction(ṡ, T) = −(∂ℓ/∂s)ᵀ T + U − F_stop(s)

    Joints with links carry one another: their inertia is J + M(q), and Coriolis torques and gravity
    are those of their `chain`. A coupled joint has no coordinate of its own: θ = `spread` θ_free +
    `offsets`.

    On the paper's rig the virtual work −(∂ℓ/∂q)ᵀT gives its equations (2), (3), (10) and (11), with
    two corrections: (11) has "+" in cos θ cos φ2 + sin θ sin φ2, and tension has a max(·, 0) (8,
    9), since a tendon cannot push.

    For the arguments, and the shapes of q, v and tensions, see `Tendons`.
    """

    def __init__(
        self,
        rig: Rig,
        inputs: Sequence[str] = (),
        remembers: bool = False,
        derived: Derived = NOTHING_DERIVED,
    ) -> None:
        super().__init__(rig, inputs, remembers, derived)
        links = Chain(rig, self.parameters) if rig.is_chain else None
        carried = self.n_joints >= SMALLEST_CHAIN
        self.chain = links if carried else None
        self._lone = None if carried else links
        self.free = [i for i, joint in enumerate(rig.joints) if joint.coupled is None]
        self.spread = ca.DM(self.n_joints, len(self.free))
        self.offsets = ca.DM.zeros(self.n_joints)
        for i, joint in enumerate(rig.joints):
            if joint.coupled is None:
                self.spread[i, self.free.index(i)] = 1.0
            else:
                self.spread[i, self.free.index(self._joint[joint.coupled.joint])] = (
                    joint.coupled.ratio
                )
                self.offsets[i] = joint.coupled.offset

    def mass_matrix(self, q: Vector) -> Matrix:
        """Return the inertia matrix of the joints, (n_joints, n_joints) [kg m²], at the angles in
        q.
        """
        diagonal = ca.diag(self.inertias()[: self.n_joints])
        return diagonal if self.chain is None else diagonal + self.chain.mass_matrix(q)

    def moving_forces(self, q: Vector, v: Vector, a: Vector) -> Vector:
        """Return the torques that a motion of the joints needs, (n_joints,) [N m]: J a, and for a
        chain also M a + Coriolis torques + gravity.

        Coordinates q and velocities v are of all bodies, accelerations a, (n_joints,) [rad/s²], of
        the joints. Gravity of a joint that carries no other is among `passive_forces`.
        """
        own = self.inertias()[: self.n_joints] * a
        return own if self.chain is None else own + self.chain.torques(q, v, a)

    def passive_forces(self, q: Vector) -> Vector:
        """Return the torques of springs and gravity on the joints, then those of cogging on the
        drives, at q, (n_bodies,) [N m].

        Gravity of a chain's links is among `moving_forces`.
        """
        forces = [self._passive_torque(i, joint, q) for i, joint in enumerate(self.rig.joints)]
        return ca.vertcat(*forces, *(self._cogging(i, q) for i in range(self.n_drives)))

    def _cogging(self, drive: int, q: Vector) -> Scalar:
        part = self.rig.drives[drive]
        p = self.parameters
        path = f"drives.{drive}.cogging"
        if part.kind != "capstan" or part.cogging is None:
            return ca.SX(0)
        phase = part.cogging.periods * q[self.n_joints + drive]
        return p[f"{path}.cosine"] * ca.cos(phase) + p[f"{path}.sine"] * ca.sin(phase)

    def passive_springs(self, q: Vector) -> Matrix:
        """Return the torque of each joint's return springs at q, and their stiffness there,
        (n_joints, 2) [N m, N m/rad].
        """
        at = ca.SX.sym("q", self.n_bodies)
        joints = enumerate(self.rig.joints)
        torques = ca.vertcat(*(self._spring_torque(i, joint, at) for i, joint in joints))
        stiffness = -ca.diag(ca.jacobian(torques, at[: self.n_joints]))
        return ca.substitute(ca.horzcat(torques, stiffness), at, q)

    def _spring_torque(self, index: int, joint: Joint, q: Vector) -> Scalar:
        """Return the torque [N m] of a joint's return springs: −(k x + k₂ x² + k₃ x³) with x = θ −
        rest angle, and that of its extension spring.

        This is a spring between two points, r from the axis on the link and R from it on the base.
        Its length is L² = r² + R² − 2 r R cos x with x = θ − line angle, its torque −F dL/dθ with
        dL/dθ = r R sin x/L. F = max(preload + k (L − free length), 0): its coils open at the free
        length with the force `preload`.
        """
        p = self.parameters
        path = f"joints.{index}"
        torque = ca.SX(0)
        if joint.spring is not None:
            away = q[index] - p[f"{path}.spring.rest_angle"]
            linear, quadratic, cubic = (
                p[f"{path}.spring.{name}"] for name in ("stiffness", "quadratic", "cubic")
            )
            torque += -away * (linear + away * (quadratic + away * cubic))
        if joint.extension_spring is not None:
            spring = f"{path}.extension_spring"
            radius, distance, angle = (
                p[f"{spring}.{name}"] for name in ("radius", "distance", "line_angle")
            )
            away = q[index] - angle
            square = radius**2 + distance**2 - 2 * radius * distance * ca.cos(away)
            length = ca.sqrt(ca.fmax(square, SHORTEST_SPRING**2))
            stretch = p[f"{spring}.stiffness"] * (length - p[f"{spring}.free_length"])
            force = ca.fmax(p[f"{spring}.preload"] + stretch, 0)
            torque += -force * radius * distance * ca.sin(away) / length
        return torque

    def _passive_torque(self, index: int, joint: Joint, q: Vector) -> Scalar:
        p = self.parameters
        path = f"joints.{index}"
        torque = self._spring_torque(index, joint, q)
        if self._lone is not None:
            torque -= self._lone.torques(q, ca.SX.zeros(1), ca.SX.zeros(1))[0]
        if joint.gravity is not None:
            moment = p[f"{path}.gravity.mass"] * GRAVITY * p[f"{path}.gravity.distance"]
            torque -= moment * ca.sin(q[index] - p[f"{path}.gravity.hanging_angle"])
        return torque

    def friction_limits(
        self, q: Vector, v: Vector, tensions: Vector, at_drives: Vector | None = None
    ) -> list[Limit]:
        """Return the Coulomb friction limits of all bodies: equations (12) and (13), reconstructed,
        in their general form.

        At a joint the limit is μ r_a (T0 + Σ T). At a drive it is constant + load · R Σ T, and the
        friction along its tendons' paths (`capstan_limit`), whose wrap angles may change with q.
        Each is multiplied by Stribeck's factor at the velocities v, where a body has one. The
        `tensions` are those at the joints, `at_drives` those at the drives, by default the same.
        """
        limits = []
        p = self.parameters
        for i, body in enumerate(self.bodies):
            if i < self.n_joints:
                limit = axle_limit(
                    p,
                    f"{body.path}.friction",
                    sum(tensions[t] for t, joints in enumerate(self.joints_of) if i in joints),
                )
            else:
                limit = self._drive_friction(i, tensions if at_drives is None else at_drives)
            name = f"{body.path}.friction.stribeck"
            if f"{name}.excess" in p:
                limit = limit.times(stribeck(v[i], p[f"{name}.excess"], p[f"{name}.speed"]))
            limits.append(limit)
        return limits

    def _drive_friction(self, body: int, tensions: Vector) -> Limit:
        """Return the friction limits of a drive: its own friction, and that along the paths of its
        tendons.
        """
        limit = self._dry_friction(body, "friction", tensions)
        up = limit
        down = limit
        for i in self.pulled_by(body):
            wrapped = self.wrapped(i)
            if ca.SX(wrapped).is_zero() or self.sheath(i) is not None:
                continue
            out = self.parameters[f"tendons.{i}.path.let_out"]
            rubs = capstan_limit(tensions[i], wrapped, out).times(self.lever(body))
            # a capstan's positive angle lets out the tendons of side −1
            drawn_in, let_out = (rubs.up, rubs.down) if self.winds(i) > 0 else (rubs.down, rubs.up)
            up = up + drawn_in
            down = down + let_out
        return Limit(up, down)

    def _dry_friction(self, body: int, kind: str, tensions: Vector) -> Scalar:
        """Return constant + load · R Σ T of a drive's friction or hysteresis."""
        p = self.parameters
        path = f"{self.bodies[body].path}.{kind}"
        tension = sum(tensions[i] for i in self.pulled_by(body))
        return p[f"{path}.constant"] + p[f"{path}.load"] * self.lever(body) * tension

    def hysteresis_limit(self, drive: int, q: Vector, tensions: Vector) -> Scalar:
        """Return the limit h = (constant + load · R Σ T)(1 + slope · θ) ≥ 0 of the hysteresis in a
        drive's transmission at q.

        The index `drive` counts the drives alone; T are the `tensions`.
        """
        body = self.n_joints + drive
        limit = self._dry_friction(body, "hysteresis", tensions)
        slope = self.parameters[f"drives.{drive}.hysteresis.slope"]
        return ca.fmax(limit * (1 + slope * q[self.joints_of[self.pulled_by(body)[0]][0]]), 0)

    def inertias(self) -> Vector:
        """Return the mass or moment of inertia of each body, (n_bodies,) [kg m², kg]. Links of a
        chain are not among them; see `mass_matrix`.
        """
        p = self.parameters
        inertias = [
            p[f"{b.path}.mass" if f"{b.path}.mass" in p else f"{b.path}.inertia"]
            for b in self.bodies
        ]
        if self._lone is not None:
            inertias[0] += self._lone.mass_matrix(ca.SX.zeros(1))[0, 0]
        return ca.vertcat(*inertias)

    def stop(self, body: int) -> tuple[Scalar, ...]:
        """Return stiffness [N m/rad, N/m], damping [N m s/rad, kg/s], low and high end [rad, m] of
        the stops of a body.
        """
        names = ("stop_stiffness", "stop_damping", "stops.low", "stops.high")
        return tuple(self.parameters[f"{self.bodies[body].path}.{name}"] for name in names)

    def dampings(self) -> Vector:
        """Return the viscous damping of each body, (n_bodies,) [N m s/rad, kg/s]."""
        return ca.vertcat(*(self.parameters[f"{b.path}.damping"] for b in self.bodies))


class Moment:
    """The motion of a mechanism at one moment.

    Args:
        q: coordinates, (n_bodies,) [rad, m].
        v: their rates, (n_bodies,).
        tensions: of the tendons, (n_tendons,) [N].
        efforts: external torques on the joints, then what the drives exert, (n_bodies,) [N m, N].
    """

    def __init__(
        self, mechanism: Mechanism, q: Vector, v: Vector, tensions: Vector, efforts: Vector
    ) -> None:
        nj = mechanism.n_joints
        self._rig = mechanism.rig
        self._motion = Motion(
            angles=q[:nj],
            torques=efforts[:nj],
            positions=q[nj:],
            rates=v[nj:],
            efforts=efforts[nj:],
            tensions=tensions,
        )

    def read(self, sensor: Sensor) -> Scalar:
        """Return what a sensor without errors reads [SI]."""
        return measurand_of(sensor).read(sensor, self._motion, part_of(sensor, self._rig))
