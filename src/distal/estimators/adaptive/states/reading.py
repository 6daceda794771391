"""What a reading depends on and nobody knows for certain, such as the angle at which an IMU is
mounted.
"""

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
    """A number that one or several readings depend on and ask for by its name; it stays."""

    lasting: ClassVar[bool] = True

    name: str
    number: Parameter

    @property
    def names(self) -> tuple[str, ...]:
        """Its name, (1,)."""
        return (self.name,)

    @property
    def means(self) -> Floats:
        """The rig's value."""
        return np.array([self.number.value])

    @property
    def stds(self) -> Floats:
        """The rig's std."""
        return np.array([self.number.filter_std])

    def unknowns(self, values: Vector) -> dict[str, Scalar]:
        """Return the number by its name."""
        return {self.name: values[0]}


def unknowns_of_readings(context: FilterContext) -> list[State]:
    """Return a block for each number that readings depend on and whose std is not zero; sensors
    share those of one name.
    """
    unknowns = [unknown for s in context.channels.others for unknown in measurand_of(s).unknowns(s)]
    values = {
        unknown.name: unknown.number for unknown in unknowns if unknown.number.filter_std > 0.0
    }
    return [UnknownOfReading(name, number) for name, number in values.items()]
