"""What a drive exerts: of a slider a force, of a capstan a torque."""

from __future__ import annotations

from collections.abc import Mapping

from distal.expressions import Scalar
from distal.rig.drives import Capstan, effort_unit
from distal.rig.sensors.base import SensorBase
from distal.rig.sensors.measurand import Measurand, Motion, Part, Parts, Role


class Force(Measurand):
    """U of a slider [N], τ of a capstan's motor [N m]."""

    name = "force"
    of = "drives"
    role = Role.EFFORT

    def unit(self, part: Part) -> str:
        """Return N or N m."""
        return effort_unit(part)  # type: ignore[arg-type]

    def letter(self, part: Part) -> str:
        """Return τ of a capstan, else U."""
        return "τ" if isinstance(part, Capstan) else "U"

    def read(
        self, sensor: SensorBase, motion: Motion, part: int, unknowns: Mapping[str, Scalar]
    ) -> Scalar:
        """Return what the drive exerts."""
        return motion.effort(part)

    def travel(self, sensor: SensorBase, rig: Parts, part: int) -> tuple[float, float]:
        """Return from no force to the largest that is likely; a capstan's motor turns both ways."""
        largest = largest_effort(rig, part)
        return (-largest, largest) if rig.drives[part].kind == "capstan" else (0.0, largest)


def largest_effort(rig: Parts, drive: int) -> float:
    """Return the largest effort that a drive is likely to exert: its limit, else twice what
    stretches its tendons at rest.

    At least `LEAST`: a sensor's range is never empty.
    """
    part = rig.drives[drive]
    if part.limit is not None:
        return part.limit
    lever = part.radius.value if part.kind == "capstan" else 1.0
    pretension = sum(tendon.pretension.value for tendon in rig.tendons if tendon.drive == part.name)
    return max(2.0 * abs(part.nominal_force.value), 2.0 * pretension * lever, LEAST * lever)


LEAST = 1.0
"""The range of a force sensor is at least this [N]."""
