"""The base of all kinds of states: a block of unknown values and their effects.

A block has names and a prior, says how its values fade and walk, and what they add: to the model's
parameters, to the torque on a joint, to the position of a drive, to friction, to the reading of a
sensor. The default of each is "nothing". `StateVector` joins blocks and sums up their effects.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, TypeAlias

import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar, Vector
from distal.rig import Sensor

Prior: TypeAlias = Vector | float
"""Prior means or standard deviations of a block, (k,), as expressions of what a fit varies; one
number stands for all.
"""


class Learning(Enum):
    """The share of the gain that a state takes, see `StateVector.gain_shares`."""

    AT_ONCE = "at once"
    """All of it."""

    SLOWLY = "slowly"
    """A share from forces and tensions, by `Robustness.learning_time`, and from references, by
    `reference_time`.
    """

    FROM_REFERENCES_SLOWLY = "from references slowly"
    """A share from references only: a joint that rests shows one posture for a long time."""

    AS_CREEP = "as creep"
    """A share by `Robustness.creep_learning_time`."""


@dataclass(frozen=True)
class Fading:
    """How a state fades towards zero over an interval: x_i⁺ = f_i x_i + noise of variance σ_i² (1 −
    f_i²).

    Args:
        factor: share of the state that is left, f_i.
        std: standard deviation of the state after a long time, σ_i.
    """

    factor: Scalar
    std: Scalar


@dataclass(frozen=True)
class Begin:
    """The readings of a log's first sample.

    Args:
        positions: of the drives [m, rad], 0 where nothing is read.
        efforts: of the drives [N, N m], None without a sensor.
        tensions: of the tendons [N], None without a sensor.
    """

    positions: Sequence[Scalar]
    efforts: Sequence[Scalar | None]
    tensions: Sequence[Scalar | None]


class State(ABC):
    """A block of the state vector; in its methods `values` are the block's own values, symbolic,
    (k,).
    """

    considered: ClassVar[bool] = False
    """Whether its uncertainty counts but its value is never estimated (Schmidt, 1966)."""
    lasting: ClassVar[bool] = False
    """Whether it is a constant of the rig or of a sensor; other states are meant to move."""
    learning: ClassVar[Learning] = Learning.AT_ONCE
    """The share of the gain that it takes."""
    smoothed: ClassVar[bool] = True
    """Whether a smoother may change it by later samples; the state of a guard stays as the filter
    had it.
    """

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the block's values, (k,)."""

    @property
    def kind(self) -> StateKind:
        """Kind of the block's values, where all are of one kind."""
        return StateKind.OTHER

    @property
    def part(self) -> str:
        """The component that the block belongs to: the name of a joint, drive, tendon or sensor, or
        the path of a parameter.
        """
        return ""

    @property
    def kinds(self) -> tuple[StateKind, ...]:
        """Kind of each value, (k,)."""
        return (self.kind,) * len(self.names)

    @property
    def parts(self) -> tuple[str, ...]:
        """Component of each value, (k,)."""
        return (self.part,) * len(self.names)

    @property
    @abstractmethod
    def means(self) -> Floats:
        """Prior means, (k,), SI."""

    @property
    @abstractmethod
    def stds(self) -> Floats:
        """Prior standard deviations, (k,), SI."""

    def prior(self) -> tuple[Prior | None, Prior | None]:
        """Return prior means and standard deviations, (k,) each, where they depend on inputs of the
        filter (a fit); None where they are `means` and `stds`.
        """
        return None, None

    @property
    def structure(self) -> tuple[object, ...]:
        """What the structure of a kernel depends on in this block, beside its names and
        its kind.
        """
        return ()

    def inputs(self) -> Iterator[tuple[str, float]]:
        """Yield name and value of the inputs of the filter's kernel that follow from this block,
        see `FilterContext.number`.
        """
        return iter(())

    @property
    def walk(self) -> float:
        """Standard deviation that each value gains as a random walk, per √s."""
        return 0.0

    @property
    def lowest(self) -> float:
        """Lower limit at which each value is kept."""
        return -np.inf

    @property
    def unidentified(self) -> bool:
        """Whether forces and displacements do not tell the values; then only a reference angle
        teaches them.
        """
        return False

    def first(self, begin: Begin) -> tuple[Scalar, Scalar] | None:
        """Return mean and standard deviation at the first sample, where its readings give them,
        else None.
        """
        return None

    def fading(self, dt: Scalar) -> Fading | None:
        """Return how the values fade over an interval of length `dt` [s]; None where they stay."""
        return None

    def parameters(self, values: Vector, p: Vector) -> Vector:
        """Return the model's parameters `p`, (n_p,), after this block's `values` have entered them,
        linearly.
        """
        return p

    def torque(self, joint: int, values: Vector) -> Scalar:
        """Return what `values` add to the torque on a joint [N m]."""
        return 0

    def position(self, drive: int, values: Vector) -> Scalar | None:
        """Return the position of a drive that nothing measures [m, rad] by `values`, None where
        this block does not hold it.
        """
        return None

    def position_error(self, drive: int, reading: Scalar, values: Vector) -> Scalar:
        """Return what `values` add to the `reading` of a drive's position sensor [m, rad]."""
        return 0

    def friction(self, drive: int, values: Vector) -> Scalar:
        """Return what `values` add to the friction limit of a drive [N, N m]."""
        return 0

    def force(self, drive: int, values: Vector) -> Scalar:
        """Return what `values` add to the expected force of a drive [N, N m]."""
        return 0

    def unknowns(self, values: Vector) -> dict[str, Scalar]:
        """Return name → value of the quantities that readings depend on, see
        `Measurand.unknowns`.
        """
        return {}

    def sensor_error(self, sensor: Sensor, reading: Scalar, values: Vector) -> Scalar:
        """Return what `values` add to the `reading` of a sensor of force, tension or angle."""
        return 0


class ZeroMean(State):
    """A block whose prior means are zero."""

    @property
    def means(self) -> Floats:
        """Prior means: zeros, (k,)."""
        return np.zeros(len(self.names))


class OfPart(State):
    """A single value of a component of the rig; its name is ``QUANTITY_PART``."""

    quantity: ClassVar[str]

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the state, (1,)."""
        return (f"{self.quantity}_{self.part}",)


@dataclass(frozen=True)
class OfDrive(OfPart):
    """A single value of a drive."""

    context: FilterContext
    drive: int

    @property
    def part(self) -> str:
        """Name of the drive."""
        return self.context.mechanism.rig.drives[self.drive].name


@dataclass(frozen=True)
class OfSensor(OfPart, ZeroMean):
    """A systematic error of a sensor of force, tension or angle."""

    lasting: ClassVar[bool] = True

    context: FilterContext
    sensor: Sensor

    @property
    def part(self) -> str:
        """Name of the sensor."""
        return self.sensor.name
