"""An inertial measurement unit on a link: how the link turns, and which way gravity pulls, three
numbers each.

Its frame is that of the joint whose link carries it, turned by `mounting` about that joint's axis.
The accelerometer is taken to be at rest: it reads −g in its own frame, and what the link's own
acceleration adds is part of its noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import casadi as ca
from pydantic import Field

from distal.expressions import Scalar, rotation
from distal.rig.quantities import (
    ZERO,
    FixedAngle,
    In,
    MetresPerSecondSquared,
    Parameter,
    RadiansPerSecond,
)
from distal.rig.sensors.base import NOISE, STEP, Measurand, Motion, Parts, Role, SensorBase, Unknown

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

DEVIATION = Field(0.0, description="largest deviation of a smooth systematic error")
WALKING = Field(ZERO, description="offset; it walks where it has a drift")

GROUP = ("name", "column", "noise", "bias", "numbers")
"""Keys of a unit's table that are not the same for all of its numbers; `noise` and `bias` are
tables by `rate` and `force`.
"""


class ImuSensor(SensorBase):
    """One number of an inertial measurement unit."""

    unit_name: str = Field(description="of the whole unit")
    number: Literal["rate_x", "rate_y", "rate_z", "force_x", "force_y", "force_z"] = Field(
        description="which of its six numbers"
    )
    mounting: FixedAngle = Field(ZERO, description="turn on its link, about the joint's axis")


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
