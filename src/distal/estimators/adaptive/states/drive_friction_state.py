"""Friction at a drive for which the rig declares none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.state import OfDrive, State, ZeroMean
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar, Vector
from distal.rig import Sensor
from distal.sensor_errors import variance


@dataclass(frozen=True)
class UnknownFriction(OfDrive, ZeroMean):
    """An addition to the friction limit of a drive for which the rig declares no friction.

    Its size follows the noise σ of the drive's force sensor. It is not smoothed: friction at one
    time tells little of another time (docs/explanation/adaptive-guards.md).
    """

    quantity: ClassVar[str] = "friction"
    kind: ClassVar[StateKind] = StateKind.FRICTION
    smoothed: ClassVar[bool] = False

    sensor: Sensor

    @property
    def stds(self) -> Floats:
        """Prior standard deviation: `Robustness.unknown_friction` σ [N, N m]."""
        return np.array(
            [self.context.robustness.unknown_friction * float(np.sqrt(variance(self.sensor)))]
        )

    @property
    def walk(self) -> float:
        """Random walk: `Robustness.unknown_friction_walk` σ per √s."""
        return self.context.robustness.unknown_friction_walk * float(np.sqrt(variance(self.sensor)))

    def friction(self, drive: int, values: Vector) -> Scalar:
        """Return the addition [N, N m] if it is that of this drive, else 0."""
        return values[0] if drive == self.drive else 0


def unknown_frictions(context: FilterContext) -> list[State]:
    """Return a block for each drive with a force sensor whose friction the rig does not declare."""
    blocks: list[State] = []
    for i, drive in enumerate(context.mechanism.rig.drives):
        sensor = context.force_sensor(i)
        looked_for = context.robustness.unknown_friction > 0.0 and drive.hysteresis is None
        if sensor is not None and looked_for and not context.declares_friction(i):
            blocks.append(UnknownFriction(context, i, sensor))
    return blocks
