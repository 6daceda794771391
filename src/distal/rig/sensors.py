"""Sensors: what is measured, with which errors, and where a log holds it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import pi
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from distal.errors import UnitError
from distal.rig.quantities import Description, In, Name, Parameter
from distal.units import to_si, unit_factor

Measurand = Literal["position", "force", "tension", "angle", "torque"]

REFERENCES = frozenset({"angle", "torque"})
"""What is measured at a joint: references, which estimators compare with or home by, and do not need."""

COUNTS = frozenset({"count", "counts"})
"""Units of an encoder that counts."""

ERRORS = ("noise", "linearity", "resolution", "bias")
"""Keys of a sensor's errors: what may be written in the unit of the log."""

Gear = Annotated[float, In("", "positive")]


class SensorBase(Description):
    """What every sensor has; the unit of its errors follows from what it measures (`si`, filled in by `Rig`)."""

    name: Name
    measures: Measurand = Field(
        description="position or force of a drive, tension of a tendon, angle of a joint or torque on it; command: a "
        "position that was asked for, not measured, which the drive follows with `lag`"
    )
    of: str = Field(description="name of the drive, tendon or joint")
    column: str | None = Field(
        None, min_length=1, description="column of the log, or /topic.field of a recording; default: the sensor's name"
    )
    unit: str | None = Field(None, min_length=1, description="unit in the log; default: SI")
    sign: Literal[1, -1] = Field(1, description="-1 where the log counts the other way")
    rate: Annotated[float, In("Hz", "positive")] = Field(100.0, description="samples per second")
    delay: Annotated[float, In("s", "nonnegative")] = Field(0.0, description="age of a value when it is stamped")

    lag: Annotated[float, In("s", "nonnegative")] = Field(
        0.0, description="time constant with which a drive follows a command; 0 for a place that is measured"
    )

    @model_validator(mode="before")
    @classmethod
    def _errors_as_logged(cls, raw: object) -> object:
        """Turn errors that are written as the log counts, in counts or amperes, into SI."""
        return _in_si(raw, cls._counting) if isinstance(raw, Mapping) else raw

    @classmethod
    def _counting(cls, raw: Mapping[str, object]) -> tuple[str, float] | None:
        """Return the unit in which a log may count instead of SI, and what one of it is, None where there is none."""
        return None

    @model_validator(mode="after")
    def _unit(self) -> Self:
        if self.unit in COUNTS and getattr(self, "counts_per_turn", None) is None:
            raise ValueError(
                "unit: 'count' needs 'counts_per_turn' of an encoder that measures an angle; for others give the unit of "
                "the number in the log"
            )
        return self

    @model_validator(mode="after")
    def _lagging(self) -> Self:
        if self.lag > 0.0 and self.measures != "position":
            raise ValueError("lag: is of a drive that follows a command; a sensor that is late has a delay")
        return self

    @model_validator(mode="after")
    def _rate(self) -> Self:
        if not 1e-3 <= self.rate <= 1e6:
            raise ValueError(f"rate: must be between 0.001 and 1e+06 Hz, {self.rate:g} came")
        return self

    @property
    def log_column(self) -> str:
        """The column of the log that holds this sensor."""
        return self.column or self.name


class LengthSensor(SensorBase):
    """A sensor of a displacement [m]."""

    si: Literal["m"]
    noise: Annotated[float, In("m", "nonnegative")] = Field(0.0, description="standard deviation, random error")
    linearity: Annotated[float, In("m", "nonnegative")] = Field(
        0.0, description="largest systematic deviation over the travel, a smooth curve"
    )
    curve: tuple[float, ...] = Field(
        (), max_length=6, description="known systematic deviation: weights of cos(π j ξ), j = 0.., over the travel [SI]"
    )
    resolution: Annotated[float, In("m", "nonnegative")] = Field(0.0, description="quantisation step; 0 = none")
    bias: Annotated[Parameter, In("m", drifts=False)] = Field(Parameter(value=0.0), description="constant offset")


class AngleSensor(SensorBase):
    """A sensor of an angle [rad]."""

    si: Literal["rad"]
    counts_per_turn: Annotated[float, In("", "positive")] | None = Field(
        None, description='counts of the encoder in one turn of its own shaft, after quadrature; with unit = "count"'
    )
    gear: Gear = Field(1.0, description="turns of the encoder for one turn of what it measures (motor for capstan)")
    noise: Annotated[float, In("rad", "nonnegative")] = Field(0.0, description="standard deviation, random error")
    linearity: Annotated[float, In("rad", "nonnegative")] = Field(
        0.0, description="largest systematic deviation over the travel, a smooth curve"
    )
    curve: tuple[float, ...] = Field(
        (), max_length=6, description="known systematic deviation: weights of cos(π j ξ), j = 0.., over the travel [SI]"
    )
    resolution: Annotated[float, In("rad", "nonnegative")] = Field(
        0.0,
        description="quantisation step of the sensor's own shaft, before the gear, in counts as in degrees; 0 = none. "
        "Noise, linearity and bias in degrees are those behind the gear",
    )
    bias: Annotated[Parameter, In("rad")] = Field(Parameter(value=0.0), description="constant offset")

    @classmethod
    def _counting(cls, raw: Mapping[str, object]) -> tuple[str, float] | None:
        if raw.get("counts_per_turn") is None:
            return None
        return "count", 2 * pi / (to_si(raw["counts_per_turn"], "") * to_si(raw.get("gear", 1.0), ""))

    @model_validator(mode="after")
    def _counted(self) -> Self:
        if self.counts_per_turn is not None and self.unit not in COUNTS:
            raise ValueError('counts_per_turn: is for a log in counts; give unit = "count" too, or remove it')
        return self


class ForceSensor(SensorBase):
    """A sensor of a force or tension [N]."""

    si: Literal["N"]
    noise: Annotated[float, In("N", "nonnegative")] = Field(0.0, description="standard deviation, random error")
    linearity: Annotated[float, In("N", "nonnegative")] = Field(
        0.0, description="largest systematic deviation over the range, a smooth curve"
    )
    resolution: Annotated[float, In("N", "nonnegative")] = Field(0.0, description="quantisation step; 0 = none")
    bias: Annotated[Parameter, In("N")] = Field(Parameter(value=0.0), description="constant offset")
    gain: Annotated[Parameter, In("", "positive", drifts=False)] = Field(
        Parameter(value=1.0), description="what it reads for one newton, beside its offset"
    )


class TorqueSensor(SensorBase):
    """A sensor of a torque [N m], or of a motor's current where a torque constant K_t is given: τ = K_t i."""

    si: Literal["N m"]
    torque_constant: Annotated[float, In("N m/A", "positive")] | None = Field(
        None, description="K_t at the capstan, where the log holds a current; its unit is then one of current"
    )
    torque_constant_motor: Annotated[float, In("N m/A", "positive")] | None = Field(
        None, description="K_t of the motor itself; the capstan's is `gear` times it"
    )
    gear: Gear = Field(
        1.0, description="motor turns for one turn of the capstan; it applies to torque_constant_motor only"
    )
    noise: Annotated[float, In("N m", "nonnegative")] = Field(0.0, description="standard deviation, random error")
    linearity: Annotated[float, In("N m", "nonnegative")] = Field(
        0.0, description="largest systematic deviation over the range, a smooth curve"
    )
    resolution: Annotated[float, In("N m", "nonnegative")] = Field(0.0, description="quantisation step; 0 = none")
    bias: Annotated[Parameter, In("N m")] = Field(Parameter(value=0.0), description="constant offset")
    gain: Annotated[Parameter, In("", "positive", drifts=False)] = Field(
        Parameter(value=1.0), description="what it reads for one newton metre, beside its offset"
    )

    @classmethod
    def _counting(cls, raw: Mapping[str, object]) -> tuple[str, float] | None:
        if raw.get("torque_constant") is not None:
            return "A", to_si(raw["torque_constant"], "N m/A")
        if raw.get("torque_constant_motor") is not None:
            return "A", to_si(raw["torque_constant_motor"], "N m/A") * to_si(raw.get("gear", 1.0), "")
        return None

    @model_validator(mode="after")
    def _one_constant(self) -> Self:
        if self.torque_constant is not None and self.torque_constant_motor is not None:
            raise ValueError("torque_constant: is at the capstan, torque_constant_motor at the motor; give one of them")
        if self.gear != 1.0 and self.torque_constant_motor is None:
            raise ValueError(
                "gear: applies to torque_constant_motor only; a torque in N m and torque_constant are at the capstan"
            )
        return self

    @property
    def newton_metres_per_ampere(self) -> float | None:
        """K_t at the capstan, None where the log holds a torque."""
        motor = self.torque_constant_motor
        return self.torque_constant if motor is None else motor * self.gear


Sensor = Annotated[LengthSensor | AngleSensor | ForceSensor | TorqueSensor, Field(discriminator="si")]


def gain_of(sensor: LengthSensor | AngleSensor | ForceSensor | TorqueSensor) -> Parameter:
    """Return what a sensor reads for one unit of what it measures; exactly 1 for displacements and angles."""
    return sensor.gain if isinstance(sensor, (ForceSensor, TorqueSensor)) else Parameter(value=1.0)


def step_of(sensor: LengthSensor | AngleSensor | ForceSensor | TorqueSensor) -> float:
    """Return the quantisation step of what a sensor measures, behind its gear: its `resolution` is that before it."""
    return sensor.resolution / (sensor.gear if isinstance(sensor, AngleSensor) else 1.0)


def log_factor(sensor: LengthSensor | AngleSensor | ForceSensor | TorqueSensor) -> float:
    """Return by what a log's numbers are multiplied to be SI, its sign left out.

    Args:
        sensor: whose unit, and torque constant where it has one, say so.

    Raises:
        UnitError: the unit is unknown or has the wrong dimension.
    """
    if isinstance(sensor, TorqueSensor) and sensor.newton_metres_per_ampere is not None:
        return sensor.newton_metres_per_ampere * unit_factor(sensor.unit or "A", "A")
    gear = sensor.gear if isinstance(sensor, AngleSensor) else 1.0
    if isinstance(sensor, AngleSensor) and sensor.counts_per_turn is not None:
        return 2 * pi / (sensor.counts_per_turn * gear)
    return unit_factor(sensor.unit or sensor.si, sensor.si) / gear


def log_unit(sensor: LengthSensor | AngleSensor | ForceSensor | TorqueSensor) -> str:
    """Return the unit of a log's numbers."""
    counted_in = "A" if isinstance(sensor, TorqueSensor) and sensor.newton_metres_per_ampere is not None else sensor.si
    return sensor.unit or counted_in


def _in_si(raw: Mapping[str, object], counting: Callable[[Mapping[str, object]], tuple[str, float] | None]) -> object:
    """Return a raw sensor with its errors in SI, as far as they are written in what its log counts."""
    try:
        known = counting(raw)
        gear = to_si(raw.get("gear", 1.0), "") if known is not None and known[0] == "count" else 1.0
    except (UnitError, ZeroDivisionError):
        # what is wrong is said of its own field; in what the errors count is not known then
        return {key: value for key, value in raw.items() if key not in ERRORS}
    if known is None:
        return raw
    if known[0] == "count" and raw.get("unit") in COUNTS and "resolution" not in raw:
        raw = {**raw, "resolution": known[1] * gear}  # it cannot tell less than one count

    def converted(value: object, size: float) -> object:
        if isinstance(value, Mapping):
            spreads = ("value", "std", "drift")
            return {key: converted(part, size) if key in spreads else part for key, part in value.items()}
        return _of_text(value, known[0], size) if isinstance(value, str) else value

    sizes = {key: known[1] * (gear if key == "resolution" else 1.0) for key in ERRORS}
    return {**raw, **{key: converted(raw[key], size) for key, size in sizes.items() if key in raw}}


def _of_text(text: str, unit: str, size: float) -> object:
    """Return what a text such as ``2 count`` or ``20 mA`` stands for; a text in another unit as it is."""
    number, _, rest = text.strip().rpartition(" ")
    try:
        if unit == "count":
            return to_si(number.strip(), "") * size if rest in COUNTS else text
        return to_si(text, unit) * size
    except UnitError:
        return text
