"""What every sensor has, and what a kind of measurement is: the parts that it is of, its unit, what
it reads of a motion, and which estimators use it; and the sensors of motions, the position of a
drive and the angle of a joint.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from math import pi
from typing import Annotated, Literal, Protocol, Self, TypeAlias

from pydantic import Field, model_validator

from distal.errors import UnitError
from distal.expressions import Scalar, Vector
from distal.rig.drives import Capstan, Slider
from distal.rig.joints import REACH, Joint
from distal.rig.quantities import (
    ZERO,
    AnyAngle,
    Description,
    Factor,
    In,
    Name,
    Parameter,
    Radians,
    Seconds,
)
from distal.rig.tendons import Tendon
from distal.units import to_si

COUNTS = frozenset({"count", "counts", "tick", "ticks"})
"""Names of the unit of an encoder that counts."""


NOISE = Field(0.0, description="standard deviation of the random error")
STEP = Field(0.0, description="quantisation step; of an encoder before its gear")
OFFSET = Field(ZERO, description="offset; it walks where it has a drift")
"""Fields of the errors that all kinds of sensors have, each in its own unit."""

ERRORS = ("noise", "linearity", "resolution", "bias")
"""Keys of the errors of a sensor, which may be written in the unit of the log."""


def errors_in_si(
    raw: Mapping[str, object], counting: Callable[[Mapping[str, object]], tuple[str, float] | None]
) -> object:
    """Return a raw sensor with its errors in SI, where they are text in the unit in which its log
    counts.

    Args:
        counting: returns this unit and its size in SI, or None where the log does not count.
    """
    try:
        scale = counting(raw)
        gear = to_si(raw.get("gear", 1.0), "") if scale is not None and scale[0] == "count" else 1.0
    except (UnitError, ZeroDivisionError):
        # the wrong field is refused later; until then the unit of the errors is not known
        return {key: value for key, value in raw.items() if key not in ERRORS}
    if scale is None:
        return raw
    unit, unit_size = scale
    if unit == "count" and raw.get("unit") in COUNTS and "resolution" not in raw:
        raw = {**raw, "resolution": unit_size * gear}  # one count is the smallest step

    def converted(error: object, size: float) -> object:
        if isinstance(error, Mapping):
            spreads = ("value", "std", "drift")
            return {
                key: converted(part, size) if key in spreads else part
                for key, part in error.items()
            }
        return _of_text(error, unit, size) if isinstance(error, str) else error

    sizes = {key: unit_size * (gear if key == "resolution" else 1.0) for key in ERRORS}
    return {**raw, **{key: converted(raw[key], size) for key, size in sizes.items() if key in raw}}


def _of_text(text: str, unit: str, size: float) -> object:
    """Return the size in SI of a text such as ``2 count`` or ``20 mA``; a text in another unit is
    returned as it is.
    """
    number, _, suffix = text.strip().rpartition(" ")
    try:
        if unit == "count":
            return to_si(number.strip(), "") * size if suffix in COUNTS else text
        return to_si(text, unit) * size
    except UnitError:
        return text


class SensorBase(Description):
    """What every sensor has; the unit of its errors follows from what it measures (`si`, filled in
    by `Rig`).
    """

    name: Name
    measures: str = Field(
        description="`position` or `force` of a drive, `command` (a position that it was sent and "
        "follows with `lag`), `tension` of a tendon, `angle` or `torque` of a joint"
    )
    of: str = Field(description="the drive, tendon or joint")
    column: str | None = Field(
        None,
        min_length=1,
        description="of the log, or /topic.field of a recording; the sensor's name by default",
    )
    unit: str | None = Field(None, min_length=1, description="in the log; SI by default")
    sign: Literal[1, -1] = Field(1, description="−1 where the log counts the other way")
    rate: Annotated[float, In("Hz", within=(1e-3, 1e6))] = 100.0
    delay: Seconds = Field(0.0, description="age of a reading when it is stamped")

    lag: Seconds = Field(
        0.0,
        description="time constant with which a drive follows a command",
    )

    @model_validator(mode="before")
    @classmethod
    def _errors_as_logged(cls, raw: object) -> object:
        """Turn errors that are written as the log counts, in counts or amperes, into SI."""
        return errors_in_si(raw, cls._counting) if isinstance(raw, Mapping) else raw

    @classmethod
    def _counting(cls, raw: Mapping[str, object]) -> tuple[str, float] | None:
        """Return the unit in which the log may count instead of SI, and its size in SI; None where
        there is no such unit.
        """
        return None

    @model_validator(mode="after")
    def _unit(self) -> Self:
        if self.unit in COUNTS and getattr(self, "counts_per_turn", None) is None:
            raise ValueError(
                "unit: 'count' needs 'counts_per_turn' of an encoder that measures an angle; for "
                "others give the unit of "
                "the number in the log"
            )
        return self

    @model_validator(mode="after")
    def _lagging(self) -> Self:
        if self.lag > 0.0 and self.measures != "position":
            raise ValueError(
                "lag: is of a drive that follows a command; a sensor that is late has a delay"
            )
        return self

    @property
    def log_column(self) -> str:
        """The column of the log that holds the sensor's readings."""
        return self.column or self.name


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


@dataclass(frozen=True)
class Motion:
    """What a mechanism does at a moment, in SI.

    Args:
        angles: of the joints, (n_joints,) [rad].
        torques: from outside on the joints, (n_joints,) [N m].
        positions: of the drives, (n_drives,) [m, rad].
        rates: their speeds, (n_drives,).
        efforts: forces or torques that the drives exert, (n_drives,) [N, N m].
        tensions: of the tendons, (n_tendons,) [N].
    """

    angles: Vector
    torques: Vector
    positions: Vector
    rates: Vector
    efforts: Vector
    tensions: Vector


class Role(Enum):
    """What estimators do with a measurement."""

    POSITION = "position"
    """The position of a drive, by which the model is moved."""

    EFFORT = "effort"
    """The effort of a drive; displacement-driven filters compare it with what they predict."""

    TENSION = "tension"
    """The tension of a tendon; displacement-driven filters compare it, too."""

    REFERENCE = "reference"
    """A reading at a joint: estimates are compared with it or homed by it, and do not need it."""


@dataclass(frozen=True)
class Measurand:
    """A kind of measurement.

    Args:
        name: in a rig file.
        of: kind of the parts that it measures.
        role: what estimators do with its readings.
        unit: SI unit of a sensor's readings and errors.
        read: (sensor, motion, index of its part) → what it reads without errors [SI].
        travel: (sensor, rig, index of its part) → the lowest and the highest value that it measures
            [SI], between which its linearity error is defined.
        unit_of_capstan: the same of a capstan, where it is another one.
    """

    name: str
    of: Literal["drives", "tendons", "joints"]
    role: Role
    unit: str
    read: Callable[[SensorBase, Motion, int], Scalar]
    travel: Callable[[SensorBase, Parts, int], tuple[float, float]]
    unit_of_capstan: str = ""


Metres = Annotated[float, In("m", "nonnegative")]
OVER_TRAVEL = Field(0.0, description="largest deviation of a smooth systematic error")


class LengthSensor(SensorBase):
    """A sensor of a displacement [m]."""

    si: Literal["m"]
    noise: Metres = NOISE
    linearity: Metres = OVER_TRAVEL
    resolution: Metres = STEP
    bias: Annotated[Parameter, In("m", drifts=False)] = OFFSET


class AngleSensor(SensorBase):
    """A sensor of an angle [rad]."""

    si: Literal["rad"]
    counts_per_turn: Factor | None = Field(
        None,
        description='after quadrature, of the encoder\'s own shaft; with unit = "count"',
    )
    gear: Factor = Field(
        1.0,
        description="turns of the motor's (or encoder's) shaft for one turn of what is measured",
    )
    noise: Radians = NOISE
    linearity: Radians = OVER_TRAVEL
    resolution: Radians = Field(
        0.0,
        description="quantisation step; of an encoder before its gear",
    )
    bias: AnyAngle = OFFSET

    @classmethod
    def _counting(cls, raw: Mapping[str, object]) -> tuple[str, float] | None:
        if raw.get("counts_per_turn") is None:
            return None
        return "count", 2 * pi / (
            to_si(raw["counts_per_turn"], "") * to_si(raw.get("gear", 1.0), "")
        )

    @model_validator(mode="after")
    def _counted(self) -> Self:
        if self.counts_per_turn is not None and self.unit not in COUNTS:
            raise ValueError(
                'counts_per_turn: is for a log in counts; give unit = "count" too, or remove it'
            )
        return self


def drive_travel(rig: Parts, drive: int) -> tuple[float, float]:
    """Return the lowest and the highest position of a drive [m, rad]: its stops, or what its tendon
    lets it use.

    Without stops, the tendon's joints decide: of a tendon at one joint ±`REACH`, of a tendon over
    several joints the stops of each. The range of a slider lies about the displacement T/k at its
    nominal force T.
    """
    part = rig.drives[drive]
    if part.stops is not None:
        return part.stops
    tendon = next(t for t in rig.tendons if t.drive == part.name)
    lever = part.lever
    centre = 0.0 if part.kind == "capstan" else part.nominal_force.value / tendon.stiffness.value
    if len(tendon.joints) == 1:
        reach = REACH * tendon.total_arm / lever
        return centre - reach, centre + reach
    low = centre
    high = centre
    stops = {joint.name: joint.travel for joint in rig.joints}
    turned = tendon.winding if part.kind == "capstan" else 1
    for name, arm in tendon.arms().items():
        ends = sorted(turned * arm / lever * angle for angle in stops[name])
        low = low + ends[0]
        high = high + ends[1]
    return low, high


def _position(sensor: SensorBase, motion: Motion, part: int) -> Scalar:
    """Return the position of the drive, or the command that it follows."""
    ahead = sensor.lag * motion.rates[part] if sensor.lag > 0.0 else 0.0
    return motion.positions[part] + ahead


POSITION = Measurand(
    "position",
    "drives",
    Role.POSITION,
    "m",
    _position,
    lambda sensor, rig, part: drive_travel(rig, part),
    "rad",
)
"""The position of a drive: s of a slider [m], φ of a capstan [rad]. A sensor with a `lag` is a
command, which is ahead of the drive: it reads s + lag ṡ.
"""

ANGLE = Measurand(
    "angle",
    "joints",
    Role.REFERENCE,
    "rad",
    lambda sensor, motion, part: motion.angles[part],
    lambda sensor, rig, part: rig.joints[part].travel,
)
"""The angle θ of a joint [rad], within the range that it turns in."""
