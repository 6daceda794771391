"""Tables from files: CSV or Parquet, every refusal names file, row, column, what came and what is allowed."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from distal.errors import LogError, did_you_mean

if TYPE_CHECKING:
    import polars

Floats = NDArray[np.float64]

MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-"})
"""Texts of a cell that mean a missing value, in any case."""


@dataclass(frozen=True)
class Table:
    """Columns of a file, all read as numbers.

    Args:
        source: the file's name.
        columns: name → values, NaN where missing.
        first_row: row number of the first value in the file, as an editor counts.
    """

    source: str
    columns: dict[str, Floats]
    first_row: int


def read_table(path: str | Path, wanted: Sequence[str] | None = None) -> Table:
    """Read columns of a CSV or Parquet file as numbers.

    Args:
        path: the file; ``.parquet`` is Parquet, anything else CSV with a header, separated by comma, semicolon or tab.
        wanted: columns that must be there; None reads all.

    Raises:
        LogError: it cannot be read, a column is missing or doubled, a cell is not a number, a row is short or long, or
            there is no row.
    """
    frame, source, first_row = open_table(path)
    return table_of(frame, source, first_row, wanted)


def open_table(path: Any, index_name: str | None = None) -> tuple[polars.DataFrame, Path, int]:
    """Return the cells of a CSV or Parquet file, or of a polars or pandas frame, what to call it, and its first row.

    Args:
        path: a path or a frame.
        index_name: a pandas frame that lacks this column has it from an index of dates.

    Raises:
        LogError: it cannot be read, or is neither.
    """
    import polars

    if isinstance(path, (str, Path)):
        path = Path(path)
        try:
            folder = path.is_dir()
        except OSError as problem:
            raise LogError(f"{str(path)[:80]}…: cannot be read ({problem.strerror})") from None
        if folder:
            raise LogError(f"{path}: is a folder; a CSV or Parquet file is expected")
        parquet = path.suffix.lower() in (".parquet", ".pq")
        return (_parquet(path), path, 1) if parquet else (_csv(path), path, 2)
    if isinstance(path, polars.DataFrame):
        return path, Path("the frame"), 0
    if not hasattr(path, "columns"):
        raise LogError(f"a log is a path, a frame or a distal.Log; {type(path).__name__} came")
    columns = {str(name): _plain(path[name]) for name in path.columns}
    index = getattr(path, "index", None)
    if index_name is not None and index_name not in columns and _is_dated(index):
        columns[index_name] = _plain(index)
    return polars.DataFrame(columns), Path("the frame"), 0


def _is_dated(column: Any) -> bool:
    """Return whether a column or an index of pandas holds dates."""
    return str(getattr(column, "dtype", "")).startswith("datetime64")


def _plain(column: Any) -> Any:
    """Return a column or an index of pandas as NumPy has it, dates with a zone in UTC."""
    if _is_dated(column) and getattr(column.dtype, "tz", None) is not None:
        dates = getattr(column, "dt", column)
        column = dates.tz_convert(None)
    return column.to_numpy()


def table_of(
    frame: polars.DataFrame, path: Path, first_row: int, wanted: Sequence[str] | None, optional: Iterable[str] = ()
) -> Table:
    """Return columns of an open table as numbers; see `read_table`.

    Args:
        frame: the cells.
        path: what to call it.
        first_row: row number of its first value.
        wanted: columns that must be there; None takes all.
        optional: columns that are taken where they are there.

    Raises:
        LogError: a column is missing or does not hold numbers, or there is no row.
    """
    names = list(frame.columns) if wanted is None else [*wanted, *(c for c in optional if c in frame.columns)]
    check_columns(frame, path, names)
    return Table(
        str(path), {name: numbers_of(frame, name, path, first_row) for name in dict.fromkeys(names)}, first_row
    )


def check_columns(frame: polars.DataFrame, path: Path, names: Iterable[str]) -> None:
    """Refuse an open table that lacks a column, or has no row.

    Args:
        frame: the cells.
        path: what to call it.
        names: columns that must be there.

    Raises:
        LogError: see above.
    """
    for name in names:
        if name not in frame.columns:
            raise LogError(f"{path}: column '{name}' is missing{did_you_mean(name, frame.columns)}")
    if frame.height == 0:
        raise LogError(f"{path}: has a header but no rows")


def _parquet(path: Path) -> polars.DataFrame:
    import polars

    try:
        return polars.read_parquet(path)
    except OSError as problem:
        raise LogError(f"{path}: cannot be read ({problem.strerror or problem})") from None
    except polars.exceptions.PolarsError as problem:
        raise LogError(f"{path}: is not a Parquet file ({str(problem).splitlines()[0]})") from None


def _csv(path: Path) -> polars.DataFrame:
    """Return a CSV's cells as text."""
    import polars

    try:
        data = path.read_bytes()
    except OSError as problem:
        raise LogError(f"{path}: cannot be read ({problem.strerror or problem})") from None
    data = data.removeprefix(b"\xef\xbb\xbf").lstrip(b"\r\n")
    if not data.strip():
        raise LogError(f"{path}: is empty")
    if b"\0" in data[:4096]:
        raise LogError(f"{path}: is not text; a CSV file is expected (Parquet needs the ending .parquet)")
    header = data.split(b"\n", 1)[0]
    separator = max((",", ";", "\t"), key=lambda mark: header.count(mark.encode()))
    # blank lines at the end are no rows; with tabs, one may be an empty last cell
    data = data.rstrip(b"\r\n " if separator == "\t" else None)
    _check_widths(path, data, separator)
    try:
        frame = polars.read_csv(data, separator=separator, infer_schema=False, null_values=None)
    except polars.exceptions.PolarsError as problem:
        raise LogError(f"{path}: cannot be read as CSV ({str(problem).splitlines()[0]})") from None
    return frame.rename(lambda name: name.strip())


def _check_widths(path: Path, data: bytes, separator: str) -> None:
    """Raise where the header repeats a name, or a row is shorter or longer than it."""
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as problem:
        row = data[: problem.start].count(b"\n") + 1
        raise LogError(f"{path}: row {row}: is not UTF-8 text") from None
    if text.startswith("#"):
        raise LogError(f"{path}: row 1: begins with '#'; comment lines are not supported, remove them")
    if '"' in text:
        try:
            rows = list(csv.reader(text.split("\n"), delimiter=separator))
        except csv.Error as problem:
            raise LogError(f"{path}: cannot be read as CSV ({problem}); is a quote not closed?") from None
        header, widths = rows[0], np.array([len(row) for row in rows])
    else:
        lines = text.split("\n")
        header = lines[0].split(separator)
        widths = np.array([line.count(separator) + 1 if line.strip() else 0 for line in lines])
    names = [name.strip() for name in header]
    for name in names:
        if names.count(name) > 1:
            raise LogError(f"{path}: the header has column '{name}' more than once; names must differ")
    blank = np.flatnonzero(widths == 0)
    last = len(widths) - 1
    while len(blank) and blank[-1] == last:
        blank, last = blank[:-1], last - 1
    if len(blank):
        raise LogError(f"{path}: row {blank[0] + 1}: is blank; remove it")
    wrong = np.flatnonzero(widths[: last + 1] != len(names))
    if len(wrong):
        kind = "short" if widths[wrong[0]] < len(names) else "long"
        raise LogError(
            f"{path}: row {wrong[0] + 1}: is too {kind} ({widths[wrong[0]]} cells; the header has {len(names)})"
        )


def numbers_of(frame: polars.DataFrame, name: str, path: Path, first_row: int) -> Floats:
    """Return a column as numbers, NaN where a cell is missing.

    Args:
        frame: the cells.
        name: of the column.
        path: what to call the table.
        first_row: row number of its first value.

    Raises:
        LogError: a cell is no finite number.
    """
    import polars

    column = frame[name]
    if column.dtype != polars.String:
        if not column.dtype.is_numeric():
            raise LogError(f"{path}: column '{name}' holds {column.dtype}; numbers are expected")
        held = column.cast(polars.Float64).fill_null(float("nan")).to_numpy()
        infinite = np.flatnonzero(np.isinf(held))
        if len(infinite):
            _refuse(path, int(infinite[0]) + first_row, name, str(column[int(infinite[0])]))
        return held
    text = column.str.strip_chars()
    missing = text.str.to_lowercase().is_in(list(MISSING))
    numbers = text.cast(polars.Float64, strict=False)
    bad = np.flatnonzero((numbers.is_null() & ~missing).to_numpy())
    if len(bad):
        _refuse(path, int(bad[0]) + first_row, name, str(column[int(bad[0])]))
    values = numbers.fill_null(float("nan")).to_numpy()
    infinite = np.flatnonzero(np.isinf(values))
    if len(infinite):
        _refuse(path, int(infinite[0]) + first_row, name, str(column[int(infinite[0])]))
    return values


def _refuse(path: Path, row: int, column: str, came: str) -> None:
    hint = "; write a decimal point, not a comma" if "," in came else ""
    raise LogError(
        f"{path}: row {row}, column '{column}': '{came}' is not a finite number{hint} (an empty cell is a missing value)"
    )
