"""CSV: every line is a row; what cannot be one is refused with the file's own row number."""

from __future__ import annotations

import gzip
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from time import process_time

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from distal.errors import DistalWarning, LogError
from distal.logs import read_table
from distal.logs.formats import csv
from distal.logs.table_cells import Cells

ROWS = [f"{k / 100},{k},-{k}" for k in range(40)]
A = np.arange(40.0)


Read = Callable[..., Cells]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Write lines or bytes and read them."""

    def call(
        text: list[str] | bytes,
        names: list[str] | None = None,
        *,
        end: str = "\n",
        name: str = "log.csv",
    ) -> Cells:
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else (end.join([*text, ""])).encode())
        return read_table(path, names)

    return call


@pytest.mark.parametrize("quote", ["", '"'])
@pytest.mark.parametrize("above", [0, 3])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_row_numbers_are_the_files(read: Read, quote: str, above: int, end: str) -> None:
    """An editor shows the same number, whatever stands above the header and whether cells are
    quoted.
    """
    for bad, said in (
        ("0.5,x1,1", "column 'a': 'x1' is not"),
        ("0.5,x,1", "column 'a': 'x' is no number: taken as missing, 1 in all"),
        ("0.5,1", "is too short"),
        ("0.5,1,2,3", "is too long"),
    ):
        lines = [*[""] * above, f"{quote}t{quote},a,b", *ROWS[:7], bad, *ROWS[7:]]
        with pytest.raises((LogError, DistalWarning), match=f"row {above + 9}[:,].*{said}"):
            read(lines, end=end).parsed(["a"])


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    cells=st.lists(
        st.tuples(
            *[st.sampled_from(["1", '"2"', '"3', '4"', '"', '""', '5"6', '"7"8', "", '"a\rb"'])] * 3
        ),
        min_size=1,
        max_size=12,
    )
)
def test_no_row_is_lost(read: Read, cells: list[tuple[str, str, str]]) -> None:
    """Whatever quotes stand where: a file is refused, or it has as many rows as lines, and each is
    the line's.
    """
    try:
        table = read(["t,a,b,c", *(f"{k},{','.join(row)}" for k, row in enumerate(cells))])
    except (LogError, DistalWarning):
        return
    assert np.array_equal(table.columns["t"], np.arange(len(cells)))
    for name, column in zip("abc", zip(*cells)):
        expected = [float(cell.strip('"') or "nan") for cell in column]
        np.testing.assert_array_equal(table.columns[name], expected)


def test_a_quote_that_is_not_closed_is_named(read: Read) -> None:
    with pytest.raises(LogError, match=r"row 22: .*quote.* not closed"):
        read(["t,a,b", *ROWS[:20], '0.3,"20,-20', *ROWS[21:30], '0.4,30,"-30"', *ROWS[31:]])


def test_memory_is_asked_for_before_it_is_taken(
    read: Read, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = ["t,a,b", *ROWS * 1250]
    monkeypatch.setenv("DISTAL_MAX_MEMORY", "3 MB")
    assert len(read(lines, ["t", "a"]).columns["t"]) == 50_000
    with pytest.raises(
        LogError,
        match=r"4\d,\d\d\d rows of 3 columns or more, about 0.0 GB .*DISTAL_MAX_MEMORY=16GB",
    ):
        read(lines)
    monkeypatch.setenv("DISTAL_MAX_MEMORY", "much")
    with pytest.raises(LogError, match="DISTAL_MAX_MEMORY: 'much'"):
        read(lines)


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="there is no device that never ends")
def test_what_never_ends_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISTAL_MAX_MEMORY", "3 MB")
    with pytest.raises(LogError, match="row 1: is not text, it holds a zero byte"):
        read_table("/dev/zero")


def test_a_file_without_a_header(read: Read) -> None:
    """Its first row is one of numbers, not one of names."""
    for first in ("0.0,1,2", "2026-11-20T21:02:47.5Z,1,2", '"0.0",,2'):
        with pytest.warns(DistalWarning, match=r"no header; .* 'column 1' to 'column 3'"):
            table = read(["", first, *ROWS], ["column 3"])
        np.testing.assert_array_equal(table.columns["column 3"], [2, *-A])
        assert table.first_row == 2
    assert list(read(["1,b,c", *ROWS]).columns) == ["1", "b", "c"]
    assert len(read(["1,2,3", *ROWS], ["2"]).columns["2"]) == 40  # a name that is asked for


def test_many_columns_take_no_time(read: Read) -> None:
    """The time is that of reading, not the square of the number of columns."""
    row = ",".join(["1"] * 30_001)
    names = ",".join(["t", *(f"c{k}" for k in range(30_000))])
    began = process_time()
    read([names, row, row], ["t"])
    assert process_time() - began < 5.0


@pytest.mark.parametrize("block", [1, 5, 1000])
@pytest.mark.parametrize(
    ("bad", "said"), [(b"\0", "holds a zero byte"), (b"\xff", "UTF-8"), (b"\xc3", "UTF-8")]
)
def test_what_is_no_text_is_named_in_its_own_row(
    read: Read, monkeypatch: pytest.MonkeyPatch, block: int, bad: bytes, said: str
) -> None:
    """In any block; a character may stand across two, and its row is that of its first byte."""
    monkeypatch.setattr(csv, "BLOCK", block)
    lines = [b"t,a,b", *["0.5,é,1".encode()] * 300]
    assert len(read(b"\n".join(lines), ["t"]).columns["t"]) == 300
    lines[200] += bad
    with pytest.raises(LogError, match=f"row 201: .*{said}"):
        read(b"\n".join(lines), ["t"])


@pytest.mark.parametrize("cell", ["1_000", "１", "²", "1e400", "0x10", "1 2", "1n"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_what_python_takes_and_a_log_has_not_is_refused(read: Read, cell: str, end: str) -> None:
    with pytest.raises(LogError, match=f"row 3, column 'a': '{cell}' is not a finite number"):
        read(["t,a", "0,1", f"1,{cell}"], end=end)


@pytest.mark.parametrize("block", [1, 30, 1000])
def test_a_file_is_read_in_parts(read: Read, monkeypatch: pytest.MonkeyPatch, block: int) -> None:
    """Wherever a part ends: values to the last bit, missing ones, and the row of a cell that is
    none.
    """
    monkeypatch.setattr(csv, "BLOCK", block)
    values = np.random.default_rng(3).normal(size=(200, 3)) * 10.0 ** np.arange(-100, 100)[:, None]
    values[::7, 1] = np.nan
    lines = [",".join(map(repr, row)).replace("nan", "") for row in values.tolist()]
    found = read(["t,a,b", *lines]).columns
    np.testing.assert_array_equal(np.column_stack(list(found.values())), values)
    lines[150] = "1,2,x1"
    with pytest.raises(LogError, match="row 152, column 'b': 'x1'"):
        read(["t,a,b", *lines])


HEADER = "t,a [°],b"


WIDE = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le")


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    ("code", "minus"),
    [*((code, sign) for code in WIDE for sign in ("-", "\N{MINUS SIGN}")), ("latin-1", "-")],
)
def test_codes_of_text(read: Read, code: str, minus: str, end: str) -> None:
    """What spreadsheets and other languages' programs write is read as what it says."""
    table = read(end.join([HEADER, *ROWS, ""]).replace("-", minus).encode(code))
    assert table.names == ("t", "a [°]", "b")
    np.testing.assert_array_equal(table.values("b"), -A)


def test_a_compressed_file(read: Read) -> None:
    packed = gzip.compress("\n".join([HEADER, *ROWS]).encode())
    np.testing.assert_array_equal(read(packed, name="log.csv.gz").values("b"), -A)
    with pytest.raises(LogError, match="cannot be read"):
        read(packed[:-20], name="log.csv.gz")


ABOVE = [
    ["sep=,"],
    ["LabVIEW Measurement", "Writer_Version\t2", "Date\t2024/05/03", "***End_of_Header***", ""],
    ["Device: 3", "Rate, 100 Hz", "x,y,z,w"],
]


@pytest.mark.parametrize("above", ABOVE)
@pytest.mark.parametrize("end", ["", ","])
def test_lines_above_the_header_are_left_out(read: Read, above: list[str], end: str) -> None:
    """The header is the last line above the numbers with as many cells; rows may end with a
    separator.
    """
    with pytest.warns(DistalWarning, match=f"lines above the header, row {len(above) + 1}, are"):
        table = read([*above, HEADER, *(row + end for row in ROWS)])
    assert table.names == ("t", "a [°]", "b")
    assert table.first_row == len(above) + 2
    np.testing.assert_array_equal(table.values("b"), -A)


@pytest.mark.parametrize(
    ("odd", "said"),
    [
        ("0.40,4", r"is too short .*; rows left out: 1$"),
        ("End of log,,", "'End of log' is no number: taken as missing, 1 in all"),
        ("pause,on,off", "'pause' is no number: taken as missing, 1 in all"),
        ("", None),
        ("# done", None),
    ],
)
@pytest.mark.parametrize("at", [17, 40])
def test_what_is_no_row_is_left_out(read: Read, odd: str, said: str | None, at: int) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        table = read([HEADER, *ROWS[:at], odd, *ROWS[at:]]).parsed(["t", "b"])
    there = np.isfinite(table.columns["t"])
    np.testing.assert_array_equal(table.columns["b"][there], -A)
    assert bool(caught) == (said is not None)
    assert said is None or re.search(rf"row {at + 2}[:,].*{said}", str(caught[0].message))


def test_decimal_commas_between_commas_are_named(read: Read) -> None:
    with pytest.raises(LogError, match="are these decimal commas"):
        read([HEADER, *(f"0,{k:02d},1,{k},-2,{k}" for k in range(9))])


def test_json_lines(read: Read) -> None:
    lines = [f'{{"t": {k / 100}, "m": {{"q": {k}}}, "x": [1, {-k}]}}' for k in range(9)]
    table = read(lines, name="log.jsonl")
    assert table.names == ("t", "m.q", "x.0", "x.1")
    np.testing.assert_array_equal(table.values("x.1"), -np.arange(9.0))
    for bad, said in (("{", "row 10: is no JSON"), ("3", "row 10: is no JSON object")):
        with pytest.raises(LogError, match=said):
            read([*lines, bad], name="log.jsonl")
