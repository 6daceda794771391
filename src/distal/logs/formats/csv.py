"""CSV files: every line is one row; none is joined with another, and none is skipped but comments
before the header, units below it, and the header where it comes again.
"""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from distal.errors import DistalWarning, LogError
from distal.logs.cells import MISSING, Cells, Column, compact, header, needed
from distal.logs.formats.format import Format
from distal.logs.outputs import COPIES, check_rows, memory_limit
from distal.logs.stamps import is_date

SEPARATORS = (",", ";", "\t")
"""Characters that may separate the cells of a file: comma, semicolon, tab; else blanks do."""

BLANKS = " "
"""What stands for any number of blanks between cells."""

COMMENT = b"#"
"""What a line begins with that is a comment, or holds the names."""

DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
"""A comma between digits, which is a decimal one where it does not separate cells."""

UNIT = re.compile(r"[\[(]?([^\W\d_][^\d_]{0,11}|[°%])[\])]?")
"""What a cell of a row of units looks like."""

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
    comment = b""
    line = file.readline(longest).removeprefix(MARK)
    while line and (not line.strip() or line.startswith(COMMENT)):
        comment = line.lstrip(COMMENT) if line.startswith(COMMENT) else comment
        row += 1
        line = file.readline(longest)
    if not line.strip():
        raise LogError(f"{path}: is empty")
    text = _text(path, line, row)
    separator = max(SEPARATORS, key=text.count)
    if separator not in text and len(text.split()) > 1:
        separator = BLANKS
    (cells,) = _rows(path, line, separator, row)
    names = tuple(cell.strip() for cell in cells)
    if all(map(_is_value, names)) and any(names) and not set(names) & set(columns or ()):
        (named,) = _rows(path, comment or b"\n", separator, row - 1)
        if len(named) == len(names):  # a header that begins as a comment does
            names = tuple(cell.strip() for cell in named)
        else:
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
    header_cells = list(names)
    if not line:
        line = file.readline(longest)
        units = _units(_rows(path, line, separator, row)[0], names) if line.strip() else None
        if units is not None:
            names = units
            row += 1
            line = b""
    first_row = row
    parts: dict[str, list[Column]] = {name: [] for name in names if needed(name, columns)}
    blank = 0
    repeated = list[int]()
    while block := line + file.read(BLOCK) + file.readline(longest):
        line = b""
        begin = row
        rows = list[list[str]]()
        for cells in _rows(path, block, separator, row):
            if len(cells) <= 1 and not "".join(cells).strip():
                blank = blank or row  # at the end it is no row
            elif blank:
                raise LogError(f"{path}: row {blank}: is blank; remove it")
            elif cells[0].strip() == header_cells[0] and [c.strip() for c in cells] == header_cells:
                repeated.append(row)
            elif len(cells) != len(names):
                kind = "short" if len(cells) < len(names) else "long"
                above = "; is this the header? Remove what stands above it"
                raise LogError(
                    f"{path}: row {row}: is too {kind} ({len(cells)} cells; the header has "
                    f"{len(names)}){above if row == first_row and kind == 'long' else ''}"
                )
            else:
                rows.append(cells)
            row += 1
        for name, column in zip(names, zip(*rows)):
            if name in parts:
                parts[name].append(compact(list(column), path, name, begin))
        check_rows(path, row - first_row, len(parts))
    if repeated:
        warnings.warn(
            f"{path}: row {repeated[0]} repeats the header, {len(repeated)} in all: left out; are "
            "these several logs in one file?",
            DistalWarning,
            stacklevel=5,
        )
    held = {name: _joined(of_column) for name, of_column in parts.items()}
    return Cells(held, path, first_row, names)


def _units(cells: Sequence[str], names: Sequence[str]) -> tuple[str, ...] | None:
    """Return the names with the units of the row below them, None where it is no row of units."""
    units = [cell.strip() for cell in cells]
    present = [unit for unit in units if unit.lower() not in MISSING]
    if len(units) != len(names) or not all(map(UNIT.fullmatch, present)) or not present:
        return None
    if units == list(names) or any(map(_is_value, present)):
        return None
    named = [
        header(name, unit.strip("[]()") if unit in present else "")
        for name, unit in zip(names, units)
    ]
    return tuple(named)


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
    if separator != ",":
        text = DECIMAL_COMMA.sub(".", text)
    lines = text.removesuffix("\n").split("\n")
    if separator == BLANKS:
        return [line.split() for line in lines]
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
