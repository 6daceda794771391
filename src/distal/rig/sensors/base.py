"""What every sensor has: of which part it is, where a log holds it, and the unit of its errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from distal.errors import UnitError
from distal.rig.quantities import Description, In, Name
from distal.units import to_si

COUNTS = frozenset({"count", "counts"})
"""Units of an encoder that counts."""

ERRORS = ("noise", "linearity", "resolution", "bias")
"""Keys of a sensor's errors: what may be written in the unit of the log."""


class SensorBase(Description):
    """What every sensor has; the unit of its errors follows from what it measures (`si`, filled in by `Rig`)."""

    name: Name
    measures: str = Field(
        description="position or force of a drive, tension of a tendon, angle of a joint or torque on it, or another kind "
        "of `distal.rig.sensors` (imu); command: a position that was asked for, not measured, which the "
        "drive follows with `lag`"
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


def _in_si(raw: Mapping[str, object], counting: Callable[[Mapping[str, object]], tuple[str, float] | None]) -> object:
    """Return a raw sensor with its errors in SI, as far as they are written in what its log counts."""
    try:
        scale = counting(raw)
        gear = to_si(raw.get("gear", 1.0), "") if scale is not None and scale[0] == "count" else 1.0
    except (UnitError, ZeroDivisionError):
        # what is wrong is said of its own field; in what the errors count is not known then
        return {key: value for key, value in raw.items() if key not in ERRORS}
    if scale is None:
        return raw
    unit, unit_size = scale
    if unit == "count" and raw.get("unit") in COUNTS and "resolution" not in raw:
        raw = {**raw, "resolution": unit_size * gear}  # it cannot tell less than one count

    def converted(error: object, size: float) -> object:
        if isinstance(error, Mapping):
            spreads = ("value", "std", "drift")
            return {key: converted(part, size) if key in spreads else part for key, part in error.items()}
        return _of_text(error, unit, size) if isinstance(error, str) else error

    sizes = {key: unit_size * (gear if key == "resolution" else 1.0) for key in ERRORS}
    return {**raw, **{key: converted(raw[key], size) for key, size in sizes.items() if key in raw}}


def _of_text(text: str, unit: str, size: float) -> object:
    """Return what a text such as ``2 count`` or ``20 mA`` stands for; a text in another unit as it is."""
    number, _, suffix = text.strip().rpartition(" ")
    try:
        if unit == "count":
            return to_si(number.strip(), "") * size if suffix in COUNTS else text
        return to_si(text, unit) * size
    except UnitError:
        return text
