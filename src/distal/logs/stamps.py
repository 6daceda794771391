"""Stamps of a log: numbers of any epoch and unit, ISO text, datetimes, or times of a clock.

Time counts from the start of a log with dates; its original stamps are kept.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.errors import LogError
from distal.logs.raw_to_si import IMPROBABLE
from distal.logs.table_cells import Cells, Column, say, whole_values

Stamps = NDArray[np.int64]
"""Stamps since 1970 [ns], (n,)."""

EPOCH = 1e8
"""Earliest stamp that is taken for a date, in 1973 [s since 1970]; smaller stamps count from a
start of their own. Source: judgement.
"""

LATEST_DATE = 9e9
"""Latest stamp that is taken for a date, in 2255 [s since 1970]. Source: judgement."""

REWOUND = 3
"""Number of late stamps in a row, each newer than the one before, after which the clock counts as
set back [1]. Source: judgement.
"""

FRACTION = re.compile(r"[.,](\d+)")
"""Fraction of a second in an ISO date."""

CLOCK = re.compile(
    r"(?:.*[\sT,])?(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,:]\d+)?)|(\.\d+))?\s*"
    r"(?:([AaPp])\.?[Mm]\.?)?(?:\s[A-Za-z].*|\s\d{4})?"
)
"""A time of day, with or without a date in an order of its own: hours, minutes, seconds, a or p; or
minutes, seconds and a fraction, as spreadsheets show it.
"""

DAY = 86_400.0
"""A day [s]. Source: definition (unit conversion)."""

COUNTERS = (2**16, 2**32)
"""Numbers after which counters begin anew [1]. Source: definition (16 and 32 bits)."""

UNITS = (1.0, 1e-3, 1e-6, 1e-9)
"""Units in which dates may be counted: s, ms, µs, ns [s]. Source: definition (unit conversion)."""


@dataclass(frozen=True)
class Clock:
    """Time of a log's samples [s], (n,).

    For a log with dates, `stamps` are its original stamps since 1970 [ns], (n,), and time counts
    from the first sample.
    """

    time: Floats
    stamps: Stamps | None = None


def clock_of(cells: Cells, name: str, unit: float) -> Clock:
    """Return the time of a table's rows.

    Dates that are counted in another unit than the rig's are recognised by their size: 1.8e18 can
    only be nanoseconds.

    Args:
        name: name of the time column.
        unit: unit of the time column by the rig or the header [s].

    Raises:
        LogError: a date is missing or cannot be read, or a number is too large for a date in any
            unit.
    """
    column = cells.columns[name]
    if is_time(column):
        if not isinstance(column, list) or is_date(column[0].strip()):
            return dated(_dates(column, cells, name))
        return Clock(_of_day(column, cells, name))
    counts = whole_values(column)
    values = cells.values(name) if counts is None else counts
    return _counted(values, unit, name, cells.path)


def _counted(values: NDArray[Any], unit: float, name: str, path: Path) -> Clock:
    """Return the time of numeric stamps; integers keep every nanosecond. A stamp that is no time is
    infinite.
    """
    is_counter = values.dtype == np.int64 and len(values) > 1 and values.min() >= 0
    for period in COUNTERS if is_counter else ():
        unwrapped = np.unwrap(values, period=period)
        steps = np.diff(unwrapped)
        anew = np.diff(values) < 0
        # beyond its last number a counter goes on as before
        if values.max() < period and np.abs(steps[anew]).max(initial=0) <= 2 * np.median(steps):
            values = unwrapped
    finite = np.abs(values[np.isfinite(values)])
    usual = float(np.median(finite)) if len(finite) else 0.0
    if usual * unit < EPOCH:
        return Clock(values.astype(np.float64) * unit)
    if usual * unit >= LATEST_DATE:
        fits = [candidate for candidate in UNITS if EPOCH <= usual * candidate < LATEST_DATE]
        if not fits:
            raise LogError(
                f"{path}: '{name}' is {values[0]}, {values[0] * unit:g} s, which is no time; what "
                "unit has it? (log.time.unit)"
            )
        unit = fits[0]
    far = np.abs(values.astype(np.float64)) * unit >= LATEST_DATE
    first = values[~far & np.isfinite(values)][0]
    # differences of floats are exact where the stamps themselves are near each other
    since = np.where(far, 0, values - first)
    dates = None
    if np.isfinite(since).all():
        size = round(unit * 1e9)
        dates = round(first * size) + np.round(since * size).astype(np.int64)
    return Clock(np.where(far, np.inf, since * unit), dates)


def dated(stamps: Stamps) -> Clock:
    """Return the time of samples with dates [ns since 1970], (n,)."""
    return Clock((stamps - stamps[0]) * 1e-9, stamps)


def _dates(column: Column, cells: Cells, name: str) -> Stamps:
    """Return dates as nanoseconds since 1970, none of which may be missing."""
    if isinstance(column, list):
        dates = np.array([_one_date(cell.strip()) for cell in column], "datetime64[ns]")
    else:
        seconds = column.astype("datetime64[s]").astype(np.int64)
        dates = column.astype("datetime64[ns]")
        dates[np.abs(seconds) >= LATEST_DATE] = "NaT"
    bad = np.flatnonzero(np.isnat(dates))
    if len(bad):
        raise LogError(
            f"{cells.path}: row {bad[0] + cells.first_row}, column '{name}': '{column[bad[0]]}' "
            "is no date; ISO text such as 2026-11-20T21:02:47.5Z is one"
        )
    return dates.astype(np.int64)


def _of_day(column: list[str], cells: Cells, name: str) -> Floats:
    """Return times of day since the first one [s]; over midnight they go on."""
    time = np.empty(len(column))
    for k, cell in enumerate(column):
        match = CLOCK.fullmatch(cell.strip())
        if match is None:
            raise LogError(
                f"{cells.path}: row {k + cells.first_row}, column '{name}': '{cell}' is no time "
                "of day, such as 21:02:47.5 or 9:02:47 PM"
            )
        first, second, third, fraction, half = match.groups()
        if fraction is not None:
            time[k] = 60.0 * int(first) + float(second + fraction)
            continue
        hours = int(first) if half is None else int(first) % 12 + 12 * (half.lower() == "p")
        seconds = float(re.sub("[,:]", ".", third or "0"))
        time[k] = 3600.0 * hours + 60.0 * int(second) + seconds
    return np.asarray(np.unwrap(time, period=DAY / 24 if fraction else DAY) - time[0])


def is_time(column: Column) -> bool:
    """Return whether a column holds dates or times of day, by its first cell."""
    if not isinstance(column, list):
        return column.dtype.kind == "M"
    first = next(filter(None, map(str.strip, column)), "")
    return is_date(first) or CLOCK.fullmatch(first) is not None


def spread(time: Floats) -> Floats:
    """Return the times of rows, (k,), of which several have one stamp: evenly spread up to the next
    stamp [s].

    Of the first and the last stamp not all rows need be there: they are as far apart as those of
    the others usually are.
    """
    begins = np.flatnonzero(np.diff(time, prepend=-np.inf) != 0.0)
    counts = np.diff(begins, append=len(time))
    steps = np.diff(time[begins]) / counts[:-1]
    usual = float(np.median(steps))
    of_row = np.arange(len(time)) - np.repeat(begins, counts)
    even = time + of_row * np.repeat([*steps, usual], counts)
    first = counts[0]
    even[:first] = time[begins[1]] - usual * np.arange(first, 0, -1)
    return np.asarray(even)


def is_date(text: str) -> bool:
    """Return whether a text begins as an ISO date does, with a year, and is not a number."""
    try:
        float(text)
    except ValueError:
        return re.match(r"\d{4}([-/.]|\d{4}[T ])", text) is not None
    return False


def _one_date(cell: str) -> int | None:
    """Return an ISO date as nanoseconds since 1970, or None where the cell is no date; a date
    without a zone is in UTC.
    """
    if cell[4:5] in "/.":
        cell = cell[:10].replace(cell[4:5], "-") + cell[10:]
    fraction = FRACTION.search(cell)
    digits = "" if fraction is None else fraction[1]  # Python leaves out those below a microsecond
    try:
        date = datetime.fromisoformat(FRACTION.sub("", cell, count=1))
        seconds = (date if date.tzinfo is not None else date.replace(tzinfo=UTC)).timestamp()
    except (ValueError, OverflowError):
        return None
    return round(seconds) * 10**9 + int(f"{digits:0<9}"[:9]) if abs(seconds) < LATEST_DATE else None


@np.errstate(invalid="ignore")
def wild_stamps(stamps: Floats | Stamps) -> Bools:
    """Return which stamps, (n,), are wild by themselves: not between the one before and the one
    after, which are in order without it. Neighbours of which either may be wrong, such as two in
    the wrong order, are not wild. At an end a stamp is wild that is farther off than all n others
    are apart, where n is so large that waiting times without memory, of which the last one is
    longer than all before with a chance of 2^(1 − n), do not explain that; in shorter logs no stamp
    near an end is wild.
    """
    time = np.concatenate([[np.nan], stamps, [np.nan]])
    before = time[:-2]
    now = time[1:-1]
    after = time[2:]
    wild = ((now > after) | (now < before)) & (after > before)
    if 2.0 ** (2 - len(now)) >= IMPROBABLE:
        wild[:2] = wild[-2:] = False
    else:
        for inwards, is_wild in ((now, wild), (now[::-1], wild[::-1])):
            off = np.abs(inwards[1:3] - inwards[0]).min()
            is_wild[0] = off > abs(inwards[1] - inwards[-1])
    wild |= np.isinf(now)
    beside = np.pad(wild, 1)
    alone: Bools = wild & ~beside[:-2] & ~beside[2:]
    return alone


def set_backs(stamps: Floats | Stamps) -> NDArray[np.int64]:
    """Return the indices of stamps, (n,), before which the clock was set back: they and the next
    ones rise, and all are late.
    """
    back = np.flatnonzero(stamps[1:] < stamps[:-1]) + 1
    return np.array(
        [
            i
            for i in back
            if i + REWOUND <= len(stamps)
            and (np.diff(stamps[i : i + REWOUND]) > 0).all()
            and stamps[i + REWOUND - 1] < stamps[i - 1]
        ],
        dtype=np.int64,
    )


def longest_part(ends: NDArray[np.int64], n: int, source: str) -> slice:
    """Return the longest of the parts between the indices `ends` of n samples, and warn where there
    are several.
    """
    edges = [0, *ends.tolist(), n]
    at = int(np.argmax(np.diff(edges)))
    if len(ends):
        say(
            f"{source}: the clock was set back {len(ends)} times; only part {at + 1} of "
            f"{len(ends) + 1} is read, the longest"
        )
    return slice(edges[at], edges[at + 1])


def in_order(time: Floats, source: str, first_row: int) -> NDArray[np.intp]:
    """Return the indices of the rows of a log that are read: without those whose stamp is wild, the
    longest part in which the clock was not set back. What is left out is said.

    Args:
        time: stamps [s], (n,).
        source: what the log is called in messages.
        first_row: row number of the first stamp in its file.
    """
    left_out = np.isnan(time)
    stamped = np.flatnonzero(~left_out)
    left_out[stamped] = wild_stamps(time[stamped])
    say_wild(source, left_out, f"row {int(left_out.argmax()) + first_row}")
    rows = np.flatnonzero(~left_out)
    ends = set_backs(time[rows])
    sorted_rows = rows[np.argsort(time[rows], kind="stable")]
    steps = np.diff(time[rows])
    # of two runs some rows are nearer than half a step
    if len(ends) and 2.0 * np.diff(time[sorted_rows]).min() > np.median(steps[steps > 0.0]):
        say(
            f"{source}: rows were not in the order of their stamps: sorted; did the clock begin "
            "anew?"
        )
        return sorted_rows
    return rows[longest_part(ends, len(rows), source)]


def say_wild(source: str, wild: Bools, first: str) -> None:
    """Warn where stamps are wild; `first` says where the first one is."""
    count = int(wild.sum())
    if count:
        say(f"{source}: {first} left out, {count} in all: a stamp missing, out of order or far off")
