"""The effort of a drive: the force of a slider, the torque of a capstan."""

from __future__ import annotations

from collections.abc import Mapping

from distal.expressions import Scalar
from distal.rig.drives import effort_unit
from distal.rig.sensors.base import SensorBase
from distal.rig.sensors.measurand import Measurand, Motion, Part, Parts, Role


class Force(Measurand):
    """The effort of a drive: force U of a slider [N], torque τ of a capstan's motor [N m]."""

    name = "force"
    of = "drives"
    role = Role.EFFORT

    def unit(self, part: Part) -> str:
        """Return N or N m."""
        return effort_unit(part)  # type: ignore[arg-type]

    def read(
        self, sensor: SensorBase, motion: Motion, part: int, unknowns: Mapping[str, Scalar]
    ) -> Scalar:
        """Return the effort of the drive."""
        return motion.effort(part)

    def travel(self, sensor: SensorBase, rig: Parts, part: int) -> tuple[float, float]:
        """Return the range of likely efforts: from 0 to `largest_effort` of a slider, the same to
        both sides of a capstan.
        """
        largest = largest_effort(rig, part)
        return (-largest, largest) if rig.drives[part].kind == "capstan" else (0.0, largest)


def largest_effort(rig: Parts, drive: int) -> float:
    """Return the largest effort that a drive is likely to exert [N, N m]: its limit; without one
    twice its nominal force or twice the pretensions of its tendons, whichever is larger.

    Without a limit it is at least `LEAST`, so that the range of a sensor is never empty.
    """
    part = rig.drives[drive]
    if part.limit is not None:
        return part.limit
    lever = part.radius.value if part.kind == "capstan" else 1.0
    pretension = sum(tendon.pretension.value for tendon in rig.tendons if tendon.drive == part.name)
    return max(2.0 * abs(part.nominal_force.value), 2.0 * pretension * lever, LEAST * lever)


LEAST = 1.0
"""Smallest force up to which the range of a force sensor reaches [N]. Source: judgement."""
