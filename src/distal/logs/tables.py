"""Tables from files and frames.

Every error names the file, row and column, the value found, and what is allowed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np

from distal.arrays import Floats
from distal.errors import LogError
from distal.logs.cells import Cells, Column, in_memory
from distal.logs.episodes import Episode, rows_of_episode
from distal.logs.formats import check_is_content, format_of
from distal.logs.header_units import header, needed, scale, units_of
from distal.logs.outputs import shown
from distal.logs.reader_process import read_apart
from distal.logs.vectors import INFO


class Frame(Protocol):
    """A table in memory with named columns, such as a frame of pandas or polars."""

    @property
    def columns(self) -> Iterable[str]:
        """Names of the frame's columns."""

    def __getitem__(self, name: str, /) -> object:
        """Return the column of a name."""


Source: TypeAlias = str | Path | Frame | Episode
"""The path of a file, a frame, or an episode of a dataset."""


@dataclass(frozen=True)
class Table:
    """Columns of a file as numbers, with NaN for missing cells.

    Args:
        source: what the file is called in messages.
        columns: name → numbers, (n,) each.
        first_row: row number of the first value in the file, as a text editor counts.
        units: name → unit, for columns whose header gave one.
    """

    source: str
    columns: dict[str, Floats]
    first_row: int
    units: Mapping[str, str] = field(default_factory=dict)

    def in_si(self, name: str, si: str) -> Floats:
        """Return a column in SI, by the unit in its header; without a unit there, it is unchanged.

        Args:
            si: SI unit of the quantity.
        """
        unit = self.units.get(name)
        return self.columns[name] * scale(
            unit, si, f"{self.source}: column '{header(name, unit or '')}'"
        )


def read_table(path: str | Path, desired: Sequence[str] | None = None) -> Table:
    """Return columns of a CSV or Parquet file as numbers.

    Args:
        path: a file whose format follows from its ending; without a known ending it is CSV with a
            header, separated by comma, semicolon or tab.
        desired: columns that must be there; None reads all.

    Raises:
        LogError: the file cannot be read, a column is missing or doubled, a cell is not a number, a
            row is short or long, or there is no row.
    """
    return table_of(open_table(path, desired), desired)


def open_table(
    path: Source, columns: Sequence[str] | None = None, index_name: str | None = None
) -> Cells:
    """Return the cells of a file, of a frame, or of an episode of a dataset.

    Args:
        path: a path, a frame of any library whose columns have ``to_numpy``, or an episode.
        columns: names of the columns that are needed, with or without units; None needs all. Others
            may be left out where the format allows that.
        index_name: column for which a pandas frame's index of dates is taken where the frame lacks
            it.

    Raises:
        LogError: see `read_table`.
    """
    cells = _opened(path, columns, index_name)
    return cells.without_units(units_of(cells.names, columns or (), str(cells.path)))


def _opened(path: Source, columns: Sequence[str] | None, index_name: str | None) -> Cells:
    if isinstance(path, Episode):
        return rows_of_episode(path, None if columns is None else list(columns))
    if isinstance(path, (str, Path)):
        path = Path(path)
        try:
            is_folder = path.is_dir()
            exists = path.exists()
        except (OSError, ValueError, RuntimeError) as problem:
            raise LogError(
                f"{shown(path)}: cannot be read ({getattr(problem, 'strerror', None) or problem})"
            ) from None
        if is_folder:
            raise LogError(
                f"{path}: is a folder without {INFO}, so no dataset; give its files, such as "
                f"{path}/*.csv"
            )
        kind = format_of(path)
        if kind.read is None:
            raise LogError(f"{path}: is a recording of topics; a CSV or Parquet file is expected")
        check_is_content(path)
        if exists and kind.apart:
            return read_apart(kind.read, path, columns)
        return kind.read(path, columns)
    if not hasattr(path, "columns"):
        raise LogError(f"a log is a path, a frame or a distal.Log; {type(path).__name__} came")
    columns_of = {
        str(name): _column(path[name]) for name in path.columns if needed(str(name), columns)
    }
    names = [str(name) for name in path.columns]
    index = getattr(path, "index", None)
    if index_name is not None and index_name not in names and _is_dated(index):
        columns_of[index_name] = _column(index)
        names = [*names, index_name]
    return in_memory(columns_of, Path("the frame"), 0, names)


def _is_dated(column: Any) -> bool:
    """Return whether a column or an index of a frame holds dates."""
    return str(getattr(column, "dtype", "")).startswith("datetime64")


def _column(column: Any) -> Column:
    """Return a frame's column or index as cells.

    Dates with a zone are turned into UTC; what is neither number nor date becomes text.
    """
    if _is_dated(column) and getattr(column.dtype, "tz", None) is not None:
        column = getattr(column, "dt", column).tz_convert(None)
    values = np.asarray(column.to_numpy())
    if values.dtype.kind in "OUT":
        return ["" if cell is None else str(cell) for cell in values.tolist()]
    return values


def table_of(cells: Cells, desired: Sequence[str] | None, optional: Iterable[str] = ()) -> Table:
    """Return columns of an open table as numbers.

    Args:
        desired: columns that must be there; None takes all.
        optional: columns that are taken where the table has them.

    Raises:
        LogError: see `read_table`.
    """
    names = (
        list(cells.names)
        if desired is None
        else [*desired, *(c for c in optional if c in cells.names)]
    )
    cells.check(names)
    return Table(
        str(cells.path), cells.values(list(dict.fromkeys(names))), cells.first_row, cells.units
    )
