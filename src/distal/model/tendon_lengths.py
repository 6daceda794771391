"""The lengths of a rig's tendons as functions of the joints' angles and the drives' positions."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from distal.expressions import Matrix, Scalar, Vector
from distal.model.parameters import Parameters
from distal.rig import Meeting, Polynomial, Rig, Size


@dataclass(frozen=True)
class Body:
    """A joint or a drive as the time step sees it: a coordinate with inertia, damping, friction and
    stops.
    """

    path: str
    name: str
    is_joint: bool
    has_stops: bool


class Lengths:
    """The bodies of a rig, and how long its tendons are.

    Coordinates q, (n_bodies,) [rad, m], are those of the joints, then of the drives. Elongations
    ℓ − l [m] are (n_tendons,).
    """

    def __init__(self, rig: Rig, parameters: Parameters) -> None:
        self.rig = rig
        self.parameters = parameters
        self.bodies = tuple(
            Body(f"{kind}.{i}", part.name, kind == "joints", part.stops is not None)
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
        return ca.vertcat(*(self._elongation(i, q) for i in range(self.n_tendons)))

    def _elongation(self, tendon: int, q: Vector) -> Scalar:
        """Return ℓ − l of a tendon, joint by joint: each one on its way changes what the one before
        it has left of the displacement.
        """
        left = self.displacement(tendon, q)
        for meeting in self.rig.tendons[tendon].meetings:
            angles = [q[self._joint[name]] for name in meeting.joints]
            left = meeting.shape.elongation(self._size(tendon, meeting), meeting.side, angles, left)
        return left

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
        symbols = ca.SX.sym("q", self.n_bodies)
        p = self.parameters.symbols
        jacobian = ca.Function(
            "jacobian", [symbols, p], [ca.jacobian(self.elongations(symbols), symbols)]
        )
        return jacobian(q, p)

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
        total = sum((levers[i] * elongations[i] for i in tendons), ca.SX(0))
        return total / sum((levers[i] ** 2 for i in tendons), ca.SX(0))

    def wrapped(self, tendon: int) -> Scalar:
        """Return μ β of a tendon's path, for the capstan equation."""
        if self.rig.tendons[tendon].path is None:
            return ca.SX(0)
        path = f"tendons.{tendon}.path"
        return self.parameters[f"{path}.friction"] * self.parameters[f"{path}.wrap"]
