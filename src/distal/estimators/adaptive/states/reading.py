"""Uncertain quantities of a reading, such as the angle at which an IMU is mounted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.state import State
from distal.expressions import Scalar, Vector
from distal.rig import Parameter, measurand_of


@dataclass(frozen=True)
class UnknownOfReading(State):
    """An uncertain quantity that one or several readings depend on, by its name; it stays."""

    lasting: ClassVar[bool] = True

    name: str
    number: Parameter

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the state, (1,)."""
        return (self.name,)

    @property
    def means(self) -> Floats:
        """Prior mean: the rig's value, (1,)."""
        return np.array([self.number.value])

    @property
    def stds(self) -> Floats:
        """Prior standard deviation: the rig's, (1,)."""
        return np.array([self.number.filter_std])

    def unknowns(self, values: Vector) -> dict[str, Scalar]:
        """Return name → the quantity."""
        return {self.name: values[0]}


def unknowns_of_readings(context: FilterContext) -> list[State]:
    """Return a block for each quantity of readings whose std is not zero; sensors share those of
    the same name.
    """
    unknowns = [unknown for s in context.channels.others for unknown in measurand_of(s).unknowns(s)]
    values = {
        unknown.name: unknown.number for unknown in unknowns if unknown.number.filter_std > 0.0
    }
    return [UnknownOfReading(name, number) for name, number in values.items()]
