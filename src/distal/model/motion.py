"""The motion of a mechanism at one moment, from which the sensors' readings follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from distal.expressions import Scalar, Vector
from distal.model.chain import Chain
from distal.model.mechanism import Mechanism
from distal.rig import Sensor, measurand_of, part_of


@dataclass(frozen=True)
class Moment:
    """The motion of a mechanism at one moment, as `distal.rig.sensors.Motion` asks for it.

    Args:
        q: coordinates, (n_bodies,) [rad, m].
        v: their rates, (n_bodies,).
        tensions: of the tendons, (n_tendons,) [N].
        efforts: external torques on the joints, then what the drives exert, (n_bodies,) [N m, N].
    """

    mechanism: Mechanism
    q: Vector
    v: Vector
    tensions: Vector
    efforts: Vector

    def angle(self, joint: int) -> Scalar:
        """Return a joint's angle [rad]."""
        return self.q[joint]

    def torque(self, joint: int) -> Scalar:
        """Return the external torque on a joint [N m]."""
        return self.efforts[joint]

    def position(self, drive: int) -> Scalar:
        """Return a drive's position [m, rad]."""
        return self.q[self.mechanism.n_joints + drive]

    def rate(self, drive: int) -> Scalar:
        """Return a drive's speed [m/s, rad/s]."""
        return self.v[self.mechanism.n_joints + drive]

    def effort(self, drive: int) -> Scalar:
        """Return the force or torque that a drive exerts [N, N m]."""
        return self.efforts[self.mechanism.n_joints + drive]

    def tension(self, tendon: int) -> Scalar:
        """Return a tendon's tension [N]."""
        return self.tensions[tendon]

    def turning(self, joint: int) -> Vector:
        """Return the angular velocity of a joint's link, in its own frame, (3,) [rad/s]."""
        return self._frames.turning(self.q, self.v)[joint]

    def falling(self, joint: int) -> Vector:
        """Return the acceleration of free fall in the frame of a joint's link, (3,) [m/s²]."""
        return self._frames.falling(self.q)[joint]

    def axis(self, joint: int) -> tuple[float, float, float]:
        """Return a joint's axis in its own frame, a unit vector."""
        return self.mechanism.rig.joints[joint].axis

    @property
    def _frames(self) -> Chain:
        return Chain(self.mechanism.rig, self.mechanism.parameters)

    def read(self, sensor: Sensor, unknowns: Mapping[str, Scalar] | None = None) -> Scalar:
        """Return what a sensor without errors reads [SI]. Its parameters are those of the rig, but
        for the `unknowns`, by name.
        """
        return measurand_of(sensor).read(
            sensor, self, part_of(sensor, self.mechanism.rig), unknowns or {}
        )
