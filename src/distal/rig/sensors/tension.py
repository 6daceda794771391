"""The tension of a tendon."""

from __future__ import annotations

from collections.abc import Mapping

from distal.expressions import Scalar
from distal.rig.sensors.base import SensorBase
from distal.rig.sensors.force import largest_effort
from distal.rig.sensors.measurand import Measurand, Motion, Parts, Role


class Tension(Measurand):
    """The tension T of a tendon at the joint's end of its path [N]."""

    name = "tension"
    of = "tendons"
    role = Role.TENSION
    si = "N"

    def read(
        self, sensor: SensorBase, motion: Motion, part: int, unknowns: Mapping[str, Scalar]
    ) -> Scalar:
        """Return the tension of the tendon."""
        return motion.tension(part)

    def travel(self, sensor: SensorBase, rig: Parts, part: int) -> tuple[float, float]:
        """Return the range from slack, 0, to the largest force with which the drive is likely to
        pull [N].
        """
        drive = next(
            i for i, drive in enumerate(rig.drives) if drive.name == rig.tendons[part].drive
        )
        moved = rig.drives[drive]
        return 0.0, largest_effort(rig, drive) / (
            moved.radius.value if moved.kind == "capstan" else 1.0
        )
