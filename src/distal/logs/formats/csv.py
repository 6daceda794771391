"""CSV files: every line is one row; no line is skipped, and none is joined with another."""

from __future__ import annotations

import csv
import io
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from distal.errors import DistalWarning, LogError
from distal.logs.cells import Cells, Column, compact
from distal.logs.column_units import needed
from distal.logs.formats.format import Format
from distal.logs.memory import COPIES, check_rows, memory_limit
from distal.logs.stamps import is_date

SEPARATORS = (",", ";", "\t")
"""Characters that may separate the cells of a file: comma, semicolon, tab."""

BLOCK = 1 << 16
"""Length of the text that is split into cells at once [bytes]; longer blocks leave the processor's
cache and are slower. Source: judgement.
"""

MARK = b"\xef\xbb\xbf"
"""Bytes with which some programs begin a text in UTF-8. Source: definition (Unicode)."""


def read_csv(path: Path, columns: Sequence[str] | None = None) -> Cells:
    """Return the cells of a CSV file: numbers, and as text the columns that hold others.

    The file is read once, a block of lines after the other, so that no more than a block of its
    numbers is in memory as text. Where its first row holds numbers, it has no header, and its
    columns are called ``column 1`` and so on.

    Args:
        columns: names of the columns that are needed, which may be numbers; None needs all.

    Raises:
        LogError: the file cannot be read or is no text, the header repeats a name, a row is short,
            long or blank, or a quote is left open.
    """
    try:
        with path.open("rb") as file:
            return _read(path, file, columns)
    except OSError as problem:
        raise LogError(f"{path}: cannot be read ({problem.strerror or problem})") from None


def _read(path: Path, file: BinaryIO, columns: Sequence[str] | None) -> Cells:
    longest = memory_limit() // COPIES  # of a line: a device may never end one
    row = 1
    line = file.readline(longest).removeprefix(MARK)
    while line and not line.strip(b"\r\n"):
        row += 1
        line = file.readline(longest)
    if not line.strip():
        raise LogError(f"{path}: is empty")
    if line.startswith(b"#"):
        raise LogError(
            f"{path}: row {row}: begins with '#'; comment lines are not supported, remove them"
        )
    separator = max(SEPARATORS, key=_text(path, line, row).count)
    (cells,) = _rows(path, line, separator, row)
    names = tuple(cell.strip() for cell in cells)
    if all(map(_is_value, names)) and any(names) and not set(names) & set(columns or ()):
        names = tuple(f"column {k + 1}" for k in range(len(names)))
        warnings.warn(
            f"{path}: has no header; its columns are called '{names[0]}' to '{names[-1]}'",
            DistalWarning,
            stacklevel=5,
        )
    else:
        row += 1
        line = b""
    name, count = Counter(names).most_common(1)[0]
    if count > 1:
        raise LogError(f"{path}: the header has column '{name}' more than once; names must differ")
    first_row = row
    parts: dict[str, list[Column]] = {name: [] for name in names if needed(name, columns)}
    blank = 0
    while block := line + file.read(BLOCK) + file.readline(longest):
        line = b""
        begin = row
        rows = list[list[str]]()
        for cells in _rows(path, block, separator, row):
            if len(cells) <= 1 and not "".join(cells).strip():
                blank = blank or row  # at the end it is no row
            elif blank:
                raise LogError(f"{path}: row {blank}: is blank; remove it")
            elif len(cells) != len(names):
                kind = "short" if len(cells) < len(names) else "long"
                raise LogError(
                    f"{path}: row {row}: is too {kind} ({len(cells)} cells; the header has "
                    f"{len(names)})"
                )
            else:
                rows.append(cells)
            row += 1
        for name, column in zip(names, zip(*rows)):
            if name in parts:
                parts[name].append(compact(list(column), path, name, begin))
        check_rows(path, row - first_row, len(parts))
    held = {name: _joined(of_column) for name, of_column in parts.items()}
    return Cells(held, path, first_row, names)


def _is_value(cell: str) -> bool:
    """Return whether a cell holds a number or a date, or is missing, so that it is no name."""
    try:
        float(cell or "nan")
    except ValueError:
        return is_date(cell)
    return True


def _joined(parts: list[Column]) -> Column:
    """Return a column of its parts: as text where one of them is."""
    arrays = [part for part in parts if isinstance(part, np.ndarray)]
    if arrays and len(arrays) == len(parts):
        return np.concatenate(arrays)
    return [cell for part in parts for cell in map(str, part)]


def _rows(path: Path, block: bytes, separator: str, first_row: int) -> list[list[str]]:
    """Return the cells of each of some lines; raise a `LogError` where a quoted cell goes on in the
    next line.
    """
    text = _text(path, block, first_row)
    lines = text.removesuffix("\n").split("\n")
    if '"' not in text:
        return [line.split(separator) for line in lines]
    reader = csv.reader(lines, delimiter=separator, strict=True)
    rows: list[list[str]] = []
    try:
        for row in reader:
            begins = first_row + len(rows)
            if first_row + reader.line_num - 1 != begins:
                raise LogError(
                    f"{path}: row {begins}: a quote is opened and not closed in this row; a cell "
                    "may not hold a line break"
                )
            rows.append(row)
    except csv.Error as problem:
        raise LogError(
            f"{path}: row {first_row + len(rows)}: cannot be read as CSV ({problem}); is a quote "
            "not closed?"
        ) from None
    return rows


def _text(path: Path, block: bytes, row: int) -> str:
    """Return some lines as text.

    Args:
        row: number of the first row.
    """
    try:
        if b"\0" in block:
            row += block[: block.index(0)].count(b"\n")
            raise LogError(
                f"{path}: row {row}: is not text, it holds a zero byte; a CSV file is expected "
                "(Parquet needs the ending .parquet)"
            )
        return block.decode()
    except UnicodeDecodeError as problem:
        row += block[: problem.start].count(b"\n")
        raise LogError(f"{path}: row {row}: is not UTF-8 text") from None


def write_csv(columns: Mapping[str, NDArray[np.generic]], file: BinaryIO) -> None:
    """Write columns as CSV, row by row.

    NaN becomes an empty cell; a number has as many digits as are needed to read the same number
    again.
    """
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    cells = (
        (None if cell != cell else cell for cell in np.asarray(column).data)
        for column in columns.values()
    )
    writer.writerows(zip(*cells))
    text.detach()


CSV = Format(endings=(".csv", ".txt"), read=read_csv, write=write_csv)
