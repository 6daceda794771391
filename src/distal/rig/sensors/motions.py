"""Sensors of motions: the position of a drive, which is a displacement or an angle; the angle of a
joint; and an inertial measurement unit on a link: how the link turns, and which way gravity pulls,
three numbers each.

The frame of such a unit is that of the joint whose link carries it, turned by `mounting` about that
joint's axis. The accelerometer is taken to be at rest: it reads −g in its own frame, and what the
link's own acceleration adds is part of its noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Annotated, Literal, Self

import casadi as ca
from pydantic import Field, model_validator

from distal.expressions import Scalar, rotation
from distal.rig.joints import REACH
from distal.rig.quantities import (
    ZERO,
    AnyAngle,
    Factor,
    FixedAngle,
    In,
    MetresPerSecondSquared,
    Parameter,
    Radians,
    RadiansPerSecond,
)
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
    Unknown,
)
from distal.units import to_si

Metres = Annotated[float, In("m", "nonnegative")]
OVER_TRAVEL = Field(0.0, description="largest systematic deviation over the travel, a smooth curve")
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
        description="counts of the encoder in one turn of its own shaft, after quadrature; with "
        'unit = "count"',
    )
    gear: Factor = Field(
        1.0, description="turns of the encoder for one turn of what it measures (motor for capstan)"
    )
    noise: Radians = NOISE
    linearity: Radians = OVER_TRAVEL
    curve: Curve = ()
    resolution: Radians = Field(
        0.0,
        description="quantisation step of the sensor's own shaft, before the gear, in counts as "
        "in degrees; 0 = none. "
        "Noise, linearity and bias in degrees are those behind the gear",
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


VALUES = {
    f"{kind}_{axis}": unit
    for kind, unit in (("rate", "rad/s"), ("force", "m/s^2"))
    for axis in "xyz"
}
"""Names of the numbers of an inertial measurement unit → their SI units."""

RANGES = {"rate": 35.0, "force": 20.0}
"""Largest magnitude of a rate [rad/s] and of a specific force [m/s²] of common units: 2000 °/s and
2 g. Source: judgement.
"""

DEVIATION = Field(0.0, description="largest systematic deviation")
WALKING = Field(ZERO, description="offset; with a drift it walks")

GROUP = ("name", "column", "noise", "bias", "numbers")
"""Keys of a unit's table that are not the same for all of its numbers; `noise` and `bias` are
tables by `rate` and `force`.
"""


class ImuSensor(SensorBase):
    """One number of an inertial measurement unit."""

    unit_name: str = Field(description="name of the whole unit")
    number: Literal["rate_x", "rate_y", "rate_z", "force_x", "force_y", "force_z"] = Field(
        description="which one"
    )
    mounting: FixedAngle = Field(
        ZERO, description="how it is turned on its link, about the joint's axis"
    )


class Gyroscope(ImuSensor):
    """An angular rate about an axis of the unit [rad/s]."""

    si: Literal["rad/s"]
    noise: RadiansPerSecond = NOISE
    linearity: RadiansPerSecond = DEVIATION
    resolution: RadiansPerSecond = STEP
    bias: Annotated[Parameter, In("rad/s")] = WALKING


class Accelerometer(ImuSensor):
    """A specific force along an axis of the unit [m/s²]: −g of a link at rest."""

    si: Literal["m/s^2"]
    noise: MetresPerSecondSquared = NOISE
    linearity: MetresPerSecondSquared = DEVIATION
    resolution: MetresPerSecondSquared = STEP
    bias: Annotated[Parameter, In("m/s^2")] = WALKING


def _values(raw: Mapping[str, object]) -> list[Mapping[str, object]]:
    """Return a sensor for each number of the unit, all six or those that the table names.

    Raises:
        ValueError: the table names a number that no unit has.
    """
    if "number" in raw:
        return [{**raw, "si": VALUES.get(str(raw["number"]), "rad/s")}]
    desired = raw.get("numbers", list(VALUES))
    if not isinstance(desired, list) or not desired or not set(map(str, desired)) <= set(VALUES):
        raise ValueError(f"numbers: must be some of {', '.join(VALUES)}, {desired!r} came")
    common = {key: part for key, part in raw.items() if key not in GROUP}
    sensors: list[Mapping[str, object]] = []
    for number in desired:
        sensor = {
            **common,
            "name": f"{raw.get('name')}_{number}",
            "unit_name": raw.get("name"),
            "number": number,
        }
        sensor |= {
            "column": f"{raw.get('column', raw.get('name'))}_{number}",
            "si": VALUES[number],
        }
        for key in ("noise", "bias"):
            by_kind = raw.get(key, {})
            if not isinstance(by_kind, Mapping):
                raise ValueError(f"{key}: must be a table with rate and force, {by_kind!r} came")
            if number.split("_")[0] in by_kind:
                sensor[key] = by_kind[number.split("_")[0]]
        sensors.append(sensor)
    return sensors


def _unknowns(sensor: SensorBase) -> tuple[Unknown, ...]:
    """Return the mounting angle, which all numbers of one unit share."""
    assert isinstance(sensor, ImuSensor)
    return (Unknown(f"mounting_{sensor.unit_name}", sensor.mounting),)


def _read(sensor: SensorBase, motion: Motion, part: int) -> Scalar:
    """Return the sensor's number in the frame of the unit."""
    assert isinstance(sensor, ImuSensor)
    kind, axis = sensor.number.split("_")
    vector = motion.turning(part) if kind == "rate" else -motion.falling(part)
    mounting = motion.unknowns.get(f"mounting_{sensor.unit_name}", sensor.mounting.value)
    turned = ca.mtimes(rotation(motion.axes[part], -mounting), vector)
    return turned["xyz".index(axis)]


def _travel(sensor: SensorBase, rig: Parts, part: int) -> tuple[float, float]:
    """Return the range that common units measure."""
    assert isinstance(sensor, ImuSensor)
    largest = RANGES[sensor.number.split("_")[0]]
    return -largest, largest


IMU = Measurand(
    "imu",
    "joints",
    Role.COMPARED,
    "rad/s",
    _read,
    _travel,
    unknowns=_unknowns,
    values=_values,
)
"""Angular velocity Rᵀ ω [rad/s] and specific force −Rᵀ g [m/s²] of a link, with R the turn by the
mounting angle about the joint's axis.
"""
