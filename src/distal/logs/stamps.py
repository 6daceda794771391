"""Stamps of a log: numbers of any epoch and unit, ISO text, datetimes; time counts from the start,
the original is kept.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.errors import LogError
from distal.logs.cells import MISSING, Cells, is_plain, parsed_cells

Stamps = NDArray[np.int64]

EPOCH = 1e8
LATEST = 9e9
"""Seconds since 1970 between which a stamp is a date (1973 to 2255): what is smaller counts from a
start of its own.
"""

START = datetime(1970, 1, 1, tzinfo=UTC)
MICROSECOND = timedelta(microseconds=1)

FINER = re.compile(r"[.,]\d{6}(\d{1,3})")
LONGEST = len("20261120T210247.123456")

UNITS = (1.0, 1e-3, 1e-6, 1e-9)
"""Units in which dates are counted [s]."""


@dataclass(frozen=True)
class Clock:
    """Time of the samples of a log [s], (k,), and where they are dates their stamps since 1970
    [ns], (k,).

    The time then counts from the first sample on.
    """

    time: Floats
    stamps: Stamps | None = None

    @property
    def start(self) -> int | None:
        """When it begins, since 1970 [ns], None where it has no dates."""
        return None if self.stamps is None else int(self.stamps[0])

    def since(self, start: int | None) -> Floats:
        """Return the time from the `start` of another log on [s]; as it is where either has no
        dates.
        """
        if start is None or self.stamps is None:
            return self.time
        return np.asarray((self.stamps - start) * 1e-9, dtype=np.float64)


def clock_of(cells: Cells, name: str, unit: float) -> Clock:
    """Return the time of a table's rows.

    Dates counted in another `unit` than the rig says [s] are recognised by their size: 1.8e18 can
    only be nanoseconds. A `LogError` says which stamp is missing or is none, or is of no time at
    all.
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
    """Return whole numbers of 64 bits, None where a cell is something else."""
    try:
        return (
            np.fromiter(map(int, cells), np.int64, len(cells)) if is_plain("".join(cells)) else None
        )
    except (ValueError, OverflowError):
        return None


def _counted(values: Any, unit: float, name: str, path: Path) -> Clock:
    """Return the time of stamps that are numbers, whole ones to the nanosecond."""
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
    """Return the time of stamps since 1970 [ns] of which none may be missing; `cells` is how they
    were written.
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
    """Return whether a text begins as an ISO date does, with a year, and is no number."""
    try:
        float(text)
    except ValueError:
        return len(text) >= 8 and text[:4].isdigit()
    return False


def _in_ns(dates: NDArray[Any]) -> list[int | None]:
    """Return dates as nanoseconds since 1970, None where there is none or 64 bits do not hold
    it.
    """
    seconds = dates.astype("datetime64[s]").astype(np.int64)
    is_date = ~np.isnat(dates) & (np.abs(seconds) < LATEST)
    stamps = dates.astype("datetime64[ns]").astype(np.int64)
    return [stamp if valid else None for stamp, valid in zip(stamps.tolist(), is_date.tolist())]


def _one_date(cell: str) -> int | None:
    """Return an ISO date as nanoseconds since 1970, None where it is none; without a zone it is
    taken as UTC.
    """
    if cell[4:5] in "/.":
        cell = cell[:10].replace(cell[4:5], "-") + cell[10:]
    try:
        date = datetime.fromisoformat(cell)
    except ValueError:
        return None
    stamp = (
        ((date if date.tzinfo is not None else date.replace(tzinfo=UTC)) - START)
        // MICROSECOND
        * 1000
    )
    finer = (
        FINER.search(cell) if len(cell) > LONGEST else None
    )  # Python leaves out what is below a microsecond
    if finer is not None:
        stamp += int(finer[1].ljust(3, "0"))
    return stamp if abs(stamp) < LATEST * 1e9 else None
