"""Stamps of a log: numbers of any epoch and unit, ISO text, datetimes; time counts from the start, the original is kept."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from distal.errors import LogError
from distal.logs.csv_files import MISSING
from distal.logs.tables import Cells, numbers_of

if TYPE_CHECKING:
    import polars

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]

EPOCH, LATEST = 1e8, 9e9
"""Seconds since 1970 between which a stamp is a date (1973 to 2255): what is smaller counts from a start of its own."""

UNITS = (1.0, 1e-3, 1e-6, 1e-9)
"""Units in which dates are counted [s]."""


@dataclass(frozen=True)
class Clock:
    """Time of the samples of a log.

    Args:
        time: [s], (k,): from the first sample on where the stamps are dates, else as they are.
        stamps: since 1970 [ns], (k,), where they are dates, else None.
    """

    time: Floats
    stamps: Stamps | None = None

    @property
    def start(self) -> int | None:
        """When it begins, since 1970 [ns], None where it has no dates."""
        return None if self.stamps is None else int(self.stamps[0])

    def since(self, start: int | None) -> Floats:
        """Return the time from a first stamp of another file on [s]; as it is where either has no dates.

        Args:
            start: since 1970 [ns], or None.
        """
        if start is None or self.stamps is None:
            return self.time
        return np.asarray((self.stamps - start) * 1e-9, dtype=np.float64)


def clock_of(cells: Cells, name: str, unit: float) -> Clock:
    """Return the time of a table's rows.

    Dates counted in another unit than the rig says are recognised by their size: 1.8e18 can only be nanoseconds.

    Args:
        cells: the open table.
        name: of the time column.
        unit: in which the rig says that numbers are [s].

    Raises:
        LogError: a stamp is missing or is none, or is of no time at all.
    """
    import polars

    column, path, first_row = cells.frame[name], cells.path, cells.first_row
    if column.dtype == polars.Date or column.dtype == polars.Datetime:
        if getattr(column.dtype, "time_unit", None) == "ns":
            return _dated(_there(column.to_physical(), name, path, first_row))
        dates = _in_ns(column.cast(polars.Datetime("us")).to_physical())
        return _dated(_there(dates, name, path, first_row, column.cast(polars.String)))
    if column.dtype == polars.String:
        text = column.str.strip_chars()
        whole = text.cast(polars.Int64, strict=False)
        if not whole.null_count():
            return _counted(whole.to_numpy(), unit, name, path)
        first = next((cell for cell in text if cell is not None and cell.lower() not in MISSING), "")
        if _is_date(first):
            return _dated(_there(_dates(text), name, path, first_row, text))
    elif column.dtype.is_integer() and not column.null_count():
        try:
            return _counted(column.cast(polars.Int64).to_numpy(), unit, name, path)
        except polars.exceptions.PolarsError:
            raise LogError(f"{path}: column '{name}' holds {column[0]}, which is no time") from None
    return _counted(numbers_of(cells, name), unit, name, path)


def _counted(values: Any, unit: float, name: str, path: Path) -> Clock:
    """Return the time of stamps that are numbers, whole ones to the nanosecond."""
    there = values[np.isfinite(values)]
    if not len(there):
        return Clock(values.astype(np.float64) * unit)
    size = abs(float(there[0])) * unit
    if size < EPOCH:
        return Clock(values.astype(np.float64) * unit)
    if size >= LATEST:
        fits = [other for other in UNITS if EPOCH <= abs(float(there[0])) * other < LATEST]
        if not fits:
            raise LogError(
                f"{path}: '{name}' is {there[0]}, {size:g} s, which is no time; what unit has it? (log.time.unit)"
            )
        unit = fits[0]
    far = np.flatnonzero(~(np.abs(values.astype(np.float64)) * unit < LATEST) & np.isfinite(values))
    if len(far):
        raise LogError(f"{path}: '{name}' is {values[far[0]]} in a log that begins with {values[0]}, which is no time")
    if values.dtype == np.int64:
        stamps: Stamps = values * np.int64(round(unit * 1e9))
        return _dated(stamps)
    # differences of floats are exact where the stamps themselves are near each other
    time = (values - values[0]) * unit
    if not np.isfinite(values).all():
        return Clock(time)
    return Clock(time, np.int64(round(float(values[0]) * unit * 1e9)) + np.round(time * 1e9).astype(np.int64))


def _dated(stamps: Stamps) -> Clock:
    return Clock((stamps - stamps[0]) * 1e-9, stamps)


def _is_date(text: str) -> bool:
    """Return whether a text begins as an ISO date does: with a year, and no number in all."""
    return len(text) >= 8 and text[:4].isdigit() and not _is_number(text)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _dates(text: polars.Series) -> polars.Series:
    """Return ISO dates as nanoseconds since 1970, null where one is none; without a zone they are taken as UTC."""
    import polars

    try:
        dates = text.str.to_datetime(time_unit="us", time_zone="UTC", strict=False).to_physical()
        # a fraction of more than six digits is read by itself
        found = _in_ns(dates.set(text.str.contains(r"\.\d{7,}"), None)).to_list()
    except polars.exceptions.PolarsError:
        found = [None] * len(text)
    # a clock that prints whole seconds without a fraction changes its format on the way
    cells = [number if number is not None else _one_date(cell) for number, cell in zip(found, text)]
    return polars.Series(cells, dtype=polars.Int64)


def _in_ns(dates: polars.Series) -> polars.Series:
    """Return microseconds since 1970 as nanoseconds, null where they would be beyond what 64 bits hold."""
    import polars

    there = dates.abs() < int(LATEST * 1e6)
    frame = polars.DataFrame({"dates": dates, "there": there})
    return frame.select(polars.when("there").then(polars.col("dates") * 1000)).to_series()


def _one_date(cell: str | None) -> int | None:
    try:
        date = datetime.fromisoformat((cell or "").replace(",", "."))
    except ValueError:
        return None
    date = date if date.tzinfo is not None else date.replace(tzinfo=UTC)
    whole = date.replace(microsecond=0)
    fraction = re.search(r"[.,](\d{1,9})\d*(?=$|[Zz+-])", cell or "")
    rest = int(fraction[1].ljust(9, "0")) if fraction is not None else 0
    stamp = int(whole.timestamp()) * 1_000_000_000 + rest
    return stamp if abs(stamp) < LATEST * 1e9 else None


def _there(stamps: polars.Series, name: str, path: Path, first_row: int, text: polars.Series | None = None) -> Stamps:
    """Return stamps of which none is missing, as an array."""
    missing = np.flatnonzero(stamps.is_null().to_numpy())
    if len(missing):
        row = int(missing[0])
        came = f"'{text[row]}' is no date" if text is not None else "the stamp is missing"
        raise LogError(
            f"{path}: row {row + first_row}, column '{name}': {came}; ISO text such as 2026-11-20T21:02:47.5Z is one"
        )
    values: Stamps = stamps.to_numpy()
    return values
