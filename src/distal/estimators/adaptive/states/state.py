"""What a kind of state is: a block of numbers that the filter does not know, and what they do.

A block says its names, its prior, how it fades and walks, and what it adds: to the model's
parameters, to the torque on a joint, to the position of a drive, to friction, to what a sensor
reads. Each of these has the default "nothing". `StateVector` puts blocks side by side and adds up
what they do.
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
"""Numbers of a block, (k,), expressions of what a fit varies; one number stands for all."""


class Learning(Enum):
    """How much of the gain a state takes, see `StateVector.gain_shares`."""

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
        factor: what is left of it, f.
        std: standard deviation that it has after a long time, σ_i.
    """

    factor: Scalar
    std: Scalar


@dataclass(frozen=True)
class Begin:
    """What is read at a log's first sample.

    It is the positions of the drives [m, rad], 0 where nothing is read, their efforts [N, N m], and
    the tensions of the tendons [N]; None where no sensor is.
    """

    positions: Sequence[Scalar]
    efforts: Sequence[Scalar | None]
    tensions: Sequence[Scalar | None]


class State(ABC):
    """A block of the state vector; `values` are those of the block, symbolic, (k,)."""

    considered: ClassVar[bool] = False
    """Whether its uncertainty counts but it is never estimated (Schmidt, 1966)."""
    lasting: ClassVar[bool] = False
    """Whether it is a number of the rig or of a sensor; others are meant to move."""
    learning: ClassVar[Learning] = Learning.AT_ONCE
    """How much of the gain it takes."""
    smoothed: ClassVar[bool] = True
    """Whether a smoother may change it by what came later; a guard's state stays as the filter had
    it.
    """

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of its numbers, (k,)."""

    @property
    def kind(self) -> StateKind:
        """What it is."""
        return StateKind.OTHER

    @property
    def part(self) -> str:
        """The part of the rig that it is of: a joint, drive, tendon or sensor by its name, a number
        by its path.
        """
        return ""

    @property
    def kinds(self) -> tuple[StateKind, ...]:
        """What each of its numbers is, (k,)."""
        return (self.kind,) * len(self.names)

    @property
    def parts(self) -> tuple[str, ...]:
        """The part that each of its numbers is of, (k,)."""
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
        """What a kernel depends on beside its names and its kind."""
        return ()

    def inputs(self) -> Iterator[tuple[str, float]]:
        """Yield numbers that follow from its own, by name: inputs of the filter's kernel, see
        `FilterContext.number`.
        """
        return iter(())

    @property
    def walk(self) -> float:
        """Standard deviation that each of its numbers gains as a random walk, per √s."""
        return 0.0

    @property
    def lowest(self) -> float:
        """Its numbers are kept at or above this."""
        return -np.inf

    @property
    def unidentified(self) -> bool:
        """Whether forces and displacements do not tell it: only a joint's own angle teaches it."""
        return False

    def first(self, begin: Begin) -> tuple[Scalar, Scalar] | None:
        """Return mean and standard deviation at the first sample, where its readings tell them;
        None where they do not.
        """
        return None

    def fading(self, dt: Scalar) -> Fading | None:
        """Return how its numbers fade over an interval of length `dt` [s], None where they stay."""
        return None

    def parameters(self, values: Vector, p: Vector) -> Vector:
        """Return the model's parameters, `p` so far, (n_p,), with what this block's `values` say,
        linearly.
        """
        return p

    def torque(self, joint: int, values: Vector) -> Scalar:
        """Return what its `values` add to the torque on a joint [N m]."""
        return 0

    def position(self, drive: int, values: Vector) -> Scalar | None:
        """Return the position of a drive that nothing measures by its `values` [m, rad], None
        where it does not say.
        """
        return None

    def position_error(self, drive: int, reading: Scalar, values: Vector) -> Scalar:
        """Return what its `values` add to the `reading` of a drive's position sensor [m, rad]."""
        return 0

    def friction(self, drive: int, values: Vector) -> Scalar:
        """Return what its `values` add to the friction limit of a drive [N, N m]."""
        return 0

    def force(self, drive: int, values: Vector) -> Scalar:
        """Return what its `values` add to the force that is expected at a drive [N, N m]."""
        return 0

    def unknowns(self, values: Vector) -> dict[str, Scalar]:
        """Return numbers that readings depend on, by name, see `Measurand.unknowns`."""
        return {}

    def sensor_error(self, sensor: Sensor, reading: Scalar, values: Vector) -> Scalar:
        """Return what its `values` add to the `reading` of a sensor of force, tension or angle."""
        return 0


class ZeroMean(State):
    """A block whose numbers are expected to be zero."""

    @property
    def means(self) -> Floats:
        """Zeros, (k,)."""
        return np.zeros(len(self.names))


class OfPart(State):
    """A number of a part of the rig; its name is ``QUANTITY_PART``."""

    quantity: ClassVar[str]

    @property
    def names(self) -> tuple[str, ...]:
        """Its name, (1,)."""
        return (f"{self.quantity}_{self.part}",)


@dataclass(frozen=True)
class OfDrive(OfPart):
    """A number of a drive."""

    context: FilterContext
    drive: int

    @property
    def part(self) -> str:
        """The drive's name."""
        return self.context.mechanism.rig.drives[self.drive].name


@dataclass(frozen=True)
class OfSensor(OfPart, ZeroMean):
    """A systematic error of a sensor of force, tension or angle."""

    lasting: ClassVar[bool] = True

    context: FilterContext
    sensor: Sensor

    @property
    def part(self) -> str:
        """The sensor's name."""
        return self.sensor.name
