"""A kind of measurement: of which part it is, in which unit, what it reads of a motion, and who
uses it.

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
    """A rig, as far as sensors are of its parts."""

    @property
    def joints(self) -> Sequence[Joint]:
        """The joints."""

    @property
    def drives(self) -> Sequence[Slider | Capstan]:
        """The drives."""

    @property
    def tendons(self) -> Sequence[Tendon]:
        """The tendons."""


class Motion(Protocol):
    """What a mechanism does at a moment; parts by index, SI."""

    def angle(self, joint: int) -> Scalar:
        """Return a joint's angle [rad]."""

    def torque(self, joint: int) -> Scalar:
        """Return the torque on a joint from outside [N m]."""

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
    """It moves the model: the position of a drive."""

    EFFORT = "effort"
    """What a displacement-driven filter compares: a drive's force or torque."""

    TENSION = "tension"
    """What it compares too: a tendon's tension."""

    COMPARED = "compared"
    """What only `adaptive` compares; other estimators do not read it."""

    REFERENCE = "reference"
    """Measured at a joint: estimators compare with it or home by it, and do not need it."""


@dataclass(frozen=True)
class Unknown:
    """A number that a reading depends on and that is not known for certain.

    Args:
        name: as a state; sensors with the same name share it.
    """

    name: str
    number: Parameter


class Measurand(ABC):
    """A kind of measurement."""

    name: ClassVar[str]
    """What a rig file calls it."""

    of: ClassVar[Literal["drives", "tendons", "joints"]]
    """Of which parts it is."""

    role: ClassVar[Role]
    """What estimators do with it."""

    si: ClassVar[str]
    badge: ClassVar[str]
    """Unit and letter, where they do not depend on the part."""

    def unit(self, part: Part) -> str:
        """Return the SI unit in which its errors are given."""
        return self.si

    def letter(self, part: Part) -> str:
        """Return the letter of its badge in a drawing."""
        return self.badge

    @abstractmethod
    def read(
        self, sensor: SensorBase, motion: Motion, part: int, unknowns: Mapping[str, Scalar]
    ) -> Scalar:
        """Return what a sensor without errors reads [SI].

        Args:
            unknowns: values of `unknowns` by name; one that is missing has the rig's.
        """

    @abstractmethod
    def travel(self, sensor: SensorBase, rig: Parts, part: int) -> tuple[float, float]:
        """Return the ends of what it measures [SI], over which its linearity is defined."""

    def unknowns(self, sensor: SensorBase) -> tuple[Unknown, ...]:
        """Return the numbers beside bias and gain that its reading depends on and that are not
        known for certain.
        """
        return ()

    def values(self, raw: Mapping[str, object]) -> list[Mapping[str, object]]:
        """Return the sensors of one number each that a table of a rig file stands for, still
        unchecked.
        """
        return [raw]
