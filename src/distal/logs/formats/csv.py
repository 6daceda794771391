"""CSV files: every line is one row; no line is skipped, and none is joined with another."""

from __future__ import annotations

import csv
import io
import sys
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from distal.errors import DistalWarning, LogError
from distal.logs.cells import Cells
from distal.logs.formats.format import Format
from distal.logs.memory import COPIES, check_memory, check_rows, memory_limit
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
    """Return the cells of a CSV file as text.

    The file is checked as a whole, a block of lines after the other, and its columns are split off
    in blocks when they are asked for, so that no more than a block of it is in memory. Where its
    first row holds numbers, it has no header, and its columns are called ``column 1`` and so on.

    Args:
        columns: names of the columns that are needed, which may be numbers; others are there too.

    Raises:
        LogError: the file cannot be read or is no text, the header repeats a name, a row is short,
            long or blank, or a quote is left open.
    """
    try:
        held = None if path.is_file() else _of_pipe(path)

        def opened() -> BinaryIO:
            return path.open("rb") if held is None else io.BytesIO(held)

        with opened() as file:
            file.seek(len(MARK) if file.read(len(MARK)) == MARK else 0)
            first_row = 1
            begin = file.tell()
            while (line := file.readline()) and not line.strip(b"\r\n"):
                first_row += 1
                begin = file.tell()
            if not line.strip():
                raise LogError(f"{path}: is empty")
            if line.startswith(b"#"):
                raise LogError(
                    f"{path}: row {first_row}: begins with '#'; comment lines are not supported, "
                    "remove them"
                )
            separator = max(SEPARATORS, key=_text(path, line, first_row).count)
            names = tuple(cell.strip() for cell in _cells(path, line, separator, first_row))
            if all(map(_is_value, names)) and any(names) and not set(names) & set(columns or ()):
                names = tuple(f"column {k + 1}" for k in range(len(names)))
                warnings.warn(
                    f"{path}: has no header; its columns are called '{names[0]}' to '{names[-1]}'",
                    DistalWarning,
                    stacklevel=4,
                )
            else:
                first_row += 1
                begin = file.tell()
            name, count = Counter(names).most_common(1)[0]
            if count > 1:
                raise LogError(
                    f"{path}: the header has column '{name}' more than once; names must differ"
                )
            file.seek(begin)
            rows, end = _checked(path, file, separator, len(names), first_row)
    except OSError as problem:
        raise LogError(f"{path}: cannot be read ({problem.strerror or problem})") from None

    def blocks(desired: Sequence[str]) -> Iterator[list[list[str]]]:
        check_rows(path, rows, len(desired))
        positions = [names.index(name) for name in desired]
        with opened() as file:
            file.seek(begin)
            for block in _blocks(file, end):
                cells = _cells(path, block, separator)
                yield [cells[position :: len(names)] for position in positions]

    return Cells(blocks, path, first_row, names, rows)


def _of_pipe(path: Path) -> bytes:
    """Return what a pipe or a device gives, which has no size and may never end."""
    with path.open("rb") as file:
        data = file.read(memory_limit() // COPIES + 1)
    check_memory(path, COPIES * len(data), f"has more than {len(data) / 1e9:.1f} GB")
    return data


def _is_value(cell: str) -> bool:
    """Return whether a cell holds a number or a date, or is missing, so that it is no name."""
    try:
        float(cell or "nan")
    except ValueError:
        return is_date(cell)
    return True


def _blocks(file: BinaryIO, end: int = sys.maxsize) -> Iterator[bytes]:
    """Yield whole lines of a file up to the position `end`, some at a time."""
    while block := file.read(min(BLOCK, end - file.tell())):
        yield block + file.readline(max(end - file.tell(), 0))


def _checked(
    path: Path, file: BinaryIO, separator: str, width: int, first_row: int
) -> tuple[int, int]:
    """Return the number of rows from here on, and where the last one ends; raise a `LogError` where
    one is no text, or blank, or shorter or longer than the header. Blank lines at the end are no
    rows.
    """
    row = last = first_row - 1
    position = end = file.tell()
    for block in _blocks(file):
        _text(path, block, row + 1)
        lines = io.BytesIO(block)
        widths: Iterable[int] = (line.count(separator.encode()) + 1 for line in io.BytesIO(block))
        if b'"' in block:
            widths = map(len, _rows(path, block, separator, row + 1))
        for line, cells in zip(lines, widths):
            row += 1
            position += len(line)
            if cells <= 1 and not line.strip():
                continue
            if row > last + 1:
                raise LogError(f"{path}: row {last + 1}: is blank; remove it")
            if cells != width:
                kind = "short" if cells < width else "long"
                raise LogError(
                    f"{path}: row {row}: is too {kind} ({cells} cells; the header has {width})"
                )
            last = row
            end = position
    return last - first_row + 1, end


def _cells(path: Path, block: bytes, separator: str, first_row: int = 0) -> list[str]:
    """Return the cells of some lines, one row after the other."""
    if b'"' in block:
        return [cell for row in _rows(path, block, separator, first_row) for cell in row]
    return block.removesuffix(b"\n").decode().replace("\n", separator).split(separator)


def _rows(path: Path, block: bytes, separator: str, first_row: int) -> list[list[str]]:
    """Return the cells of each of some lines with quotes; raise a `LogError` where a quoted cell
    goes on in the next line.
    """
    lines = (line.removesuffix(b"\n").decode() for line in io.BytesIO(block))
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
