"""The cells of a table as the file holds them (numbers, dates or text), and how text becomes
numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from math import inf, isinf, nan
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.errors import LogError, did_you_mean

Column = NDArray[Any] | list[str]
"""The cells of one column: an array of numbers or dates (``datetime64``), or a list of texts."""

MISSING = frozenset({"", "nan", "na", "n/a", "<na>", "null", "none", "-"})
"""Texts of a cell that mean a missing value, in lower case; a cell may be in any case."""


@dataclass(frozen=True)
class Cells:
    """An open table whose cells are as the file holds them.

    Args:
        blocks: function from names of columns to their cells, some rows at a time, so that a long
            text is never split as a whole.
        first_row: row number of the first value in the file, as a text editor counts.
        names: names of all columns of the table; units are taken off those that `without_units`
            knows.
        rows: number of rows below the header.
        units: name → unit, for columns whose header gave a unit beside a name that was asked for.
        held: name → cells, of the columns that are in memory as a whole.
    """

    blocks: Callable[[Sequence[str]], Iterable[Sequence[Column]]]
    path: Path
    first_row: int
    names: tuple[str, ...]
    rows: int
    units: Mapping[str, str] = field(default_factory=dict)
    held: Mapping[str, Column] = field(default_factory=dict)

    def without_units(self, headers: Mapping[str, tuple[str, str]]) -> Cells:
        """Return the same table with columns called by their names alone.

        Args:
            headers: name → header and unit, as `units_of` returns them.
        """
        header_of = {name: header for name, (header, _) in headers.items()}
        name_of = {header: name for name, header in header_of.items()}
        return replace(
            self,
            blocks=lambda names: self.blocks([header_of.get(name, name) for name in names]),
            names=tuple(name_of.get(header, header) for header in self.names),
            units={name: unit for name, (_, unit) in headers.items()},
        )

    def column(self, name: str) -> Column:
        """Return the cells of a column as the file holds them."""
        parts = [column for (column,) in self.blocks([name])]
        return parts[0] if len(parts) == 1 else list(chain.from_iterable(parts))

    def values(self, names: Sequence[str]) -> dict[str, Floats]:
        """Return columns as numbers, with NaN for missing cells.

        Raises:
            LogError: a cell is not a finite number; the message says where it is.
        """
        values = {name: np.empty(self.rows) for name in names}
        row = 0
        for columns in self.blocks(names) if names else ():
            part = slice(row, row + len(columns[0]))
            for name, column in zip(names, columns):
                values[name][part] = parsed_cells(column, self.path, name, self.first_row + row)
            row = part.stop
        return values

    def check(self, names: Iterable[str]) -> None:
        """Raise a `LogError` where the table lacks one of these columns, or has no row."""
        for name in names:
            if name not in self.names:
                raise LogError(
                    f"{self.path}: column '{name}' is missing{did_you_mean(name, self.names)}"
                )
        if self.rows == 0:
            raise LogError(f"{self.path}: has a header but no rows")


def in_memory(
    columns: Mapping[str, Column], path: Path, first_row: int, names: Iterable[str]
) -> Cells:
    """Return a table of columns that are in memory.

    Args:
        columns: name → cells, of the columns that were read.
        first_row: row number of the first value in the file.
        names: names of all columns that the file has.
    """
    rows = len(next(iter(columns.values()), ()))
    return Cells(
        lambda desired: [[columns[name] for name in desired]],
        path,
        first_row,
        tuple(names),
        rows,
        held=columns,
    )


def parsed_cells(column: Column, path: Path, name: str, first_row: int) -> Floats:
    """Return a column as numbers, with NaN for missing cells.

    Args:
        first_row: row number of the column's first cell, for the message.

    Raises:
        LogError: a cell is not a finite number; the message says where it is.
    """
    if isinstance(column, list):
        values = _plain_values(column)
        if values is None:
            cells = enumerate(column, first_row)
            values = np.array(
                [_number(cell, path, name, row) for row, cell in cells], dtype=np.float64
            )
        return values
    if column.dtype.kind not in "iuf":
        raise LogError(f"{path}: column '{name}' holds {column.dtype}; numbers are expected")
    values = column.astype(np.float64, copy=False)
    infinite = np.flatnonzero(np.isinf(values))
    if len(infinite):
        raise _no_number(path, int(infinite[0]) + first_row, name, str(column[infinite[0]]))
    return values


def _plain_values(cells: list[str]) -> Floats | None:
    """Return the numbers of cells that all hold finite numbers, else None.

    This fast way is enough for most logs.
    """
    try:
        values = np.fromiter(map(float, cells), np.float64, len(cells))
    except ValueError:
        return None
    return values if np.isfinite(values).all() and is_plain("".join(cells)) else None


def is_plain(text: str) -> bool:
    """Return whether a text is free of number forms that Python takes and logs may not have.

    These are ``1_000`` and digits of other scripts.
    """
    return text.isascii() and "_" not in text


def _number(cell: str, path: Path, name: str, row: int) -> float:
    text = cell.strip()
    if text.lower() in MISSING:
        return nan
    try:
        number = float(text) if is_plain(text) else inf
    except ValueError:
        number = inf
    if isinf(number):
        raise _no_number(path, row, name, cell.strip("\r"))
    return number


def _no_number(path: Path, row: int, column: str, came: str) -> LogError:
    hint = "; write a decimal point, not a comma" if "," in came else ""
    return LogError(
        f"{path}: row {row}, column '{column}': '{came}' is not a finite number{hint} (an empty "
        "cell is a missing value)"
    )
