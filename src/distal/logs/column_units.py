"""Units of columns: headers that give one, such as ``theta [rad]``, and the factor that turns a
column's numbers into SI.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence

from distal.errors import LogError, UnitError
from distal.rig import COUNTS, Rig, Role, Sensor, log_factor, measurand_of
from distal.units import unit_factor

_UNIT = re.compile(r"(.*\S)\s+\[([^\[\]]+)\]")


PERCENT = ("%", "pct", "percent")
"""Units of a load whose scale no log tells: the rig says what its numbers are taken for."""


def header(name: str, unit: str) -> str:
    """Return the header of a column, such as ``theta [rad]``; without a unit it is the name
    alone.
    """
    return f"{name} [{unit}]" if unit else name


def name_and_unit(text: str) -> tuple[str, str | None]:
    """Return the name and the unit of a header; the unit is None in ``theta`` and in
    ``position[0]``.
    """
    match = _UNIT.fullmatch(text)
    return (text, None) if match is None else (match[1], match[2])


def needed(text: str, columns: Collection[str] | None) -> bool:
    """Return whether the column with the header `text` is needed.

    Args:
        columns: whole headers, or names without units; None needs all.
    """
    return columns is None or text in columns or name_and_unit(text)[0] in columns


def units_of(
    headers: Sequence[str], desired: Collection[str], source: str
) -> dict[str, tuple[str, str]]:
    """Return desired name → its header and unit, for the columns whose header gives a unit.

    Args:
        desired: names without units.
        source: what the table is called in messages.

    Raises:
        LogError: two headers give the same name with a unit.
    """
    units: dict[str, tuple[str, str]] = {}
    for text in headers:
        name, unit = name_and_unit(text)
        if unit is None or name not in desired or name in headers:
            continue
        if name in units:
            raise LogError(
                f"{source}: column '{name}' is there twice, as '{units[name][0]}' and '{text}'; "
                "remove one"
            )
        units[name] = text, unit
    return units


def factor_of(sensor: Sensor, unit: str | None, source: str) -> float:
    """Return the factor that turns a column's numbers into SI, without the sensor's sign.

    Args:
        unit: unit in the column's header, or None. It counts before the rig's.
        source: what the log is called in messages.

    Raises:
        LogError: the header's unit is no unit of what the sensor measures.
    """
    if unit is None or (unit in PERCENT and measurand_of(sensor).role is Role.EFFORT):
        return log_factor(sensor)
    position = f"{source}: column '{header(sensor.log_column, unit)}'"
    try:
        if (unit in COUNTS) != (sensor.unit in COUNTS):
            raise UnitError('counts need unit = "count" and counts_per_turn in the rig file')
        return log_factor(sensor.model_copy(update={"unit": unit}))
    except UnitError as problem:
        raise LogError(f"{position}: {problem}") from None


def time_factor(rig: Rig, unit: str | None, source: str) -> float:
    """Return the factor that turns a log's stamps into seconds.

    Args:
        unit: unit in the header of the time column, or None. It counts before the rig's.
        source: what the log is called in messages.

    Raises:
        LogError: the header's unit is no unit of time.
    """
    unit = unit or rig.log.time.unit
    return scale(unit, "s", f"{source}: column '{header(rig.log.time.column, unit)}'")


def scale(unit: str | None, si: str, position: str) -> float:
    """Return the factor from a header's unit to the SI unit `si`; it is 1 where the header has no
    unit.

    Args:
        position: the column, as messages call it.

    Raises:
        LogError: the unit has another dimension, or is none.
    """
    if unit is None:
        return 1.0
    try:
        return unit_factor(unit, si)
    except UnitError as problem:
        raise LogError(f"{position}: {problem}") from None
