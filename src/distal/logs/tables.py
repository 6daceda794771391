"""Tables from files: CSV or Parquet, every refusal names file, row, column, what came and what is allowed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from distal.errors import LogError, did_you_mean
from distal.logs.csv_files import MISSING, read_csv
from distal.logs.headers import header, scale, units_of
from distal.logs.reader_process import parquet_by_process
from distal.logs.targets import shown

if TYPE_CHECKING:
    import polars

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Cells:
    """An open table, its cells as they came.

    Args:
        frame: the cells of the columns that were read.
        path: what to call it.
        first_row: row number of the first value in the file, as an editor counts.
        names: of all its columns, also of those that were not read; without units where they were asked for so.
        units: name → unit, of those whose header says it beside the name that was asked for.
    """

    frame: polars.DataFrame
    path: Path
    first_row: int
    names: tuple[str, ...]
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Table:
    """Columns of a file, all read as numbers.

    Args:
        source: the file's name.
        columns: name → values, NaN where missing.
        first_row: row number of the first value in the file, as an editor counts.
        units: name → unit, of those whose header says it beside the name.
    """

    source: str
    columns: dict[str, Floats]
    first_row: int
    units: Mapping[str, str] = field(default_factory=dict)

    def in_si(self, name: str, si: str) -> Floats:
        """Return a column in SI by the unit in its header; as it is where the header says none.

        Args:
            name: of the column.
            si: unit of the dimension that is wanted.

        Raises:
            LogError: the header's unit is another dimension's, or none.
        """
        unit = self.units.get(name)
        return self.columns[name] * scale(unit, si, f"{self.source}: column '{header(name, unit or '')}'")


def read_table(path: str | Path, wanted: Sequence[str] | None = None) -> Table:
    """Read columns of a CSV or Parquet file as numbers.

    Args:
        path: the file; ``.parquet`` is Parquet, anything else CSV with a header, separated by comma, semicolon or tab.
        wanted: columns that must be there; None reads all.

    Raises:
        LogError: it cannot be read, a column is missing or doubled, a cell is not a number, a row is short or long, or
            there is no row.
    """
    return table_of(open_table(path, wanted), wanted)


def open_table(path: Any, columns: Sequence[str] | None = None, index_name: str | None = None) -> Cells:
    """Return the cells of a CSV or Parquet file, or of a polars or pandas frame.

    Args:
        path: a path or a frame.
        columns: that are needed, with or without their units; None needs all. Others may be left out where a format
            allows that.
        index_name: a pandas frame that lacks this column has it from an index of dates.

    Raises:
        LogError: it cannot be read, or is neither.
    """
    cells = _opened(path, columns, index_name)
    said = units_of(cells.names, columns or (), str(cells.path))
    plain = {text: name for name, (text, _) in said.items()}
    return replace(
        cells,
        frame=cells.frame.rename(plain) if plain else cells.frame,
        names=tuple(plain.get(name, name) for name in cells.names),
        units={name: unit for name, (_, unit) in said.items()},
    )


def _opened(path: Any, columns: Sequence[str] | None, index_name: str | None) -> Cells:
    import polars

    if isinstance(path, (str, Path)):
        path = Path(path)
        try:
            folder = path.is_dir()
            there = path.exists()
        except (OSError, ValueError, RuntimeError) as problem:
            raise LogError(f"{shown(path)}: cannot be read ({getattr(problem, 'strerror', None) or problem})") from None
        if folder:
            raise LogError(f"{path}: is a folder; a CSV or Parquet file is expected")
        if there and path.suffix.lower() in (".parquet", ".pq"):
            frame, names = parquet_by_process(path, columns)
            return Cells(frame, path, 1, tuple(names))
        frame, first_row = read_csv(path)
        return _all(frame, path, first_row)
    if isinstance(path, polars.DataFrame):
        return _all(path, Path("the frame"), 0)
    if not hasattr(path, "columns"):
        raise LogError(f"a log is a path, a frame or a distal.Log; {type(path).__name__} came")
    held = {str(name): _plain(path[name]) for name in path.columns}
    index = getattr(path, "index", None)
    if index_name is not None and index_name not in held and _is_dated(index):
        held[index_name] = _plain(index)
    return _all(polars.DataFrame(held), Path("the frame"), 0)


def _all(frame: polars.DataFrame, path: Path, first_row: int) -> Cells:
    return Cells(frame, path, first_row, tuple(frame.columns))


def _is_dated(column: Any) -> bool:
    """Return whether a column or an index of pandas holds dates."""
    return str(getattr(column, "dtype", "")).startswith("datetime64")


def _plain(column: Any) -> Any:
    """Return a column or an index of pandas as NumPy has it, dates with a zone in UTC."""
    if _is_dated(column) and getattr(column.dtype, "tz", None) is not None:
        dates = getattr(column, "dt", column)
        column = dates.tz_convert(None)
    return column.to_numpy()


def table_of(cells: Cells, wanted: Sequence[str] | None, optional: Iterable[str] = ()) -> Table:
    """Return columns of an open table as numbers; see `read_table`.

    Args:
        cells: the open table.
        wanted: columns that must be there; None takes all.
        optional: columns that are taken where they are there.

    Raises:
        LogError: a column is missing or does not hold numbers, or there is no row.
    """
    names = list(cells.names) if wanted is None else [*wanted, *(c for c in optional if c in cells.names)]
    check_columns(cells, names)
    read = {name: numbers_of(cells, name) for name in dict.fromkeys(names)}
    return Table(str(cells.path), read, cells.first_row, cells.units)


def check_columns(cells: Cells, names: Iterable[str]) -> None:
    """Refuse an open table that lacks a column, or has no row.

    Args:
        cells: the open table.
        names: columns that must be there.

    Raises:
        LogError: see above.
    """
    for name in names:
        if name not in cells.names:
            raise LogError(f"{cells.path}: column '{name}' is missing{did_you_mean(name, cells.names)}")
    if cells.frame.height == 0:
        raise LogError(f"{cells.path}: has a header but no rows")


def numbers_of(cells: Cells, name: str) -> Floats:
    """Return a column as numbers, NaN where a cell is missing.

    Args:
        cells: the open table.
        name: of the column.

    Raises:
        LogError: a cell is no finite number.
    """
    import polars

    column, path, first_row = cells.frame[name], cells.path, cells.first_row
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
