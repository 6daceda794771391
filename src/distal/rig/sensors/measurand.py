"""A kind of measurement: the parts that it is of, its unit, what it reads of a motion, and which
estimators use it.

A sensor of a new kind is one file beside this one, and a line in `registry`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, Literal, Protocol, TypeAlias

from distal.expressions import Scalar, Vector
from distal.rig.drives import Capstan, Slider
from distal.rig.joints import Joint
from distal.rig.quantities import Parameter
from distal.rig.sensors.base import SensorBase
from distal.rig.tendons import Tendon

Part: TypeAlias = Slider | Capstan | Tendon | Joint


class Parts(Protocol):
    """The parts of a rig that sensors measure."""

    @property
    def joints(self) -> Sequence[Joint]:
        """The joints of the rig."""

    @property
    def drives(self) -> Sequence[Slider | Capstan]:
        """The drives of the rig."""

    @property
    def tendons(self) -> Sequence[Tendon]:
        """The tendons of the rig."""


class Motion(Protocol):
    """What a mechanism does at a moment, in SI; parts are given by their indices."""

    def angle(self, joint: int) -> Scalar:
        """Return a joint's angle [rad]."""

    def torque(self, joint: int) -> Scalar:
        """Return the external torque on a joint [N m]."""

    def position(self, drive: int) -> Scalar:
        """Return a drive's position [m, rad]."""

    def rate(self, drive: int) -> Scalar:
        """Return a drive's speed [m/s, rad/s]."""

    def effort(self, drive: int) -> Scalar:
        """Return the force or torque that a drive exerts [N, N m]."""

    def tension(self, tendon: int) -> Scalar:
        """Return a tendon's tension [N]."""

    def turning(self, joint: int) -> Vector:
        """Return the angular velocity of a joint's link, in its own frame, (3,) [rad/s]."""

    def falling(self, joint: int) -> Vector:
        """Return the acceleration of free fall in the frame of a joint's link, (3,) [m/s²]."""

    def axis(self, joint: int) -> Sequence[float]:
        """Return a joint's axis in its own frame, a unit vector."""


class Role(Enum):
    """What estimators do with a measurement."""

    POSITION = "position"
    """The position of a drive, by which the model is moved."""

    EFFORT = "effort"
    """The effort of a drive; displacement-driven filters compare it with what they predict."""

    TENSION = "tension"
    """The tension of a tendon; displacement-driven filters compare it, too."""

    COMPARED = "compared"
    """A reading that only `adaptive` compares; other estimators do not read it."""

    REFERENCE = "reference"
    """A reading at a joint: estimates are compared with it or homed by it, and do not need it."""


@dataclass(frozen=True)
class Unknown:
    """An uncertain number, beside bias and gain, on which a reading depends.

    Args:
        name: of the state that stands for it; sensors with the same name share it.
        number: its value and std.
    """

    name: str
    number: Parameter


class Measurand(ABC):
    """A kind of measurement."""

    name: ClassVar[str]
    """Name of the kind in a rig file."""

    of: ClassVar[Literal["drives", "tendons", "joints"]]
    """Kind of the parts that it measures."""

    role: ClassVar[Role]
    """What estimators do with its readings."""

    si: ClassVar[str]
    """SI unit, where it does not depend on the part."""

    def unit(self, part: Part) -> str:
        """Return the SI unit of a sensor's readings and errors at a part."""
        return self.si

    @abstractmethod
    def read(
        self, sensor: SensorBase, motion: Motion, part: int, unknowns: Mapping[str, Scalar]
    ) -> Scalar:
        """Return what a sensor without errors reads [SI].

        Args:
            part: index of the part that the sensor is of.
            unknowns: name → value of the sensor's `unknowns`; for a name that is missing the value
                of the rig is taken.
        """

    @abstractmethod
    def travel(self, sensor: SensorBase, rig: Parts, part: int) -> tuple[float, float]:
        """Return the lowest and the highest value that a sensor measures [SI], between which its
        linearity error is defined.
        """

    def unknowns(self, sensor: SensorBase) -> tuple[Unknown, ...]:
        """Return the uncertain numbers, beside bias and gain, on which a sensor's reading
        depends.
        """
        return ()

    def values(self, raw: Mapping[str, object]) -> list[Mapping[str, object]]:
        """Return the sensors of one number each, still unchecked, for which a table of a rig file
        stands.
        """
        return [raw]
