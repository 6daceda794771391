"""Sensors: what is measured, with which errors, and where a log holds it."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from distal.rig.quantities import Description, In, Name, Parameter
from distal.units import unit_factor

Measurand = Literal["position", "force", "tension", "angle"]


class SensorBase(Description):
    """What every sensor has; the unit of its errors follows from what it measures (`si`, filled in by `Rig`)."""

    name: Name
    measures: Measurand = Field(description="position or force of a drive, tension of a tendon, angle of a joint")
    of: str = Field(description="name of the drive, tendon or joint")
    column: str | None = Field(
        None, min_length=1, description="column of the log, or /topic.field of a recording; default: the sensor's name"
    )
    unit: str | None = Field(None, min_length=1, description="unit in the log; default: SI")
    sign: Literal[1, -1] = Field(1, description="-1 where the log counts the other way")
    rate: Annotated[float, In("Hz", "positive")] = Field(100.0, description="samples per second")
    delay: Annotated[float, In("s", "nonnegative")] = Field(0.0, description="age of a value when it is stamped")

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
    noise: Annotated[float, In("rad", "nonnegative")] = Field(0.0, description="standard deviation, random error")
    linearity: Annotated[float, In("rad", "nonnegative")] = Field(
        0.0, description="largest systematic deviation over the travel, a smooth curve"
    )
    curve: tuple[float, ...] = Field(
        (), max_length=6, description="known systematic deviation: weights of cos(π j ξ), j = 0.., over the travel [SI]"
    )
    resolution: Annotated[float, In("rad", "nonnegative")] = Field(0.0, description="quantisation step; 0 = none")
    bias: Annotated[Parameter, In("rad")] = Field(Parameter(value=0.0), description="constant offset")


class ForceSensor(SensorBase):
    """A sensor of a force or tension [N]."""

    si: Literal["N"]
    noise: Annotated[float, In("N", "nonnegative")] = Field(0.0, description="standard deviation, random error")
    linearity: Annotated[float, In("N", "nonnegative")] = Field(
        0.0, description="largest systematic deviation over the range, a smooth curve"
    )
    resolution: Annotated[float, In("N", "nonnegative")] = Field(0.0, description="quantisation step; 0 = none")
    bias: Annotated[Parameter, In("N")] = Field(Parameter(value=0.0), description="constant offset")


class TorqueSensor(SensorBase):
    """A sensor of a torque [N m], or of a motor's current where a torque constant K_t is given: τ = K_t i."""

    si: Literal["N m"]
    torque_constant: Annotated[float, In("N m/A", "positive")] | None = Field(
        None, description="K_t at the capstan, where the log holds a current; its unit is then one of current"
    )
    noise: Annotated[float, In("N m", "nonnegative")] = Field(0.0, description="standard deviation, random error")
    linearity: Annotated[float, In("N m", "nonnegative")] = Field(
        0.0, description="largest systematic deviation over the range, a smooth curve"
    )
    resolution: Annotated[float, In("N m", "nonnegative")] = Field(0.0, description="quantisation step; 0 = none")
    bias: Annotated[Parameter, In("N m")] = Field(Parameter(value=0.0), description="constant offset")


Sensor = Annotated[LengthSensor | AngleSensor | ForceSensor | TorqueSensor, Field(discriminator="si")]


def log_factor(sensor: LengthSensor | AngleSensor | ForceSensor | TorqueSensor) -> float:
    """Return by what a log's numbers are multiplied to be SI, its sign left out.

    Args:
        sensor: whose unit, and torque constant where it has one, say so.

    Raises:
        UnitError: the unit is unknown or has the wrong dimension.
    """
    constant = getattr(sensor, "torque_constant", None)
    if constant is not None:
        return float(constant * unit_factor(sensor.unit or "A", "A"))
    return unit_factor(sensor.unit or sensor.si, sensor.si)
