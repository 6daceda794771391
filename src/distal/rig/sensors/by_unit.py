"""Sensors of one number by the unit of their errors: a displacement, an angle, a force, a
torque.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from distal.rig.quantities import In, Parameter
from distal.rig.sensors.base import SensorBase
from distal.rig.sensors.counts import COUNTS
from distal.units import to_si, unit_factor

Gear = Annotated[float, In("", "positive")]
Metres = Annotated[float, In("m", "nonnegative")]
Radians = Annotated[float, In("rad", "nonnegative")]
Newtons = Annotated[float, In("N", "nonnegative")]
NewtonMetres = Annotated[float, In("N m", "nonnegative")]
Curve = Annotated[
    tuple[float, ...],
    Field(
        max_length=6,
        description="known systematic deviation: weights of cos(π j ξ), j = 0.., over the travel "
        "[SI]",
    ),
]


class LengthSensor(SensorBase):
    """A sensor of a displacement [m]."""

    si: Literal["m"]
    noise: Metres = Field(0.0, description="standard deviation, random error")
    linearity: Metres = Field(
        0.0, description="largest systematic deviation over the travel, a smooth curve"
    )
    curve: Curve = ()
    resolution: Metres = Field(0.0, description="quantisation step; 0 = none")
    bias: Annotated[Parameter, In("m", drifts=False)] = Field(
        Parameter(value=0.0), description="constant offset"
    )


class AngleSensor(SensorBase):
    """A sensor of an angle [rad]."""

    si: Literal["rad"]
    counts_per_turn: Annotated[float, In("", "positive")] | None = Field(
        None,
        description="counts of the encoder in one turn of its own shaft, after quadrature; with "
        'unit = "count"',
    )
    gear: Gear = Field(
        1.0, description="turns of the encoder for one turn of what it measures (motor for capstan)"
    )
    noise: Radians = Field(0.0, description="standard deviation, random error")
    linearity: Radians = Field(
        0.0, description="largest systematic deviation over the travel, a smooth curve"
    )
    curve: Curve = ()
    resolution: Radians = Field(
        0.0,
        description="quantisation step of the sensor's own shaft, before the gear, in counts as "
        "in degrees; 0 = none. "
        "Noise, linearity and bias in degrees are those behind the gear",
    )
    bias: Annotated[Parameter, In("rad")] = Field(
        Parameter(value=0.0), description="constant offset"
    )

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


class ForceSensor(SensorBase):
    """A sensor of a force or tension [N]."""

    si: Literal["N"]
    noise: Newtons = Field(0.0, description="standard deviation, random error")
    linearity: Newtons = Field(
        0.0, description="largest systematic deviation over the range, a smooth curve"
    )
    resolution: Newtons = Field(0.0, description="quantisation step; 0 = none")
    bias: Annotated[Parameter, In("N")] = Field(Parameter(value=0.0), description="constant offset")
    gain: Annotated[Parameter, In("", "positive", drifts=False)] = Field(
        Parameter(value=1.0), description="what it reads for one newton, beside its offset"
    )


class TorqueSensor(SensorBase):
    """A sensor of a torque [N m]; of a motor's current with a constant K_t, τ = K_t i; of a force
    with a lever, τ = R F.
    """

    si: Literal["N m"]
    torque_constant: Annotated[float, In("N m/A", "positive")] | None = Field(
        None,
        description="K_t at the capstan, where the log holds a current; its unit is then one of "
        "current",
    )
    torque_constant_motor: Annotated[float, In("N m/A", "positive")] | None = Field(
        None, description="K_t of the motor itself; the capstan's is `gear` times it"
    )
    gear: Gear = Field(
        1.0,
        description="motor turns for one turn of the capstan; it applies to torque_constant_motor "
        "only",
    )
    lever: Annotated[float, In("m", "positive")] | None = Field(
        None,
        description="of a load cell, where the log holds a force: the capstan's radius for one in "
        "its only tendon",
    )
    noise: NewtonMetres = Field(0.0, description="standard deviation, random error")
    linearity: NewtonMetres = Field(
        0.0, description="largest systematic deviation over the range, a smooth curve"
    )
    resolution: NewtonMetres = Field(0.0, description="quantisation step; 0 = none")
    bias: Annotated[Parameter, In("N m")] = Field(
        Parameter(value=0.0), description="constant offset"
    )
    gain: Annotated[Parameter, In("", "positive", drifts=False)] = Field(
        Parameter(value=1.0), description="what it reads for one newton metre, beside its offset"
    )

    @classmethod
    def _counting(cls, raw: Mapping[str, object]) -> tuple[str, float] | None:
        if raw.get("torque_constant") is not None:
            return "A", to_si(raw["torque_constant"], "N m/A")
        if raw.get("lever") is not None:
            return "N", to_si(raw["lever"], "m")
        if raw.get("torque_constant_motor") is not None:
            return "A", to_si(raw["torque_constant_motor"], "N m/A") * to_si(
                raw.get("gear", 1.0), ""
            )
        if isinstance(unit := raw.get("unit"), str) and unit not in COUNTS:
            unit_factor(
                unit, "N m"
            )  # a wrong unit is refused here, before the errors that are written in it
        return None

    @model_validator(mode="after")
    def _one_constant(self) -> Self:
        if self.torque_constant is not None and self.torque_constant_motor is not None:
            raise ValueError(
                "torque_constant: is at the capstan, torque_constant_motor at the motor; give one "
                "of them"
            )
        if self.lever is not None and self.logged != ("N", self.lever):
            raise ValueError(
                "lever: is of a load cell, a torque constant of a motor's current; give one of them"
            )
        if self.gear != 1.0 and self.torque_constant_motor is None:
            raise ValueError(
                "gear: applies to torque_constant_motor only; a torque in N m and torque_constant "
                "are at the capstan"
            )
        return self

    @property
    def logged(self) -> tuple[str, float]:
        """SI unit of what the log holds (N m, A or N), and the torque at the capstan [N m] that one
        such unit stands for.
        """
        if self.torque_constant is not None:
            return "A", self.torque_constant
        if self.torque_constant_motor is not None:
            return "A", self.torque_constant_motor * self.gear
        return (self.si, 1.0) if self.lever is None else ("N", self.lever)
