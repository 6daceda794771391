"""The forces of a rig, from one length function per tendon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from distal.model.friction import load_dependent_limit
from distal.model.geometry import angle_at, elongation
from distal.model.parameters import Parameters
from distal.rig import Joint, Rig

GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s²]."""


@dataclass(frozen=True)
class Body:
    """A joint or a drive as the time step sees it: a coordinate with inertia, damping, friction and stops."""

    path: str
    name: str
    is_joint: bool
    has_stops: bool


class Mechanism:
    """The general form of a tendon-driven rig: coordinates q = (joint angles, drive displacements) and their rates v.

        stretch  δ_i = ℓ_i(q) − ℓ_i⁰,   tension  T_i = max(k_i δ_i + c_i δ̇_i, 0) for δ_i > 0, else 0
        joints:  J θ̈ + b θ̇ + friction(θ̇, T) = −(∂ℓ/∂θ)ᵀ T + spring + gravity + τ_ext
        drives:  m s̈ + b ṡ + friction(ṡ, T) = −(∂ℓ/∂s)ᵀ T + U − F_stop(s)

    On the paper's rig the virtual work −(∂ℓ/∂q)ᵀT gives its equations (2), (3), (10) and (11), with the mend that
    (11) has "+": cos θ cos φ2 + sin θ sin φ2. Mend: tension has a max(·, 0) (8, 9); a thread cannot push.

    Args:
        rig: the description.
    """

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.parameters = Parameters(rig)
        self.bodies = tuple(
            Body(f"{kind}.{i}", part.name, kind == "joints", part.stops is not None)
            for kind in ("joints", "drives")
            for i, part in enumerate(getattr(rig, kind))
        )
        self.n_joints, self.n_drives, self.n_tendons = len(rig.joints), len(rig.drives), len(rig.tendons)
        self.n_bodies = len(self.bodies)
        joints = {joint.name: i for i, joint in enumerate(rig.joints)}
        drives = {drive.name: self.n_joints + i for i, drive in enumerate(rig.drives)}
        self.joint_of = tuple(joints[tendon.joint] for tendon in rig.tendons)
        self.drive_of = tuple(drives[tendon.drive] for tendon in rig.tendons)

    def displacement(self, tendon: int, q: Any) -> Any:
        """Return the displacement [m] of a tendon's proximal end: the slider's, or side · R φ of a capstan.

        Args:
            tendon: its index.
            q: coordinates, (n_bodies,) [rad, m].
        """
        drive = self.drive_of[tendon]
        radius = f"{self.bodies[drive].path}.radius"
        if radius in self.parameters:
            return self.rig.tendons[tendon].side * self.parameters[radius] * q[drive]
        return q[drive]

    def elongations(self, q: Any) -> Any:
        """Return ℓ_i(q) − l_i of all tendons, (n_tendons,) [m]."""
        lengths = []
        for i in range(self.n_tendons):
            kind, side, radius, free_length = self._insertion(i)
            lengths.append(elongation(kind, q[self.joint_of[i]], self.displacement(i, q), side, radius, free_length))
        return ca.vertcat(*lengths)

    def angle_at(self, tendon: int, elongated: Any, q: Any) -> Any:
        """Return the joint angle [rad] at which tendon `tendon` has ℓ − l = `elongated`, at the drives' place in q.

        Args:
            tendon: its index.
            elongated: ℓ − l [m].
            q: coordinates, (n_bodies,); the joint's own is not used.
        """
        kind, *sizes = self._insertion(tendon)
        return angle_at(kind, elongated, self.displacement(tendon, q), *sizes)

    def _insertion(self, tendon: int) -> tuple[Any, ...]:
        part, p = self.rig.tendons[tendon], self.parameters
        path = f"tendons.{tendon}.insertion"
        length = p[f"{path}.free_length"] if part.insertion.kind == "pinned" else None
        return part.insertion.kind, part.side, p[f"{path}.radius"], length

    def length_jacobian(self, q: Any) -> Any:
        """Return ∂ℓ/∂q, (n_tendons, n_bodies): the moment arms, with minus the sign of the torque."""
        symbols = ca.SX.sym("q", self.n_bodies)
        jacobian = ca.Function(
            "jacobian", [symbols, self.parameters.symbols], [ca.jacobian(self.elongations(symbols), symbols)]
        )
        return jacobian(q, self.parameters.symbols)

    def tensions(self, q: Any, v: Any) -> Any:
        """Return T_i = max(k δ + T_pre + c δ̇, 0) of all tendons, zero where slack, (n_tendons,) [N].

        Equations (8) and (9) with the mend max(·, 0), in the general form with damping and pre-tension.

        Args:
            q: coordinates, (n_bodies,) [rad, m].
            v: velocities, (n_bodies,).
        """
        p, stretched = self.parameters, self.elongations(q)
        rates = ca.mtimes(self.length_jacobian(q), v)
        tensions = []
        for i in range(self.n_tendons):
            path = f"tendons.{i}"
            elastic = p[f"{path}.stiffness"] * stretched[i] + p[f"{path}.pretension"]
            if p.has(f"{path}.damping"):
                damped = ca.fmax(elastic + p[f"{path}.damping"] * rates[i], 0)
                tensions.append(ca.if_else(elastic > 0, damped, 0))
            else:
                tensions.append(ca.fmax(elastic, 0))
        return ca.vertcat(*tensions)

    def tendon_damping(self, q: Any, tensions: Any) -> Any:
        """Return Σ c (∂ℓ/∂q_j)² over the taut tendons, (n_bodies,): each body's own part of the tendons' damping.

        Args:
            q: coordinates, (n_bodies,) [rad, m].
            tensions: of all tendons [N], (n_tendons,).
        """
        jacobian = self.length_jacobian(q)
        total = ca.SX(self.n_bodies, 1)
        for i in range(self.n_tendons):
            if self.parameters.has(f"tendons.{i}.damping"):
                taut = ca.if_else(tensions[i] > 0, self.parameters[f"tendons.{i}.damping"], 0)
                total += taut * (jacobian[i, :] ** 2).T
        return total

    def passive_forces(self, q: Any) -> Any:
        """Return what springs and gravity add at the joints, (n_bodies,) [N m]; zero at the drives."""
        forces = [self._passive_torque(i, joint, q) for i, joint in enumerate(self.rig.joints)]
        return ca.vertcat(*forces, ca.SX(self.n_drives, 1))

    def _passive_torque(self, index: int, joint: Joint, q: Any) -> Any:
        p, path, torque = self.parameters, f"joints.{index}", ca.SX(0)
        if joint.spring is not None:
            torque -= p[f"{path}.spring.stiffness"] * (q[index] - p[f"{path}.spring.rest_angle"])
        if joint.gravity is not None:
            moment = p[f"{path}.gravity.mass"] * GRAVITY * p[f"{path}.gravity.distance"]
            torque -= moment * ca.sin(q[index] - p[f"{path}.gravity.hanging_angle"])
        return torque

    def friction_limits(self, tensions: Any) -> Any:
        """Return the Coulomb limits of all bodies, (n_bodies,): equations (12) and (13), reconstructed, general form."""
        return ca.vertcat(*(self._friction_limit(i, tensions) for i in range(self.n_bodies)))

    def _friction_limit(self, body: int, tensions: Any) -> Any:
        p, path = self.parameters, self.bodies[body].path
        if self.bodies[body].is_joint:
            if f"{path}.friction.coefficient" not in p:
                return ca.SX(0)
            tension = sum((tensions[i] for i in range(self.n_tendons) if self.joint_of[i] == body), ca.SX(0))
            return load_dependent_limit(
                p[f"{path}.friction.coefficient"],
                p[f"{path}.friction.radius"],
                p[f"{path}.friction.preload"] + tension,
                p[f"{path}.friction.reference"],
                p[f"{path}.friction.exponent"],
            )
        tension = sum((tensions[i] for i in range(self.n_tendons) if self.drive_of[i] == body), ca.SX(0))
        lever = self._drive_radius(body)
        return p[f"{path}.friction.constant"] + p[f"{path}.friction.load"] * lever * tension

    def _drive_radius(self, body: int) -> Any:
        """Return the capstan's radius, or 1 for a slider."""
        path = f"{self.bodies[body].path}.radius"
        return self.parameters[path] if path in self.parameters else ca.SX(1)

    def inertias(self) -> Any:
        """Return mass or moment of inertia of all bodies, (n_bodies,)."""
        return ca.vertcat(
            *(
                self.parameters[f"{b.path}.mass" if f"{b.path}.mass" in self.parameters else f"{b.path}.inertia"]
                for b in self.bodies
            )
        )

    def dampings(self) -> Any:
        """Return the viscous damping of all bodies, (n_bodies,)."""
        return ca.vertcat(*(self.parameters[f"{b.path}.damping"] for b in self.bodies))
