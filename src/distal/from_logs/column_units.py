"""The unit of a column: as its header says it, else by the size of its values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from distal.errors import LogError, UnitError
from distal.from_logs.column_names import NameEvidence, words_of
from distal.from_logs.column_role import ColumnRole, Sureness
from distal.from_logs.column_scores import MANY_COUNTS
from distal.rig import COUNTS
from distal.units import unit_factor

LARGEST_RADIANS = 12.6
"""Angles over a wider range are in degrees: two turns. Source: judgement."""


LARGEST_JOINT = 6.3
"""The same for a joint: one turn. Source: physics (a joint turns less than once)."""


LARGEST_AMPERES = 10.0
"""Currents over a wider range are in mA. Source: judgement."""


LARGEST_METRES = 0.5
"""Displacements over a wider range are in mm. Source: physics (a hand's drives travel less)."""

SMALLEST_TURN = 0.1
"""Range of a drive's position below which it is in metres, since no motor of a hand turns by so few
radians [1]. Source: judgement.
"""

FORCES = frozenset(
    ["force", "f", "kraft", "fuerza", "forza", "tension", "traction", "trazione", "tensione", "zug"]
)
"""Words of a force, where a header has no unit."""


NO_SCALE = frozenset(["load", "raw", "register", "lsb", "pwm", "duty", "pct", "percent"])
"""Words of an effort whose scale no log tells; it is taken as a current's."""


def check_unit(column: ColumnRole, name: NameEvidence) -> None:
    """Raise a `LogError` where a column that is used has a unit in brackets that is not known."""
    if name.unknown_unit and column.role != "other":
        raise LogError(
            f"column '{column.header}': the unit '{name.unknown_unit}' is not known; rename the "
            "column with one like mm, deg, N, N mm, mA or counts, or leave it out by --ignore"
        )


def with_unit(column: ColumnRole, name: NameEvidence, drives: Mapping[str, str]) -> ColumnRole:
    """Return a column with its unit: as its header says it, else by the size of its values."""
    if column.role == "other":
        return column
    if drives.get(column.header):
        unit = drives[column.header]
        if unit in COUNTS:
            return replace(column, unit="count", si="count", unit_sureness="sure")
        return replace(column, unit=unit, si=_si_of(unit, column.header), unit_sureness="sure")
    scaled = name.si == "" or (name.si is None and NO_SCALE & set(words_of(column.header)))
    if column.role == "effort" and scaled:
        return replace(column, unit="A", si="A", unit_sureness="assumed")
    if name.unit is not None and name.si is not None:
        return replace(column, unit=name.unit, si=name.si, unit_sureness="sure")
    unit, si, sureness = _unit_by_size(column)
    return replace(column, unit=unit, si=si, unit_sureness=sureness)


def _si_of(unit: str, header: str) -> str:
    """Return the SI unit of a drive's position in some unit."""
    for si in ("m", "rad"):
        try:
            unit_factor(unit, si)
        except UnitError:
            continue
        return si
    raise LogError(
        f"--drive '{header}={unit}': a drive is read in a length or an angle, such as mm or "
        f"deg, or in ticks; '{unit}' is none of these"
    )


def _unit_by_size(column: ColumnRole) -> tuple[str, str, Sureness]:
    """Return the unit of a column whose header has none, by its role, its words and its range."""
    width = column.values.width
    words = set(words_of(column.header))
    if column.role == "time":
        return "s", "s", "likely"
    if column.role == "angle":
        if width > LARGEST_JOINT:
            return "deg", "rad", "likely"
        return "rad", "rad", "a guess"
    if column.role == "effort":
        if words & {"torque", "tau", "drehmoment", "couple", "coppia"}:
            return "N m", "N m", "likely"
        if words & {"cur", "curr", "current", "strom", "courant", "corriente", "corrente", "i"}:
            return ("mA" if width > LARGEST_AMPERES else "A"), "A", "a guess"
        return "N", "N", "likely" if words & FORCES else "a guess"
    if column.values.turn is not None and column.values.is_whole:
        return "count", "count", "likely"
    if column.values.is_whole and width > MANY_COUNTS:
        return "count", "count", "likely"
    if words & {"disp", "displacement", "slider", "weg"}:
        return ("mm" if width > LARGEST_METRES else "m"), "m", "likely"
    if "x" in words and not SMALLEST_TURN < width < LARGEST_RADIANS:  # else it may be an angle
        return ("mm" if width > LARGEST_RADIANS else "m"), "m", "likely"
    if width < SMALLEST_TURN and not words & {"phi"}:
        return "m", "m", "a guess"
    return ("deg" if width > LARGEST_RADIANS else "rad"), "rad", "a guess"


def with_common_units(columns: Sequence[ColumnRole]) -> list[ColumnRole]:
    """Return columns of one role in the unit of the surest of them, where theirs is a guess."""
    result = list(columns)
    for i, column in enumerate(columns):
        if column.unit_sureness != "a guess" or column.role in ("other", "time"):
            continue
        alike = [
            other
            for other in columns
            if other.role == column.role
            and other.si
            and other.values.width > 0.0
            and (column.role != "effort" or other.si == column.si)
        ]
        widest = max(alike, key=lambda other: other.values.width)
        surest = next((other for other in alike if other.unit_sureness != "a guess"), widest)
        result[i] = replace(column, unit=surest.unit, si=surest.si)
    return result


def with_torques(columns: Sequence[ColumnRole]) -> list[ColumnRole]:
    """Return columns in which an effort of a motor that turns is a torque where that is a guess."""
    turning = {c.part for c in columns if c.role == "position" and c.si != "m"}
    return [
        replace(column, unit="N m", si="N m")
        if column.role == "effort"
        and column.si == "N"
        and column.unit_sureness == "a guess"
        and column.part in turning
        else column
        for column in columns
    ]


TAKEN_FORCES = {"mA": "cN", "A": "daN"}
"""Unit of a current → that of a force which is taken for it where a drive moves in a line, 10 N for
an ampere. Source: judgement (small lead screws).
"""


def with_forces_of_sliders(columns: Sequence[ColumnRole]) -> list[ColumnRole]:
    """Return columns in which the current of a drive that moves in a line is a force of a taken
    scale; where a header gives its unit in brackets it stays, and cannot be used.
    """
    in_line = {c.part for c in columns if c.role == "position" and c.si == "m"}
    changed = []
    for column in columns:
        unit = TAKEN_FORCES.get(column.unit) if column.part in in_line else None
        if column.role != "effort" or unit is None:
            changed.append(column)
        elif column.unit_sureness == "assumed":
            changed.append(replace(column, unit=unit, si="N"))
        elif column.header.rstrip().endswith("]"):
            changed.append(replace(column, role="other", part=""))
        else:
            changed.append(replace(column, unit=unit, si="N", unit_sureness="a guess"))
    return changed
