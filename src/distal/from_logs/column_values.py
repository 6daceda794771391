"""What the values of columns say: noise, steps and wraps of each; and what a column is, with its
unit: as its header says it, else by its words and the range of values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Literal

import numpy as np

from distal.arrays import Floats
from distal.errors import LogError
from distal.from_logs.column_names import ROLES, SPELLED, NameEvidence, Role, dimension_of
from distal.rig import COUNTS

Sureness = Literal["sure", "likely", "a guess", "assumed"]
"""How sure something is. An assumed unit is that of a scale that no log tells, as of a load in
percent.
"""

USUAL_RANGE: Mapping[Role, Mapping[str, Mapping[str, float]]] = {
    "time": {"": {"s": 10.0}},
    "angle": {"": {"rad": 0.8, "deg": 46.0}},
    "position": {
        "symbol": {"m": 0.006, "rad": 1.7, "mm": 30.0, "count": 1000.0},
        "travel": {"m": 0.016, "mm": 16.0, "count": 1000.0},
        "": {"m": 0.006, "rad": 1.7, "deg": 97.0, "count": 1000.0},
    },
    "effort": {
        "current": {"A": 0.3, "mA": 300.0},
        "force": {"N": 10.0},
        "torque": {"N m": 1.0},
    },
}
"""Role → kind of a word, or none → unit → usual range of a column in it, where the header has no
unit. The nearest one is taken, by the ratio. Source: judgement (fingers and their motors).
"""

TAKEN_FORCES = {"mA": "cN", "A": "daN"}
"""Unit of a current → that of a force which is taken for it where a drive moves in a line, 10 N for
an ampere. Source: judgement (small lead screws).
"""


@dataclass(frozen=True)
class ColumnRole:
    """What a column is.

    Args:
        header: as the logs have it.
        role: time, position or effort of a drive, angle of a joint, command, or other.
        part: name of the drive or joint, empty for time and other.
        unit: of its values, as a rig file has it; empty where it has none.
        si: SI unit of its dimension; "count" for an encoder's counts.
        sureness: of the role.
        unit_sureness: of the unit.
        evidence: why, in a line.
        values: what its values say.
    """

    header: str
    role: Role
    part: str
    unit: str
    si: str
    sureness: Sureness
    unit_sureness: Sureness
    evidence: str
    values: ValueEvidence

    @property
    def in_words(self) -> str:
        """All of it in a line."""
        of = f" of {self.part}" if self.part else ""
        doubt = "" if self.unit_sureness == "sure" else f" ({self.unit_sureness})"
        unit = f" in {self.unit}{doubt}" if self.unit else ""
        unit = " of an assumed scale" if self.unit_sureness == "assumed" else unit
        return f"{self.header}: {self.role}{of}{unit}, {self.sureness}: {self.evidence}"


def with_units(
    columns: Sequence[ColumnRole], names: Mapping[str, NameEvidence], drives: Mapping[str, str]
) -> list[ColumnRole]:
    """Return columns with their units: as a user or the header says, else by the words of the name
    and the range of the values. The current of a drive that moves in a line becomes a force of a
    taken scale; where a header gives its unit in brackets it stays, and cannot be used.

    Args:
        columns: with their roles and parts.
        names: header → what its name says.
        drives: header → the unit that a user gave.

    Raises:
        LogError: a user's unit is none of a length or an angle.
    """
    result = dict[str, ColumnRole]()
    in_line = set[str]()
    usual = {column.header: _usual_range(column.role, names[column.header]) for column in columns}
    for column in sorted(columns, key=lambda column: ROLES.index(column.role)):
        header = column.header
        alike = [c for c in columns if c.role == column.role and usual[c.header] == usual[header]]
        width = max(each.values.width for each in alike)
        unit, si, sureness = _unit_by_size(column, usual[header], width, column.part in in_line)
        if drives.get(header):
            unit, si, sureness = _drive_unit(header, drives[header])
        elif column.role != "other":
            unit, si, sureness = _named_unit(column, names[header]) or (unit, si, sureness)
        found = replace(column, unit=unit, si=si, unit_sureness=sureness)
        if column.role == "position" and si == "m":
            in_line.add(column.part)
        if column.role == "effort" and unit in TAKEN_FORCES and column.part in in_line:
            found = _as_force(found)
        result[header] = found
    return [result[column.header] for column in columns]


def _as_force(column: ColumnRole) -> ColumnRole:
    """Return a current of a drive that moves in a line as a force of a taken scale."""
    is_sure = column.unit_sureness == "sure"
    if is_sure and column.header.rstrip().endswith("]"):
        return replace(column, role="other", part="")
    sureness = "a guess" if is_sure else column.unit_sureness
    return replace(column, unit=TAKEN_FORCES[column.unit], si="N", unit_sureness=sureness)


def _named_unit(column: ColumnRole, name: NameEvidence) -> tuple[str, str, Sureness] | None:
    """Return the unit that the name of a column says, its SI unit, and how sure that is."""
    if column.role == "effort" and not name.has_scale:
        return "A", "A", "assumed"
    return None if name.unit is None else (name.unit, str(name.si), "sure")


def _usual_range(role: Role, name: NameEvidence) -> Mapping[str, float]:
    """Return unit → usual range of a column by its role and its words, empty where none has one."""
    of_role = USUAL_RANGE.get("position" if role == "command" else role, {})
    return next((of_role[kind] for kind in (*name.kinds, "") if kind in of_role), {})


def _unit_by_size(
    column: ColumnRole, usual: Mapping[str, float], width: float, in_line: bool
) -> tuple[str, str, Sureness]:
    """Return the unit whose usual range is nearest to a `width`, its SI unit, and how sure that is;
    an effort of unknown kind is a force of a drive that moves `in_line`, else a torque.
    """
    if column.role == "other":
        return "", "", "a guess"
    if not usual:
        return ("N", "N", "a guess") if in_line else ("N m", "N m", "a guess")
    units = [unit for unit in usual if unit != "count" or column.values.is_whole]
    unit = min(units, key=lambda unit: abs(np.log(max(width, 1e-300) / usual[unit])))
    is_likely = len(units) == 1 or unit == "count"
    return unit, SPELLED[unit.replace(" ", "").lower()][1], "likely" if is_likely else "a guess"


def _drive_unit(header: str, unit: str) -> tuple[str, str, Sureness]:
    """Return the unit of a drive's position that a user gave, and its SI unit."""
    if unit in COUNTS:
        return "count", "count", "sure"
    si = dimension_of(unit, ("m", "rad"))
    if si is None:
        raise LogError(
            f"--drive '{header}={unit}': a drive is read in a length or an angle, such as mm or "
            f"deg, or in ticks; '{unit}' is none of these"
        )
    return unit, si, "sure"


def in_si(column: ColumnRole, values: Floats, factor: float) -> Floats:
    """Return a column's values without wraps, times the factor of its unit."""
    if column.values.turn is not None:
        values = unwrapped(values, column.values.turn)
    return values * factor


NORMAL_MAD = 1.4826
"""Standard deviation per median of absolute values of a normal error. Source: definition (its
75 % quantile).
"""

SECOND_DIFFERENCE = 6.0
"""Variance of x₋₁ − 2x₀ + x₁ per variance of white noise x. Source: definition (1 + 4 + 1)."""

SAME = 1e-9
"""Values whose range is below this share of their size are one value. Source: rounding.
"""

HALF_TURN = 0.5
"""Share of a turn above which a step between neighbours is a wrap. Source: definition (Nyquist: the
shorter way round is taken).
"""

TURNS = np.array([2.0 * pi, 360.0, *2.0 ** np.arange(6, 33)])
"""Periods after which readings wrap: in rad, in deg, of counters. Source: definition (registers
have whole numbers of bits).
"""


@dataclass(frozen=True)
class ValueEvidence:
    """What the values of one column say, over all logs.

    Args:
        low: smallest value.
        high: largest value.
        noise: standard deviation of white noise, from second differences.
        step: smallest difference between different values: the resolution, 0 if it has none.
        is_whole: whether all values are whole numbers.
        is_constant: whether it has one value only.
        stays: largest number of samples in a row with one value.
        turn: counts after which it wraps, None where it does not.
    """

    low: float
    high: float
    noise: float
    step: float
    is_whole: bool
    is_constant: bool
    stays: int
    turn: float | None

    @property
    def width(self) -> float:
        """Difference between the largest and the smallest value."""
        return self.high - self.low


def value_evidence(columns: Sequence[Floats]) -> ValueEvidence:
    """Return what the values of a column in several logs say, (n_samples,) each."""
    present = [column[np.isfinite(column)] for column in columns]
    pooled = np.concatenate(present)
    low = float(pooled.min())
    high = float(pooled.max())
    second = np.concatenate([np.diff(values, 2) for values in present])
    return ValueEvidence(
        low=low,
        high=high,
        noise=NORMAL_MAD * float(np.median(np.abs(second))) / np.sqrt(SECOND_DIFFERENCE),
        step=_step(pooled),
        is_whole=bool(np.all(pooled == np.round(pooled))),
        is_constant=high - low <= SAME * max(abs(low), abs(high), 1e-300),
        stays=max(longest_run(values)[1] for values in present),
        turn=_turn(present, high - low),
    )


def longest_run(values: Floats) -> tuple[int, int]:
    """Return where the longest run of equal values begins, and its number of samples."""
    ends = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0.0, [True]]))
    longest = int(np.argmax(np.diff(ends)))
    return int(ends[longest]), int(np.diff(ends)[longest])


def _step(values: Floats) -> float:
    """Return the resolution: the step of which all differences are multiples, 0 if there is
    none.
    """
    different = np.unique(values)
    if len(different) < 3 or len(different) > len(values) / 2:
        return 0.0
    gaps = np.diff(different)
    step = float(np.quantile(gaps, 0.05))
    multiples = gaps / step
    is_grid = np.mean(np.abs(multiples - np.round(multiples)) < 0.1) > 0.9
    return step if is_grid else 0.0


def _turn(columns: Sequence[Floats], width: float) -> float | None:
    """Return after how many counts a column wraps, None where it does not: its
    usual steps are small, and beside them a wrap is a whole turn.
    """
    steps = np.concatenate([np.abs(np.diff(values)) for values in columns])
    wraps = steps[steps > HALF_TURN * width]
    if len(wraps) < 2:
        return None
    usual = float(np.quantile(steps, 0.95))
    # a step across the wrap is shorter than the turn by what it would be elsewhere
    seen = float(np.median(wraps)) + usual / 2.0
    turn = float(TURNS[np.argmin(np.abs(TURNS - seen))])
    return turn if abs(turn - seen) <= usual and usual < HALF_TURN * width else None


def unwrapped(values: Floats, turn: float) -> Floats:
    """Return a column without its wraps, by neighbours that differ by less than half a `turn`.

    The `values`, (n_samples,), and the turn are in the same unit.
    """
    present = np.isfinite(values)
    result = values.copy()
    result[present] = np.unwrap(values[present], period=turn)
    return result
