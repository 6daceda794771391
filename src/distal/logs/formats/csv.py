"""CSV files: every line is one row; no line is skipped, and none is joined with another."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from distal.errors import LogError
from distal.logs.cells import Cells
from distal.logs.formats.format import Format
from distal.logs.reader_process import COPIES, check_memory, memory_limit

SEPARATORS = (",", ";", "\t")
"""Characters that may separate the cells of a file: comma, semicolon, tab."""

SEPARATOR = "\0"
"""Character between cells after the quotes are taken off; no text has a zero byte."""

CELL = 16
"""Memory that each cell takes besides the copies of the file [bytes]; this is more than was
measured. Source: benchmark (benchmarks/csv_readers).
"""

BLOCK = 1 << 16
"""Length of the text that is split into cells at once [bytes]; longer blocks leave the processor's
cache and are slower. Source: judgement.
"""


def read_csv(path: Path, columns: Sequence[str] | None = None) -> Cells:
    """Return the cells of a CSV file with a header, as text.

    All columns stay available, since a column is split off the text only when it is asked for.

    Args:
        columns: not used; it is there because all formats are read by the same call.

    Raises:
        LogError: the file cannot be read or is no text, the header repeats a name, a row is short,
            long or blank, or a quote is left open.
    """
    try:
        size = path.stat().st_size
        check_memory(path, COPIES * size, f"has {size / 1e9:.1f} GB")
        with path.open("rb") as file:
            # a pipe or a device has no size, and may never end
            data = file.read(memory_limit() // COPIES + 1)
        check_memory(path, COPIES * len(data), f"has more than {len(data) / 1e9:.1f} GB")
    except OSError as problem:
        raise LogError(f"{path}: cannot be read ({problem.strerror or problem})") from None
    # each of these lines copies the file only where it takes something off
    data = data.removeprefix(b"\xef\xbb\xbf")
    size = len(data)
    blank = data[: size - len(data.lstrip(b"\r\n"))]
    data = data[len(blank) :]
    above = blank.count(b"\n")
    if not data[:BLOCK].strip() and not data.strip():
        raise LogError(f"{path}: is empty")
    _check_text(path, data, above)
    header = data.split(b"\n", 1)[0].decode()
    separator = max(SEPARATORS, key=header.count)
    # blank lines at the end are no rows; with tabs, one may be an empty last cell
    data = data.rstrip(b"\r\n " if separator == "\t" else None)
    quoted = b'"' in data
    cells = data.count(separator.encode()) + data.count(b"\n") + 1
    check_memory(path, (COPIES + quoted) * len(data) + cells * CELL, f"has {cells:,} cells")
    if quoted:
        data = _without_quotes(path, data, separator, above)
        separator = SEPARATOR
    names = tuple(name.strip() for name in data.split(b"\n", 1)[0].decode().split(separator))
    name, count = Counter(names).most_common(1)[0]
    if count > 1:
        raise LogError(f"{path}: the header has column '{name}' more than once; names must differ")
    rows = _checked_rows(path, data, separator.encode(), len(names), above)
    body = data.find(b"\n") + 1 or len(data)

    def blocks(desired: Sequence[str]) -> Iterator[list[list[str]]]:
        positions = [names.index(name) for name in desired]
        for block in _blocks(data, body):
            flat = block.decode().replace("\n", separator).split(separator)
            yield [flat[position :: len(names)] for position in positions]

    return Cells(blocks, path, above + 2, names, rows)


def _blocks(data: bytes, at: int) -> Iterator[bytes]:
    """Yield whole lines of a text, some at a time, each time without the last line's end."""
    while at < len(data):
        end = data.find(b"\n", at + BLOCK)
        end = len(data) if end < 0 else end
        yield data[at:end]
        at = end + 1


def _check_text(path: Path, data: bytes, above: int) -> None:
    """Raise where the bytes are no text, or begin with a comment."""
    if b"\0" in data:
        if b"\0" in data[:4096]:
            raise LogError(
                f"{path}: is not text; a CSV file is expected (Parquet needs the ending .parquet)"
            )
        row = data[: data.index(0)].count(b"\n") + 1 + above
        raise LogError(f"{path}: row {row}: holds a zero byte, which is no text")
    try:
        data.decode()
    except UnicodeDecodeError as problem:
        row = data[: problem.start].count(b"\n") + 1 + above
        raise LogError(f"{path}: row {row}: is not UTF-8 text") from None
    if data.startswith(b"#"):
        raise LogError(
            f"{path}: row {above + 1}: begins with '#'; comment lines are not supported, remove "
            "them"
        )


def _without_quotes(path: Path, data: bytes, separator: str, above: int) -> bytes:
    """Return the text without its quotes; raise a `LogError` where a quoted cell goes on in the
    next line.
    """
    lines = (line.removesuffix(b"\n").decode() for line in io.BytesIO(data))
    reader = csv.reader(lines, delimiter=separator, strict=True)
    rows: list[bytes] = []
    try:
        for row in reader:
            begins = above + len(rows) + 1
            if above + reader.line_num != begins:
                raise LogError(
                    f"{path}: row {begins}: a quote is opened and not closed in this row; a cell "
                    "may not hold a line break"
                )
            rows.append(SEPARATOR.join(row).encode())
    except csv.Error as problem:
        begins = above + len(rows) + 1
        raise LogError(
            f"{path}: row {begins}: cannot be read as CSV ({problem}); is a quote not closed?"
        ) from None
    return b"\n".join(rows)


def _checked_rows(path: Path, data: bytes, separator: bytes, width: int, above: int) -> int:
    """Return the number of rows below the header; raise where one is blank, or shorter or longer
    than the header.
    """
    row = above
    for row, line in enumerate(io.BytesIO(data), above + 1):
        cells = line.count(separator) + 1
        if cells == 1 and not line.strip():
            raise LogError(f"{path}: row {row}: is blank; remove it")
        if cells != width:
            kind = "short" if cells < width else "long"
            raise LogError(
                f"{path}: row {row}: is too {kind} ({cells} cells; the header has {width})"
            )
    return row - above - 1


def write_csv(columns: Mapping[str, NDArray[np.generic]]) -> bytes:
    """Return columns as the content of a CSV file.

    NaN becomes an empty cell; a number has as many digits as are needed to read the same number
    again.
    """
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    lists = (np.asarray(column).tolist() for column in columns.values())
    writer.writerows(
        zip(*([None if cell != cell else cell for cell in column] for column in lists))
    )
    return text.getvalue().encode()


CSV = Format(endings=(".csv", ".txt"), read=read_csv, write=write_csv, apart=False)
