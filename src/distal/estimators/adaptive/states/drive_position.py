"""The position of a drive that no sensor measures: its force tells of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.state import OfDrive, State
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar, Vector
from distal.rig import drive_travel

POSITION_WALK = 1.0
"""Random walk of a drive's position that nothing measures, in its travel per √s: it may cross it
within a second.
"""


@dataclass(frozen=True)
class UnmeasuredPosition(OfDrive):
    """s of a drive without a position sensor: anywhere on its travel, and it walks."""

    quantity: ClassVar[str] = "position"
    kind: ClassVar[StateKind] = StateKind.POSITION

    @cached_property
    def _travel(self) -> tuple[float, float]:
        return drive_travel(self.context.mechanism.rig, self.drive)

    @property
    def means(self) -> Floats:
        """The middle of the travel [m, rad]."""
        return np.array([sum(self._travel) / 2])

    @property
    def stds(self) -> Floats:
        """That of a uniform distribution over the travel [m, rad]."""
        low, high = self._travel
        return np.array([(high - low) / np.sqrt(12.0)])

    @property
    def walk(self) -> float:
        """`PLACE_WALK` travels per √s."""
        low, high = self._travel
        return (high - low) * POSITION_WALK

    def position(self, drive: int, values: Vector) -> Scalar | None:
        """Return s where it is this drive's [m, rad]."""
        return values[0] if drive == self.drive else None


def unmeasured_positions(context: FilterContext) -> list[State]:
    """Return a block for each drive without a position sensor."""
    return [
        UnmeasuredPosition(context, i)
        for i in range(context.n_drives)
        if context.position_sensor(i) is None
    ]
