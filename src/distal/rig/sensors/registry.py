"""All kinds of sensors. A further one is a class in a file beside this one, a line in `MEASURANDS`,
and its class in `Sensor`; below, the conversion between a log's numbers and SI.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi
from typing import Annotated

from pydantic import Field

from distal.errors import UnitError, did_you_mean
from distal.rig.drives import Capstan
from distal.rig.quantities import ONE, Parameter
from distal.rig.sensors.base import (
    ANGLE,
    COUNTS,
    POSITION,
    AngleSensor,
    LengthSensor,
    Measurand,
    Part,
    Parts,
    Role,
)
from distal.rig.sensors.forces import FORCE, TENSION, TORQUE, ForceSensor, TorqueSensor
from distal.units import unit_factor

MEASURANDS: dict[str, Measurand] = {
    kind.name: kind for kind in (POSITION, FORCE, TENSION, ANGLE, TORQUE)
}
"""Name in a rig file → what can be measured."""

Sensor = Annotated[
    LengthSensor | AngleSensor | ForceSensor | TorqueSensor,
    Field(discriminator="si"),
]
"""A sensor."""

UNITS = ("m", "rad", "N", "N m")
"""SI units, by which pydantic tells the classes of sensors apart."""

REFERENCES = frozenset(name for name, kind in MEASURANDS.items() if kind.role is Role.REFERENCE)
"""Names of what is measured at a joint: estimators compare with these references or home by them,
and do not need them.
"""

MEASURED = {
    of: tuple(n for n, kind in MEASURANDS.items() if kind.of == of)
    for of in ("drives", "tendons", "joints")
}
"""Kind of part → names of what can be measured of it."""


def in_its_unit(
    raw: object, index: int, parts: Mapping[str, Sequence[Part]]
) -> Mapping[str, object]:
    """Return the raw table of a sensor with its SI unit.

    Args:
        index: of the table in the rig file, for messages.
        parts: kind → the parts of the rig.

    Raises:
        ValueError: the table names no part, or one of which this cannot be measured.
    """
    if not isinstance(raw, Mapping):
        raise ValueError(f"{index}: a sensor is a table, {raw!r} came")
    if raw.get("measures") == "command":
        if "lag" not in raw:
            raise ValueError(
                f"{index}: measures = 'command' needs lag, the time constant of the drive's servo "
                '("50 ms")'
            )
        raw = {**raw, "measures": "position"}
    measures = raw.get("measures")
    of = raw.get("of")
    if measures is None or of is None:
        return {**raw, "si": "m"}  # pydantic says what is missing
    kind = MEASURANDS.get(str(measures))
    if kind is None:
        *names, last = (f"'{name}'" for name in MEASURANDS)
        raise ValueError(
            f"{index}.measures: must be {', '.join(names)} or {last}, {measures!r} came"
        )
    names_of_parts = [part.name for part in parts[kind.of]]
    if of not in names_of_parts:
        raise ValueError(
            f"{index}.of: no {kind.of[:-1]} is called "
            f"'{of}'{_elsewhere(of, kind, parts, names_of_parts)}"
        )
    is_capstan = isinstance(parts[kind.of][names_of_parts.index(of)], Capstan)
    return {**raw, "si": kind.unit_of_capstan if is_capstan else kind.unit}


def _elsewhere(
    of: object, kind: Measurand, parts: Mapping[str, Sequence[Part]], names: list[str]
) -> str:
    """Return a hint for a message: a sensor's part is of another kind, or names that may
    be meant.
    """
    for kind_of_part, measurands in MEASURED.items():
        if of in [part.name for part in parts[kind_of_part]]:
            allowed = " or ".join(f"'{name}'" for name in measurands)
            is_motor = (kind_of_part, kind.name) == ("drives", "torque")
            hint = "; the torque of a capstan's motor is its force" if is_motor else ""
            return f", it is one of the {kind_of_part}: measures must be {allowed}{hint}"
    return did_you_mean(str(of), names)


def measurand_of(sensor: Sensor) -> Measurand:
    """Return the kind of measurement of a sensor."""
    return MEASURANDS[sensor.measures]


def part_of(sensor: Sensor, rig: Parts) -> int:
    """Return the index of the part that a sensor is of."""
    parts = {"joints": rig.joints, "drives": rig.drives, "tendons": rig.tendons}
    return [part.name for part in parts[measurand_of(sensor).of]].index(sensor.of)


def travel_of(sensor: Sensor, rig: Parts) -> tuple[float, float]:
    """Return the lowest and the highest value that a sensor measures [SI], between which its
    linearity error is defined.
    """
    return measurand_of(sensor).travel(sensor, rig, part_of(sensor, rig))


def gain_of(sensor: Sensor) -> Parameter:
    """Return the gain of a sensor, its reading per unit of what it measures; exactly 1 but for
    forces and torques.
    """
    return sensor.gain if isinstance(sensor, (ForceSensor, TorqueSensor)) else ONE


def step_of(sensor: Sensor) -> float:
    """Return the quantisation step of what a sensor measures [SI], behind its gear: `resolution` is
    that before the gear.
    """
    return sensor.resolution / (sensor.gear if isinstance(sensor, AngleSensor) else 1.0)


def log_factor(sensor: Sensor) -> float:
    """Return the factor from a log's numbers to SI, without the sensor's `sign`.

    Raises:
        UnitError: the unit is unknown or has the wrong dimension.
    """
    if isinstance(sensor, TorqueSensor):
        unit, torque = sensor.logged
        try:
            return torque * unit_factor(sensor.unit or unit, unit)
        except UnitError as problem:
            needs = (
                "; a load cell in N needs its lever, a current a torque_constant"
                if unit == sensor.si
                else ""
            )
            raise UnitError(f"{problem}{needs}") from None
    gear = sensor.gear if isinstance(sensor, AngleSensor) else 1.0
    if isinstance(sensor, AngleSensor) and sensor.counts_per_turn is not None:
        return 2 * pi / (sensor.counts_per_turn * gear)
    return unit_factor(sensor.unit or sensor.si, sensor.si) / gear


def angle_unit(sensors: Sequence[Sensor]) -> str:
    """Return the unit in which a log of these sensors has angles, "deg" or "rad": that of its known
    angles, else of its positions.
    """
    for role in (Role.REFERENCE, Role.POSITION):
        among = [s for s in sensors if s.si == "rad" and measurand_of(s).role == role]
        units = [s.unit or "rad" for s in among if s.unit not in COUNTS]
        if units:
            in_degrees = unit_factor("deg", "rad") in [unit_factor(u, "rad") for u in units]
            return "deg" if in_degrees else "rad"
    return "rad"


def log_unit(sensor: Sensor) -> str:
    """Return the unit of a sensor's numbers in the log."""
    return sensor.unit or (sensor.logged[0] if isinstance(sensor, TorqueSensor) else sensor.si)
