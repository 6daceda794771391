"""The position of a drive that no sensor measures; the drive's force tells of it."""

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
"""Random walk of a drive's position that nothing measures, in its travel [1/√s]: the drive may
cross it within a second. Source: judgement.
"""


@dataclass(frozen=True)
class UnmeasuredPosition(OfDrive):
    """The position s of a drive without a position sensor: anywhere on its travel at first; then it
    walks.
    """

    quantity: ClassVar[str] = "position"
    kind: ClassVar[StateKind] = StateKind.POSITION

    @cached_property
    def _travel(self) -> tuple[float, float]:
        return drive_travel(self.context.mechanism.rig, self.drive)

    @property
    def means(self) -> Floats:
        """Prior mean: the middle of the travel [m, rad]."""
        return np.array([sum(self._travel) / 2])

    @property
    def stds(self) -> Floats:
        """Prior standard deviation: that of a uniform distribution over the travel [m, rad]."""
        low, high = self._travel
        return np.array([(high - low) / np.sqrt(12.0)])

    @property
    def walk(self) -> float:
        """Random walk: `POSITION_WALK` travels per √s."""
        low, high = self._travel
        return (high - low) * POSITION_WALK

    def position(self, drive: int, values: Vector) -> Scalar | None:
        """Return s [m, rad] if it is that of this drive, else None."""
        return values[0] if drive == self.drive else None


def unmeasured_positions(context: FilterContext) -> list[State]:
    """Return a block for each drive without a position sensor."""
    return [
        UnmeasuredPosition(context, i)
        for i in range(context.n_drives)
        if context.position_sensor(i) is None
    ]
