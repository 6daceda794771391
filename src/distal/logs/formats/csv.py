"""CSV files: every line is one row, and none is joined with another. Lines above the header, units
below it, and lines with another number of cells are left out and said.
"""

from __future__ import annotations

import csv
import gzip
import io
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, TextIO

import numpy as np
from numpy.typing import NDArray

from distal.errors import LogError
from distal.logs.formats.format import Format
from distal.logs.stamps import is_time
from distal.logs.table_cells import MISSING, Cells, Column, compact, header, needed, say
from distal.machine_limits import COPIES, check_rows, memory_limit

SEPARATORS = (",", ";", "\t", "|")
"""Characters that may separate the cells of a file; else blanks do."""

BLANKS = " "
"""What stands for any number of blanks between cells."""

COMMENT = "#"
"""What a line begins with that is a comment, or holds the names."""

MOST_ABOVE = 100
"""Largest number of lines above the first row of numbers. Source: judgement."""

DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
"""A comma between digits, which is a decimal one where it does not separate cells."""

UNIT = re.compile(r"[\[(]?([^\W\d_][^\d_]{0,11}|[°%])[\])]?")
"""What a cell of a row of units looks like."""

BLOCK = 1 << 16
"""Length of the text that is split into cells at once [bytes]; longer blocks leave the processor's
cache and are slower. Source: judgement.
"""

GZIP = b"\x1f\x8b"
"""Bytes with which a compressed file begins. Source: definition (RFC 1952)."""

WIDE_MARKS = (b"\xff\xfe", b"\xfe\xff")
"""Bytes with which a text in UTF-16 begins. Source: definition (Unicode)."""

SIGNS = str.maketrans("\N{MINUS SIGN}\udcb0\udcb5\udcb2", "-°µ²")
"""The minus that some programs print, and signs of units in the code of Western Europe, as they are
decoded → the same in UTF-8.
"""

NO_TEXT = re.compile("[\0\udc80-\udcff]")
"""A zero byte, or a byte that is no UTF-8, as it is decoded."""


def read_csv(path: Path, columns: Sequence[str] | None = None) -> Cells:
    """Return the cells of a CSV file: numbers, and as text the columns that hold others.

    The file is read once, a block of lines after the other, so that no more than a block of its
    numbers is in memory as text. Where its first row holds numbers, it has no header, and its
    columns are called ``column 1`` and so on.

    Args:
        columns: names of the columns that are needed, which may be numbers; None needs all.

    Raises:
        LogError: the file is no text, the header repeats a name, a row is short, long or blank, or
            a quote is left open.
    """
    with path.open("rb") as file:
        # a pipe is read once only
        packed = file.peek(len(GZIP)).startswith(GZIP)
        plain = gzip.GzipFile(fileobj=file) if packed else file
        begin = plain.peek(4)
        code = "utf-8-sig"
        otherwise = "surrogateescape"
        if begin.startswith(WIDE_MARKS) or begin[1:4:2] == b"\0\0":
            code = "utf-16" if begin.startswith(WIDE_MARKS) else "utf-16-le"
            otherwise = "replace"
        with io.TextIOWrapper(plain, code, otherwise) as text:
            return _read(path, text, columns)


def _read(path: Path, file: TextIO, columns: Sequence[str] | None) -> Cells:
    longest = memory_limit() // COPIES  # of a line: a device may never end one
    lines = _head(file, longest)
    separator, names, header_cells, first_row = _header(path, lines, frozenset(columns or ()))
    parts: dict[str, list[Column]] = {name: [] for name in names if needed(name, columns)}
    row = first_row
    text = "".join(lines[first_row - 1 :])
    torn = dict[int, str]()
    repeated = list[int]()
    while text := text + file.read(BLOCK) + file.readline(longest):
        rows = list[list[str]]()
        for line in _checked(text, row).removesuffix("\n").split("\n"):
            cells = _split(row, line, separator)
            if len(cells) == len(names) + 1 and not cells[-1].strip():
                del cells[-1]  # each row ends with a separator
            first = cells[0].strip() if cells else ""
            if first == header_cells[0] and [c.strip() for c in cells] == header_cells:
                repeated.append(row)
            elif len(cells) == len(names):
                rows.append(cells)
            elif "".join(cells).strip() and not first.startswith(COMMENT):
                torn[row] = _mismatch(cells, names)
                rows.append([""] * len(names))
            row += 1
        text = ""
        for name, column in zip(names, zip(*rows)):
            if name in parts:
                parts[name].append(compact(list(column)))
        check_rows(row - first_row, len(parts))
    held = {name: _joined(of_column) for name, of_column in parts.items()}
    if torn:
        at, reason = next(iter(torn.items()))
        wrong = f"row {at}: {reason}"
        if 2 * len(torn) > max(map(len, held.values()), default=0):
            raise LogError(wrong)
        say(f"{path}: {wrong}; rows left out: {len(torn)}")
    if repeated:
        say(
            f"{path}: row {repeated[0]} repeats the header, {len(repeated)} in all: left out; are "
            "these several logs in one file?"
        )
    return Cells(held, path, first_row, names)


def _mismatch(cells: Sequence[str], names: Sequence[str]) -> str:
    """Return what is wrong with a row that has not one cell for each name."""
    text = (
        f"is too {'short' if len(cells) < len(names) else 'long'} ({len(cells)} cells; the header "
        f"has {len(names)})"
    )
    if len(cells) == 2 * len(names):
        text += "; are these decimal commas? Write points, or separate by semicolons"
    return text


def _head(file: TextIO, longest: int) -> list[str]:
    """Return the first lines of a file, up to the first row of numbers."""
    lines = list[str]()
    while len(lines) < MOST_ABOVE:
        lines.append(_checked(file.readline(longest), len(lines) + 1))
        if not lines[-1] or _value_cells(lines[-1]):
            break
    return lines


def _value_cells(line: str) -> tuple[str, int] | None:
    """Return the separator and the number of cells of a row of numbers, None of another line."""
    for separator in (*SEPARATORS, BLANKS):
        cells = list[str]()
        with suppress(LogError):  # a quote that is not closed is said where rows are read
            cells = _split(0, line, separator)
        if len(cells) > 1 and "".join(cells).strip() and all(map(_is_value, cells)):
            return separator, len(cells)
    return None


def _header(
    path: Path, lines: Sequence[str], asked: frozenset[str]
) -> tuple[str, tuple[str, ...], list[str], int]:
    """Return the separator of a file, its names, the cells of its header, and the number of its
    first row of readings.

    The header is the last line above the first row of numbers that has as many cells, most of them
    names. Below it may stand units.
    """
    plain = [k for k, line in enumerate(lines) if line.strip() and not line.startswith(COMMENT)]
    if not plain:
        raise LogError("is empty")
    top = plain[0]
    first = _value_cells(lines[-1])
    if first is not None:
        separator, count = first
    else:  # a column of text: the first line has the names
        count = 0
        separator = max(SEPARATORS, key=lines[top].count)
        if separator not in lines[top] and len(lines[top].split()) > 1:
            separator = BLANKS
    cells_of = [
        [cell.strip() for cell in _split(k + 1, line.lstrip(COMMENT), separator)]
        for k, line in enumerate(lines)
    ]
    at = top if first is None or top < len(lines) - 1 else None
    for k, cells in enumerate(cells_of) if first else ():
        names_most = 2 * sum(map(_is_value, cells)) < len(cells) or asked & set(cells)
        ends_empty = len(cells) == count - 1 and not cells_of[-1][-1]
        if (len(cells) == count or ends_empty) and names_most:
            is_units = at is not None and k and _units(cells, cells_of[at])
            if at is None or not (is_units or len(set(cells)) < len(cells)):
                at = k
    if at is None:
        names = tuple(f"column {k + 1}" for k in range(count))
        say(
            f"{path}: has no header; its columns are called '{names[0]}' to '{names[-1]}'. Write "
            "their names above the first row"
        )
        return separator, names, list(names), len(lines)
    header_cells = cells_of[at]
    name, most = Counter(header_cells).most_common(1)[0]
    if most > 1:
        raise LogError(f"the header has column '{name}' more than once; names must differ")
    before = sum(k < at for k in plain)
    if before:
        say(f"{path}: {before} lines above the header, row {at + 1}, are left out")
    units = _units(cells_of[at + 1], header_cells) if at + 1 < len(lines) else None
    return separator, units or tuple(header_cells), header_cells, at + 2 + (units is not None)


def _units(units: Sequence[str], names: Sequence[str]) -> tuple[str, ...] | None:
    """Return the names with the units of the row below them, None where it is no row of units."""
    present = [unit for unit in units if unit.lower() not in MISSING]
    if len(units) != len(names) or not all(map(UNIT.fullmatch, present)) or not present:
        return None
    if units == names or any(map(_is_value, present)):
        return None
    return tuple(
        header(name, unit.strip("[]()") if unit in present else "")
        for name, unit in zip(names, units)
    )


def _is_value(cell: str) -> bool:
    """Return whether a cell holds a number or a date, or is missing, so that it is no name."""
    try:
        float(cell.strip() or "nan")
    except ValueError:
        return cell.strip().lower() in MISSING or is_time([cell])
    return True


def _joined(parts: list[Column]) -> Column:
    """Return a column of its parts: as text where one of them is."""
    arrays = [part for part in parts if isinstance(part, np.ndarray)]
    if len(arrays) < len(parts) or not parts:
        return [cell for part in parts for cell in map(str, part)]
    return np.concatenate(arrays)


def _split(row: int, line: str, separator: str) -> list[str]:
    """Return the cells of a line; raise a `LogError` where a quoted cell does not end in it."""
    if separator != ",":
        line = DECIMAL_COMMA.sub(".", line)
    if separator == BLANKS:
        return line.split()
    if '"' not in line:
        return line.split(separator)
    try:
        return next(csv.reader([line], delimiter=separator, strict=True))
    except csv.Error as problem:
        raise LogError(
            f"row {row}: cannot be read as CSV ({problem}); is a quote not closed?"
        ) from None


def _checked(text: str, row: int) -> str:
    """Return some lines, of which `row` is the first one, with `SIGNS` in UTF-8; raise a `LogError`
    where they are no text.
    """
    if not text.isascii():
        text = text.translate(SIGNS)
    odd = NO_TEXT.search(text)
    if odd is None:
        return text
    row += text.count("\n", 0, odd.start())
    if odd[0] != "\0":
        raise LogError(f"row {row}: is not UTF-8 text")
    raise LogError(
        f"row {row}: is not text, it holds a zero byte; a CSV file is expected (Parquet "
        "needs the ending .parquet; unpack an archive)"
    )


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


CSV = Format("CSV", endings=(".csv", ".txt"), read=read_csv, write=write_csv)
