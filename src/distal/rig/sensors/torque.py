"""The external torque on a joint: a reference."""

from __future__ import annotations

from collections.abc import Mapping

from distal.expressions import Scalar
from distal.rig.sensors.base import SensorBase
from distal.rig.sensors.measurand import Measurand, Motion, Parts, Role

WIDEST = 3.0
"""Half-width of the range of a torque sensor in stds of the external torque [1]. Source:
judgement.
"""

LEAST = 0.01
"""Smallest half-width of the range of a torque sensor [N m]. Source: judgement."""


class Torque(Measurand):
    """The external torque τ_ext on a joint [N m]."""

    name = "torque"
    of = "joints"
    role = Role.REFERENCE
    si = "N m"

    def read(
        self, sensor: SensorBase, motion: Motion, part: int, unknowns: Mapping[str, Scalar]
    ) -> Scalar:
        """Return the external torque."""
        return motion.torque(part)

    def travel(self, sensor: SensorBase, rig: Parts, part: int) -> tuple[float, float]:
        """Return ± `WIDEST` stds of the external torque by the rig, at least ± `LEAST`."""
        largest = max(WIDEST * rig.joints[part].external_torque.std, LEAST)
        return -largest, largest
