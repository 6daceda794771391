"""Sensors of motions: the position of a drive, which is a displacement or an angle, and the angle
of a joint.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from distal.expressions import Scalar
from distal.rig.joints import REACH
from distal.rig.quantities import AnyAngle, Factor, In, Parameter, Radians
from distal.rig.sensors.base import (
    COUNTS,
    NOISE,
    OFFSET,
    STEP,
    Measurand,
    Motion,
    Parts,
    Role,
    SensorBase,
)
from distal.units import to_si

Metres = Annotated[float, In("m", "nonnegative")]
OVER_TRAVEL = Field(0.0, description="largest deviation of a smooth systematic error")
Curve = Annotated[
    tuple[float, ...],
    Field(
        max_length=6,
        description="known systematic error: weights of cos(π j ξ), j = 0, 1, …, over the travel",
    ),
]


class LengthSensor(SensorBase):
    """A sensor of a displacement [m]."""

    si: Literal["m"]
    noise: Metres = NOISE
    linearity: Metres = OVER_TRAVEL
    curve: Curve = ()
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
    curve: Curve = ()
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
