"""The angle of a joint: a reference."""

from __future__ import annotations

from collections.abc import Mapping

from distal.expressions import Scalar
from distal.rig.sensors.base import SensorBase
from distal.rig.sensors.measurand import Measurand, Motion, Parts, Role


class Angle(Measurand):
    """The angle θ of a joint [rad]."""

    name = "angle"
    of = "joints"
    role = Role.REFERENCE
    si = "rad"

    def read(
        self, sensor: SensorBase, motion: Motion, part: int, unknowns: Mapping[str, Scalar]
    ) -> Scalar:
        """Return the angle of the joint."""
        return motion.angle(part)

    def travel(self, sensor: SensorBase, rig: Parts, part: int) -> tuple[float, float]:
        """Return the range that the joint turns in."""
        return rig.joints[part].travel
