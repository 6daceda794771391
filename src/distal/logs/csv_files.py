"""CSV files: every line is a row, none is lost, none is joined with another."""

from __future__ import annotations

import codecs
import csv
import io
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from distal.errors import LogError
from distal.logs.memory import check_memory, memory_limit

if TYPE_CHECKING:
    import polars

MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-"})
"""Texts of a cell that mean a missing value, in any case."""

SEPARATORS = (",", ";", "\t")

COPIES, PLAIN, QUOTED = 3, 40, 120
"""Memory that reading takes: copies of the file, and bytes for each cell of a file without and with quotes, measured on
95 MB of 10 million cells (540 MB without quotes, 1390 MB with)."""

WIDE = 4
"""Bytes that a character of a quoted cell may take in memory, where the file is not plain ASCII."""

BLOCK = 1 << 20
"""So much is decoded at once to see whether it is text [bytes]."""


def read_csv(path: Path) -> tuple[polars.DataFrame, int]:
    """Return a CSV's cells as text, and the row number of the first value as an editor counts.

    Args:
        path: of a file with a header, separated by comma, semicolon or tab.

    Raises:
        LogError: it cannot be read or is no text, the header repeats a name, a row is short, long or blank, or a quote is
            left open.
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
    # each of these is a copy of a large file where something is taken off, else none
    data = data.removeprefix(b"\xef\xbb\xbf")
    size = len(data)
    blank = data[: size - len(data.lstrip(b"\r\n"))]
    data, above = data[len(blank) :], blank.count(b"\n")
    if not data[:BLOCK].strip() and not data.strip():
        raise LogError(f"{path}: is empty")
    _check_text(path, data, above)
    header = data.split(b"\n", 1)[0].decode()
    separator = max(SEPARATORS, key=header.count)
    # blank lines at the end are no rows; with tabs, one may be an empty last cell
    data = data.rstrip(b"\r\n " if separator == "\t" else None)
    quoted = b'"' in data
    cells = data.count(separator.encode()) + data.count(b"\n") + 1
    copies = COPIES + (0 if not quoted else 1 if data.isascii() else WIDE)
    check_memory(path, copies * len(data) + cells * (QUOTED if quoted else PLAIN), f"has {cells:,} cells")
    frame = _quoted(path, data, separator, above) if quoted else _plain(path, data, separator, above)
    return frame, above + 2


def _check_text(path: Path, data: bytes, above: int) -> None:
    """Raise where the bytes are no text, or begin with a comment."""
    if b"\0" in data:
        if b"\0" in data[:4096]:
            raise LogError(f"{path}: is not text; a CSV file is expected (Parquet needs the ending .parquet)")
        raise LogError(f"{path}: row {_row_at(data, data.index(0)) + above}: holds a zero byte, which is no text")
    if not data.isascii():
        decoder, done = codecs.getincrementaldecoder("utf-8")(), 0
        try:
            for done in range(0, len(data), BLOCK):
                block = data[done : done + BLOCK]
                decoder.decode(block, final=done + BLOCK >= len(data))
        except UnicodeDecodeError as problem:
            # the decoder keeps the beginning of a character that stands across two blocks
            kept = len(problem.object) - len(block)
            row = _row_at(data, done + problem.start - kept) + above
            raise LogError(f"{path}: row {row}: is not UTF-8 text") from None
    if data.startswith(b"#"):
        raise LogError(f"{path}: row {above + 1}: begins with '#'; comment lines are not supported, remove them")


def _row_at(data: bytes, place: int) -> int:
    return data[:place].count(b"\n") + 1


def _plain(path: Path, data: bytes, separator: str, above: int) -> polars.DataFrame:
    """Return the cells of a file without quotes; polars reads them, and what it read is counted against the lines."""
    import polars

    codes = np.frombuffer(data, dtype=np.uint8)
    ends = np.append(np.flatnonzero(codes == ord("\n")), len(codes))
    marks = np.flatnonzero(codes == ord(separator))
    widths = np.diff(np.searchsorted(marks, ends), prepend=0) + 1
    begins = np.concatenate([[0], ends[:-1] + 1])
    # only a line without a separator, or of separators alone, can be blank
    for i in np.flatnonzero(widths == 1):
        if not data[begins[i] : ends[i]].strip():
            widths[i] = 0
    names = [name.strip() for name in data[: ends[0]].decode().split(separator)]
    _check_rows(path, names, widths, above)
    try:
        frame = polars.read_csv(
            data,
            separator=separator,
            infer_schema=False,
            null_values=None,
            quote_char=None,
            truncate_ragged_lines=False,
        )
    except polars.exceptions.PolarsError as problem:
        raise LogError(f"{path}: cannot be read as CSV ({str(problem).splitlines()[0][:120]})") from None
    if frame.height != len(widths) - 1:
        raise LogError(
            f"{path}: has {len(widths) - 1} rows, of which {frame.height} could be read; write it again as plain CSV"
        )
    return frame.rename(dict(zip(frame.columns, names)))


def _quoted(path: Path, data: bytes, separator: str, above: int) -> polars.DataFrame:
    """Return the cells of a file with quotes: a quote ends in the line in which it begins, or the file is refused."""
    import polars

    lines = (line.removesuffix(b"\n").decode() for line in io.BytesIO(data))
    reader = csv.reader(lines, delimiter=separator, strict=True)
    rows: list[list[str]] = []
    while True:
        begins = reader.line_num + 1 + above
        try:
            row = next(reader)
        except StopIteration:
            break
        except csv.Error as problem:
            raise LogError(f"{path}: row {begins}: cannot be read as CSV ({problem}); is a quote not closed?") from None
        if reader.line_num + above != begins:
            raise LogError(
                f"{path}: row {begins}: a quote is opened and not closed in this row; a cell may not hold a line break"
            )
        rows.append([cell.removesuffix("\r") for cell in row])
    names = [name.strip() for name in rows[0]]
    widths = np.array([len(row) if len(row) > 1 or "".join(row).strip() else 0 for row in rows])
    _check_rows(path, names, widths, above)
    return polars.DataFrame(
        {name: [row[i] for row in rows[1:]] for i, name in enumerate(names)}, schema=dict.fromkeys(names, polars.String)
    )


def _check_rows(path: Path, names: list[str], widths: NDArray[np.intp], above: int) -> None:
    """Raise where the header repeats a name, or a row is blank, or shorter or longer than the header."""
    name, count = Counter(names).most_common(1)[0]
    if count > 1:
        raise LogError(f"{path}: the header has column '{name}' more than once; names must differ")
    blank = np.flatnonzero(widths == 0)
    if len(blank):
        raise LogError(f"{path}: row {blank[0] + 1 + above}: is blank; remove it")
    wrong = np.flatnonzero(widths != len(names))
    if len(wrong):
        row = int(wrong[0])
        kind = "short" if widths[row] < len(names) else "long"
        raise LogError(
            f"{path}: row {row + 1 + above}: is too {kind} ({widths[row]} cells; the header has {len(names)})"
        )
