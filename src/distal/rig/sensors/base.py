"""What every sensor has: of which part it is, where a log holds it, and the unit of its errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from distal.rig.quantities import Description, In, Name
from distal.rig.sensors.counts import COUNTS, errors_in_si


class SensorBase(Description):
    """What every sensor has; the unit of its errors follows from what it measures (`si`, filled in
    by `Rig`).
    """

    name: Name
    measures: str = Field(
        description="position or force of a drive, tension of a tendon, angle of a joint or "
        "torque on it, or another kind "
        "of `distal.rig.sensors` (imu); command: a position that was asked for, not measured, "
        "which the "
        "drive follows with `lag`"
    )
    of: str = Field(description="name of the drive, tendon or joint")
    column: str | None = Field(
        None,
        min_length=1,
        description="column of the log, or /topic.field of a recording; default: the sensor's name",
    )
    unit: str | None = Field(None, min_length=1, description="unit in the log; default: SI")
    sign: Literal[1, -1] = Field(1, description="-1 where the log counts the other way")
    rate: Annotated[float, In("Hz", "positive")] = Field(100.0, description="samples per second")
    delay: Annotated[float, In("s", "nonnegative")] = Field(
        0.0, description="age of a value when it is stamped"
    )

    lag: Annotated[float, In("s", "nonnegative")] = Field(
        0.0,
        description="time constant with which a drive follows a command; 0 for a place that is "
        "measured",
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

    @model_validator(mode="after")
    def _rate(self) -> Self:
        if not 1e-3 <= self.rate <= 1e6:
            raise ValueError(f"rate: must be between 0.001 and 1e+06 Hz, {self.rate:g} came")
        return self

    @property
    def log_column(self) -> str:
        """The column of the log that holds the sensor's readings."""
        return self.column or self.name
