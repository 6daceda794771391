"""Stamps of a log: numbers of any epoch and unit, ISO text, or datetimes.

Time counts from the start of a log with dates; its original stamps are kept.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.errors import DistalWarning, LogError
from distal.logs.cells import MISSING, Cells, is_plain, parsed_cells

Stamps = NDArray[np.int64]
"""Stamps since 1970 [ns], (n,)."""

EPOCH = 1e8
"""Earliest stamp that is taken for a date, in 1973 [s since 1970]; smaller stamps count from a
start of their own. Source: judgement.
"""

LATEST = 9e9
"""Latest stamp that is taken for a date, in 2255 [s since 1970]. Source: judgement."""

REWOUND = 3
"""Number of late stamps in a row, each newer than the one before, after which the clock counts as
set back [1]. Source: judgement.
"""

FRACTION = re.compile(r"[.,](\d+)")
"""Fraction of a second in an ISO date."""

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

    @property
    def start(self) -> int | None:
        """When the log begins, since 1970 [ns]; None for a log without dates."""
        return None if self.stamps is None else int(self.stamps[0])

    def since(self, start: int | None) -> Floats:
        """Return the time counted from the `start` of another log [s], (n,).

        Args:
            start: when the other log begins, since 1970 [ns]. Where either log has no dates, the
                time is returned unchanged.
        """
        if start is None or self.stamps is None:
            return self.time
        return np.asarray((self.stamps - start) * 1e-9, dtype=np.float64)


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
    column = cells.column(name)
    path = cells.path
    first_row = cells.first_row
    if isinstance(column, list):
        counts = _whole_values(column)
        if counts is not None:
            return _counted(counts, unit, name, path)
        first = next((text for text in map(str.strip, column) if text.lower() not in MISSING), "")
        if _is_date(first):
            return _dated(
                [_one_date(cell.strip()) for cell in column], column, name, path, first_row
            )
    elif column.dtype.kind == "M":
        return _dated(_in_ns(column), np.datetime_as_string(column).tolist(), name, path, first_row)
    elif column.dtype.kind in "iu":
        if column.dtype == np.uint64 and len(column) and column.max() > np.iinfo(np.int64).max:
            raise LogError(f"{path}: column '{name}' holds {column.max()}, which is no time")
        return _counted(column.astype(np.int64), unit, name, path)
    return _counted(parsed_cells(column, path, name, first_row), unit, name, path)


def _whole_values(cells: list[str]) -> Stamps | None:
    """Return the cells as 64-bit integers, or None where a cell is something else."""
    try:
        return (
            np.fromiter(map(int, cells), np.int64, len(cells)) if is_plain("".join(cells)) else None
        )
    except (ValueError, OverflowError):
        return None


def _counted(values: Any, unit: float, name: str, path: Path) -> Clock:
    """Return the time of numeric stamps; integers keep every nanosecond."""
    finite = values[np.isfinite(values)]
    first = abs(float(finite[0])) if len(finite) else 0.0
    if first * unit < EPOCH:
        return Clock(values.astype(np.float64) * unit)
    if first * unit >= LATEST:
        fits = [candidate for candidate in UNITS if EPOCH <= first * candidate < LATEST]
        if not fits:
            raise LogError(
                f"{path}: '{name}' is {finite[0]}, {first * unit:g} s, which is no time; what "
                "unit has it? (log.time.unit)"
            )
        unit = fits[0]
    far = np.flatnonzero(~(np.abs(values.astype(np.float64)) * unit < LATEST) & np.isfinite(values))
    if len(far):
        raise LogError(
            f"{path}: '{name}' is {values[far[0]]} in a log that begins with {values[0]}, which "
            "is no time"
        )
    if values.dtype == np.int64:
        stamps: Stamps = values * np.int64(round(unit * 1e9))
        return _clock(stamps)
    # differences of floats are exact where the stamps themselves are near each other
    time = (values - values[0]) * unit
    if not np.isfinite(values).all():
        return Clock(time)
    return Clock(
        time, np.int64(round(float(values[0]) * unit * 1e9)) + np.round(time * 1e9).astype(np.int64)
    )


def _clock(stamps: Stamps) -> Clock:
    return Clock((stamps - stamps[0]) * 1e-9, stamps)


def _dated(
    stamps: Sequence[int | None], cells: Sequence[str], name: str, path: Path, first_row: int
) -> Clock:
    """Return the time of stamps since 1970 [ns], none of which may be missing; `cells` holds them
    as written in the file.
    """
    row = next((row for row, stamp in enumerate(stamps) if stamp is None), None)
    if row is not None:
        raise LogError(
            f"{path}: row {row + first_row}, column '{name}': '{cells[row]}' is no date; ISO text "
            "such as "
            "2026-11-20T21:02:47.5Z is one"
        )
    return _clock(np.array(stamps, dtype=np.int64))


def _is_date(text: str) -> bool:
    """Return whether a text begins as an ISO date does, with a year, and is not a number."""
    try:
        float(text)
    except ValueError:
        return len(text) >= 8 and text[:4].isdigit()
    return False


def _in_ns(dates: NDArray[Any]) -> list[int | None]:
    """Return dates as nanoseconds since 1970; None for a missing date and for one too far from
    1970.
    """
    seconds = dates.astype("datetime64[s]").astype(np.int64)
    is_date = ~np.isnat(dates) & (np.abs(seconds) < LATEST)
    stamps = dates.astype("datetime64[ns]").astype(np.int64)
    return [stamp if valid else None for stamp, valid in zip(stamps.tolist(), is_date.tolist())]


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
    return round(seconds) * 10**9 + int(f"{digits:0<9}"[:9]) if abs(seconds) < LATEST else None


def set_backs(stamps: Floats | Stamps) -> NDArray[np.int64]:
    """Return the indices of stamps, (n,), before which the clock was set back: they and the next
    ones rise, and all are late.
    """
    back = np.flatnonzero(np.diff(stamps) < 0) + 1
    return np.array(
        [
            i
            for i in back
            if i + REWOUND <= len(stamps)
            # after a stamp that is wild by itself the clock goes on where it was
            and not (i > 1 and stamps[i] > stamps[i - 2])
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
        warnings.warn(
            f"{source}: the clock was set back {len(ends)} times; only part {at + 1} of "
            f"{len(ends) + 1} is read, the longest",
            DistalWarning,
            stacklevel=4,
        )
    return slice(edges[at], edges[at + 1])
