"""The forces of a rig, from one length function per tendon."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from distal.model.elasticity import extension_torque, polynomial_torque, stretched
from distal.model.friction import Limit, capstan_limit, load_dependent_limit, stribeck
from distal.model.geometry import Insertion, angle_at, elongation
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
        given: numbers of the description that stay inputs whatever their values; see `Parameters`.
    """

    def __init__(self, rig: Rig, given: Sequence[str] = ()) -> None:
        self.rig = rig
        self.parameters = Parameters(rig, given)
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
            lengths.append(elongation(self._insertion(i), q[self.joint_of[i]], self.displacement(i, q)))
        return ca.vertcat(*lengths)

    def angle_at(self, tendon: int, elongated: Any, q: Any) -> Any:
        """Return the joint angle [rad] at which tendon `tendon` has ℓ − l = `elongated`, at the drives' place in q.

        Args:
            tendon: its index.
            elongated: ℓ − l [m].
            q: coordinates, (n_bodies,); the joint's own is not used.
        """
        return angle_at(self._insertion(tendon), elongated, self.displacement(tendon, q))

    def _insertion(self, tendon: int) -> Insertion:
        part, p = self.rig.tendons[tendon], self.parameters
        path, kind = f"tendons.{tendon}.insertion", part.insertion.kind
        length = p[f"{path}.free_length"] if kind == "pinned" else None
        shape = tuple(p[f"{path}.{name}"] for name in ("centre", "slope", "curvature")) if kind == "linkage" else ()
        return Insertion(kind, part.side, p[f"{path}.radius"], length, shape)

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
        p, elastic = self.parameters, self.elastic_forces(q)
        rates = ca.mtimes(self.length_jacobian(q), v)
        tensions = []
        for i in range(self.n_tendons):
            path = f"tendons.{i}"
            if p.has(f"{path}.damping"):
                damped = elastic[i] + p[f"{path}.damping"] * rates[i]
                tensions.append(ca.if_else(ca.logic_and(elastic[i] > 0, damped > 0), damped, 0))
            else:
                tensions.append(ca.if_else(elastic[i] > 0, elastic[i], 0))
        return ca.vertcat(*tensions)

    def elastic_forces(self, q: Any) -> Any:
        """Return T_pre + k δ of all tendons, (n_tendons,) [N], negative where slack; with stiffening, see `stretched`.

        Args:
            q: coordinates, (n_bodies,) [rad, m].
        """
        p, elongated, forces = self.parameters, self.elongations(q), []
        for i in range(self.n_tendons):
            path, stretch = f"tendons.{i}", elongated[i]
            if p.has(f"{path}.slack"):
                stretch = stretch - p[f"{path}.slack"]
            if p.has(f"{path}.stiffening"):
                stretch = stretched(stretch, p[f"{path}.stiffening"])
            forces.append(p[f"{path}.stiffness"] * stretch + p[f"{path}.pretension"])
        return ca.vertcat(*forces)

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
            away = q[index] - p[f"{path}.spring.rest_angle"]
            parts = [p[f"{path}.spring.{name}"] for name in ("stiffness", "quadratic", "cubic")]
            torque += polynomial_torque(away, *parts)
        if joint.extension_spring is not None:
            spring = f"{path}.extension_spring"
            parts = [p[f"{spring}.{name}"] for name in ("stiffness", "free_length", "radius", "distance", "preload")]
            torque += extension_torque(q[index] - p[f"{spring}.line_angle"], *parts)
        if joint.gravity is not None:
            moment = p[f"{path}.gravity.mass"] * GRAVITY * p[f"{path}.gravity.distance"]
            torque -= moment * ca.sin(q[index] - p[f"{path}.gravity.hanging_angle"])
        return torque

    def friction_limits(self, q: Any, v: Any, tensions: Any) -> list[Limit]:
        """Return the Coulomb limits of all bodies: equations (12) and (13), reconstructed, in their general form.

        At the joint μ r_a (T0 + Σ T); at a drive constant + load · R Σ T, and the friction along its tendons' paths
        (`capstan_limit`); each times Stribeck's factor where it is given.

        Args:
            q: coordinates, (n_bodies,) [rad, m].
            v: velocities, (n_bodies,).
            tensions: of all tendons, (n_tendons,) [N].
        """
        limits = []
        for i, body in enumerate(self.bodies):
            limit = self._joint_friction(i, tensions) if body.is_joint else self._drive_friction(i, q, tensions)
            name = f"{body.path}.friction.stribeck"
            if f"{name}.excess" in self.parameters:
                p = self.parameters
                limit = limit.times(stribeck(v[i], p[f"{name}.excess"], p[f"{name}.speed"]))
            limits.append(limit)
        return limits

    def _joint_friction(self, body: int, tensions: Any) -> Limit:
        p, path = self.parameters, self.bodies[body].path
        if f"{path}.friction.coefficient" not in p:
            return Limit(ca.SX(0), ca.SX(0))
        tension = sum((tensions[i] for i in range(self.n_tendons) if self.joint_of[i] == body), ca.SX(0))
        limit = load_dependent_limit(
            p[f"{path}.friction.coefficient"],
            p[f"{path}.friction.radius"],
            p[f"{path}.friction.preload"] + tension,
            p[f"{path}.friction.reference"],
            p[f"{path}.friction.exponent"],
        )
        return Limit(limit, limit)

    def _drive_friction(self, body: int, q: Any, tensions: Any) -> Limit:
        """Return friction of the drive itself and along the paths of its tendons, drawn in or let out."""
        p, path = self.parameters, self.bodies[body].path
        own = [i for i in range(self.n_tendons) if self.drive_of[i] == body]
        lever = self._drive_radius(body)
        tension = sum((tensions[i] for i in own), ca.SX(0))
        limit = p[f"{path}.friction.constant"] + p[f"{path}.friction.load"] * lever * tension
        up, down = limit, limit
        for i in own:
            name = f"tendons.{i}.path"
            if not p.has(f"{name}.friction"):
                continue
            wrap = p[f"{name}.wrap"] + p[f"{name}.wrap_slope"] * q[self.joint_of[i]]
            path_friction = capstan_limit(tensions[i], p[f"{name}.friction"], ca.fmax(wrap, 0)).times(lever)
            # a capstan's positive angle lets out the tendons of side −1
            drawn = self.rig.tendons[i].side if self.rig.drives[body - self.n_joints].kind == "capstan" else 1
            drawn_in, let_out = path_friction.up, path_friction.down
            up, down = (up + drawn_in, down + let_out) if drawn > 0 else (up + let_out, down + drawn_in)
        return Limit(up, down)

    def stretch(self, drive: int, q: Any) -> Any:
        """Return the stretch of a drive's tendons in the drive's own coordinate, Σ h_i ℓ_i/Σ h_i², h_i = ∂ℓ_i/∂s.

        For a capstan with two pulleys it is φ − r θ/R, for a slider with one tendon ℓ.

        Args:
            drive: its index among the drives.
            q: coordinates, (n_bodies,) [rad, m].
        """
        body, elongations = self.n_joints + drive, self.elongations(q)
        levers = self.length_jacobian(q)[:, body]
        own = [i for i in range(self.n_tendons) if self.drive_of[i] == body]
        total = sum((levers[i] * elongations[i] for i in own), ca.SX(0))
        return total / sum((levers[i] ** 2 for i in own), ca.SX(0))

    def hysteresis_limit(self, drive: int, q: Any, tensions: Any) -> Any:
        """Return the limit h = (constant + load · R Σ T)(1 + slope · θ) of the play in a drive's transmission, ≥ 0.

        Args:
            drive: its index among the drives.
            q: coordinates, (n_bodies,) [rad, m].
            tensions: of all tendons, (n_tendons,) [N].
        """
        p, body = self.parameters, self.n_joints + drive
        path = f"{self.bodies[body].path}.hysteresis"
        own = [i for i in range(self.n_tendons) if self.drive_of[i] == body]
        tension = sum((tensions[i] for i in own), ca.SX(0))
        limit = p[f"{path}.constant"] + p[f"{path}.load"] * self._drive_radius(body) * tension
        return ca.fmax(limit * (1 + p[f"{path}.slope"] * q[self.joint_of[own[0]]]), 0)

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
