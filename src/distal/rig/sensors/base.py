"""What every sensor has, and what a kind of measurement is: the parts that it is of, its unit, what
it reads of a motion, and which estimators use it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Literal, Protocol, Self, TypeAlias

from pydantic import Field, model_validator

from distal.errors import UnitError
from distal.expressions import Scalar, Vector
from distal.rig.drives import Capstan, Slider
from distal.rig.joints import Joint
from distal.rig.quantities import ZERO, Description, In, Name, Parameter, Seconds
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
        "follows with `lag`), `tension` of a tendon, `angle`, `torque` or `imu` of a joint"
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
        turning: index of a joint → angular velocity of its link, in its own frame, (3,) [rad/s].
        falling: index of a joint → acceleration of free fall in the frame of its link, (3,) [m/s²].
        axes: of the joints, in their own frames.
        unknowns: name → value of the `unknowns` of sensors; for a name that is missing the value of
            the rig is taken.
    """

    angles: Vector
    torques: Vector
    positions: Vector
    rates: Vector
    efforts: Vector
    tensions: Vector
    turning: Callable[[int], Vector]
    falling: Callable[[int], Vector]
    axes: Sequence[Sequence[float]]
    unknowns: Mapping[str, Scalar]


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


def certain(sensor: SensorBase) -> tuple[Unknown, ...]:
    """Return that nothing is unknown of a `sensor` beside bias and gain."""
    return ()


def one_sensor(raw: Mapping[str, object]) -> list[Mapping[str, object]]:
    """Return the one sensor for which the `raw` table stands."""
    return [raw]


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
        unknowns: sensor → the uncertain numbers, beside bias and gain, on which its reading
            depends.
        values: raw table of a rig file → the sensors of one number each, still unchecked, for which
            it stands.
    """

    name: str
    of: Literal["drives", "tendons", "joints"]
    role: Role
    unit: str
    read: Callable[[SensorBase, Motion, int], Scalar]
    travel: Callable[[SensorBase, Parts, int], tuple[float, float]]
    unit_of_capstan: str = ""
    unknowns: Callable[[SensorBase], tuple[Unknown, ...]] = certain
    values: Callable[[Mapping[str, object]], list[Mapping[str, object]]] = one_sensor
