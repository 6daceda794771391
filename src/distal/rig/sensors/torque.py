"""The torque on a joint from outside: a reference."""

from __future__ import annotations

from collections.abc import Mapping

from distal.expressions import Scalar
from distal.rig.sensors.base import SensorBase
from distal.rig.sensors.measurand import Measurand, Motion, Parts, Role

WIDEST = 3.0
"""A torque from outside is within so many of its standard deviations."""

LEAST = 0.01
"""The range of a torque sensor reaches at least this far either way [N m]."""


class Torque(Measurand):
    """τ_ext on a joint [N m]."""

    name = "torque"
    of = "joints"
    role = Role.REFERENCE
    si = "N m"
    badge = "τ"

    def read(
        self, sensor: SensorBase, motion: Motion, part: int, unknowns: Mapping[str, Scalar]
    ) -> Scalar:
        """Return the torque."""
        return motion.torque(part)

    def travel(self, sensor: SensorBase, rig: Parts, part: int) -> tuple[float, float]:
        """Return `WIDEST` of the stds that the rig gives the torque, either way."""
        largest = max(WIDEST * rig.joints[part].external_torque.std, LEAST)
        return -largest, largest
