"""Friction at a drive that the rig does not know of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.estimators.adaptive.setup import Setup
from distal.estimators.adaptive.states.state import State
from distal.rig import Sensor
from distal.sensors import variance

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class UnknownFriction(State):
    """What is added to the friction limit of a drive that declares none; its size follows its force sensor's noise σ.

    Args:
        setup: the rig.
        drive: index of the drive.
        sensor: of its force.
    """

    setup: Setup
    drive: int
    sensor: Sensor

    @property
    def names(self) -> tuple[str, ...]:
        """``friction_DRIVE``."""
        return (f"friction_{self.setup.mechanism.rig.drives[self.drive].name}",)

    @property
    def means(self) -> Floats:
        """None is expected [N, N m]."""
        return np.zeros(1)

    @property
    def stds(self) -> Floats:
        """`Robustness.unknown_friction` σ [N, N m]."""
        return np.array([self.setup.robustness.unknown_friction * float(np.sqrt(variance(self.sensor)))])

    @property
    def walk(self) -> float:
        """`Robustness.unknown_friction_walk` σ per √s."""
        return self.setup.robustness.unknown_friction_walk * float(np.sqrt(variance(self.sensor)))

    @property
    def smoothed(self) -> bool:
        """It is not: what the filter takes for friction at one time says little of another (docs/estimators.md)."""
        return False

    def friction(self, drive: int, own: Any) -> Any:
        """Return it where it is this drive's [N, N m].

        Args:
            drive: its index.
            own: the friction.
        """
        return own[0] if drive == self.drive else 0


def unknown_frictions(setup: Setup) -> list[State]:
    """Return a block for each drive with a force sensor whose friction the rig does not declare.

    Args:
        setup: the rig.
    """
    blocks: list[State] = []
    for i, drive in enumerate(setup.mechanism.rig.drives):
        sensor = setup.force_sensor(i)
        looked_for = setup.robustness.unknown_friction > 0.0 and drive.hysteresis is None
        if sensor is not None and looked_for and not setup.declares_friction(i):
            blocks.append(UnknownFriction(setup, i, sensor))
    return blocks
