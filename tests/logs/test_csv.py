"""CSV: every line is a row; what cannot be one is refused with the file's own row number."""

from __future__ import annotations

import gzip
import re
import tracemalloc
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distal import Rig, read_log
from distal.errors import DistalWarning, LogError
from distal.logs import read_table

ROWS = [f"{k / 100},{k},-{k}" for k in range(40)]


def written(path: Path, lines: list[str], end: str = "\n") -> Path:
    path.write_text(end.join(lines) + end, newline="")
    return path


@pytest.mark.parametrize("quote", ["", '"'])
@pytest.mark.parametrize("above", [0, 3])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_row_numbers_are_the_files(tmp_path: Path, quote: str, above: int, end: str) -> None:
    """An editor shows the same number, whatever stands above the header and whether cells are
    quoted.
    """
    header = [""] * above + [f"{quote}t{quote},a,b"]
    for bad, said in (
        ("0.5,x1,1", "column 'a': 'x1' is not"),
        ("0.5,x,1", "column 'a': 'x' is no number: taken as missing, 1 in all"),
        ("0.5,1", "is too short"),
        ("0.5,1,2,3", "is too long"),
    ):
        lines = header + ROWS[:7] + [bad] + ROWS[7:]
        with pytest.raises((LogError, DistalWarning), match=f"row {above + 9}[:,].*{said}"):
            read_table(written(tmp_path / "log.csv", lines, end)).parsed(["a"])


@given(
    cells=st.lists(
        st.tuples(
            *[st.sampled_from(["1", '"2"', '"3', '4"', '"', '""', '5"6', '"7"8', "", '"a\rb"'])] * 3
        ),
        min_size=1,
        max_size=12,
    )
)
def test_no_row_is_lost(
    cells: list[tuple[str, str, str]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Whatever quotes stand where: a file is refused, or it has as many rows as lines, and each is
    the line's.
    """
    lines = [f"{k}," + ",".join(row) for k, row in enumerate(cells)]
    path = written(tmp_path_factory.mktemp("csv") / "log.csv", ["t,a,b,c", *lines])
    try:
        table = read_table(path)
    except (LogError, DistalWarning):
        return
    assert np.array_equal(table.columns["t"], np.arange(len(lines)))
    for k, row in enumerate(cells):
        for name, cell in zip("abc", row):
            value, plain = table.columns[name][k], cell.strip('"')
            assert np.isnan(value) if plain == "" else value == float(plain)


def test_a_quote_that_is_not_closed_is_named(tmp_path: Path) -> None:
    lines = ["t,a,b", *ROWS[:20], '0.3,"20,-20', *ROWS[21:30], '0.4,30,"-30"', *ROWS[31:]]
    with pytest.raises(LogError, match=r"row 22: .*quote.* not closed"):
        read_table(written(tmp_path / "log.csv", lines))


def test_what_is_no_text_is_named(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    for bad, said in ((b"\0", "holds a zero byte"), (b"\xff", "is not UTF-8")):
        text = "\n".join(["t,a,b", *ROWS * 20]).encode()
        position = text.index(b"\n", 6000) + 1
        path.write_bytes(text[:position] + bad + text[position:])
        row = text[:position].count(b"\n") + 1
        with pytest.raises(LogError, match=f"row {row}: .*{said}"):
            read_table(path)


def test_memory_is_asked_for_before_it_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path / "log.csv", ["t,a,b", *ROWS * 1250])
    assert len(read_table(path).columns["t"]) == 50_000
    monkeypatch.setenv("DISTAL_MAX_MEMORY", "3 MB")
    assert len(read_table(path, ["t", "a"]).columns["t"]) == 50_000
    with pytest.raises(
        LogError,
        match=r"4\d,\d\d\d rows of 3 columns or more, about 0.0 GB .*DISTAL_MAX_MEMORY=16GB",
    ):
        read_table(path)
    monkeypatch.setenv("DISTAL_MAX_MEMORY", "much")
    with pytest.raises(LogError, match="DISTAL_MAX_MEMORY: 'much'"):
        read_table(path)


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="there is no device that never ends")
def test_what_never_ends_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISTAL_MAX_MEMORY", "3 MB")
    with pytest.raises(LogError, match="row 1: is not text, it holds a zero byte"):
        read_table("/dev/zero")


@pytest.mark.more
def test_a_long_file_is_never_in_memory_as_text(tmp_path: Path, pulley_rig: Rig) -> None:
    """Of a row of 60 bytes its five numbers are held, and a copy of them while they are read."""
    count = 20_000
    rows = (f"{k / 100:.2f},{1e-3 + 1e-9 * k:.12f},{1e-3:.12f},2.{k % 3},2.1" for k in range(count))
    path = written(tmp_path / "log.csv", ["t,x1,x2,u1,u2", *rows])
    read_log(path, pulley_rig)
    tracemalloc.start()
    log = read_log(path, pulley_rig)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(log) == count
    assert peak < count * 8 * 5 * 3 + 2e6


def test_a_file_without_a_header(tmp_path: Path) -> None:
    """Its first row is one of numbers, not one of names."""
    path = tmp_path / "log.csv"
    for first in ("0.0,1,2", "2026-11-20T21:02:47.5Z,1,2", '"0.0",,2'):
        written(path, ["", first, *ROWS])
        with pytest.warns(DistalWarning, match=r"no header; .* 'column 1' to 'column 3'"):
            table = read_table(path, ["column 3"])
        np.testing.assert_array_equal(table.columns["column 3"], [2, *(-k for k in range(40))])
        assert table.first_row == 2
    written(path, ["1,b,c", *ROWS])
    assert list(read_table(path).columns) == ["1", "b", "c"]
    written(path, ["1,2,3", *ROWS])
    assert len(read_table(path, ["2"]).columns["2"]) == 40  # a name that is asked for


def test_many_columns_take_no_time(tmp_path: Path) -> None:
    """The time is that of reading, not the square of the number of columns."""
    import time

    names = ["t", *(f"c{k}" for k in range(30_000))]
    path = written(
        tmp_path / "wide.csv", [",".join(names), *(",".join(["1"] * len(names)) for _ in range(2))]
    )
    began = time.perf_counter()
    read_table(path, ["t"])
    assert time.perf_counter() - began < 5.0


def test_text_beyond_the_first_block_is_looked_at(tmp_path: Path) -> None:
    """A character may stand across two blocks; a byte that is none is found in any of them."""
    line = "0.5,é,1\n".encode()
    many = line * (3_000_000 // len(line))
    path = tmp_path / "log.csv"
    path.write_bytes(b"t,a,b\n" + many)
    assert len(read_table(path, ["t"]).columns["t"]) == many.count(b"\n")
    path.write_bytes(b"t,a,b\n" + many + b"0.5,\xff,1\n")
    with pytest.raises(LogError, match=f"row {many.count(10) + 2}: is not UTF-8"):
        read_table(path, ["t"])


def test_a_character_that_is_cut_at_a_block_is_in_its_own_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its first byte ends a block and the next row begins the other: the row is that of the first
    byte's line.
    """
    from distal.logs.formats import csv

    data = b"t,a\n1,\xc3\n2,3\n"
    monkeypatch.setattr(csv, "BLOCK", data.index(b"\xc3") + 1)
    path = tmp_path / "log.csv"
    path.write_bytes(data)
    with pytest.raises(LogError, match="row 2: is not UTF-8"):
        read_table(path)


@pytest.mark.parametrize("cell", ["1_000", "１", "²", "1e400", "0x10", "1 2", "1n"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_what_python_takes_and_a_log_has_not_is_refused(
    tmp_path: Path, cell: str, end: str
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(end.join(["t,a", "0,1", f"1,{cell}", ""]), encoding="utf-8", newline="")
    with pytest.raises(LogError, match=f"row 3, column 'a': '{cell}' is not a finite number"):
        read_table(path)


@pytest.mark.parametrize("block", [1, 30, 1000])
def test_a_file_is_read_in_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    """Wherever a part ends: values to the last bit, missing ones, and the row of a cell that is
    none.
    """
    from distal.logs.formats import csv

    monkeypatch.setattr(csv, "BLOCK", block)
    values = np.random.default_rng(3).normal(size=(200, 3)) * 10.0 ** np.arange(-100, 100)[:, None]
    values[::7, 1] = np.nan
    lines = [
        ",".join("" if value != value else repr(value) for value in row) for row in values.tolist()
    ]
    read = read_table(written(tmp_path / "log.csv", ["t,a,b", *lines])).columns
    np.testing.assert_array_equal(np.column_stack(list(read.values())), values)
    lines[150] = "1,2,x1"
    with pytest.raises(LogError, match="row 152, column 'b': 'x1'"):
        read_table(written(tmp_path / "log.csv", ["t,a,b", *lines]))


HEADER = "t,a [°],b"


def as_written(path: Path, text: str, code: str) -> Path:
    path.write_bytes(text.encode(code))
    return path


WIDE = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le")


@pytest.mark.parametrize(
    ("code", "minus"),
    [*((code, sign) for code in WIDE for sign in ("-", "\N{MINUS SIGN}")), ("latin-1", "-")],
)
def test_codes_of_text(tmp_path: Path, code: str, minus: str) -> None:
    """What spreadsheets and other languages' programs write is read as what it says."""
    text = "\n".join([HEADER, *ROWS]).replace("-", minus) + "\n"
    for end in ("\n", "\r\n", "\r"):
        table = read_table(as_written(tmp_path / "log.csv", text.replace("\n", end), code))
        assert table.names == ("t", "a [°]", "b")
        np.testing.assert_array_equal(table.values("b"), -np.arange(40.0))


def test_a_compressed_file(tmp_path: Path) -> None:
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress("\n".join([HEADER, *ROWS]).encode()))
    np.testing.assert_array_equal(read_table(path).values("b"), -np.arange(40.0))
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(LogError, match="cannot be read"):
        read_table(path)


ABOVE = [
    ["sep=,"],
    ["LabVIEW Measurement", "Writer_Version\t2", "Date\t2024/05/03", "***End_of_Header***", ""],
    ["Device: 3", "Rate, 100 Hz", "x,y,z,w"],
]


@pytest.mark.parametrize("above", ABOVE)
@pytest.mark.parametrize("end", ["", ","])
def test_lines_above_the_header_are_left_out(tmp_path: Path, above: list[str], end: str) -> None:
    """The header is the last line above the numbers with as many cells; rows may end with a
    separator.
    """
    lines = [*above, HEADER, *(row + end for row in ROWS)]
    with pytest.warns(DistalWarning, match=f"lines above the header, row {len(above) + 1}, are"):
        table = read_table(written(tmp_path / "log.csv", lines))
    assert table.names == ("t", "a [°]", "b")
    assert table.first_row == len(above) + 2
    np.testing.assert_array_equal(table.values("b"), -np.arange(40.0))


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
def test_what_is_no_row_is_left_out(tmp_path: Path, odd: str, said: str | None, at: int) -> None:
    path = written(tmp_path / "log.csv", [HEADER, *ROWS[:at], odd, *ROWS[at:]])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        table = read_table(path).parsed(["t", "b"])
    there = np.isfinite(table.columns["t"])
    np.testing.assert_array_equal(table.columns["b"][there], -np.arange(40.0))
    assert bool(caught) == (said is not None)
    assert said is None or re.search(rf"row {at + 2}[:,].*{said}", str(caught[0].message))


def test_decimal_commas_between_commas_are_named(tmp_path: Path) -> None:
    rows = [f"0,{k:02d},1,{k},-2,{k}" for k in range(9)]
    with pytest.raises(LogError, match="are these decimal commas"):
        read_table(written(tmp_path / "log.csv", [HEADER, *rows]))


def test_json_lines(tmp_path: Path) -> None:
    lines = [f'{{"t": {k / 100}, "m": {{"q": {k}}}, "x": [1, {-k}]}}' for k in range(9)]
    table = read_table(written(tmp_path / "log.jsonl", lines))
    assert table.names == ("t", "m.q", "x.0", "x.1")
    np.testing.assert_array_equal(table.values("x.1"), -np.arange(9.0))
    for bad, said in (("{", "row 10: is no JSON"), ("3", "row 10: is no JSON object")):
        with pytest.raises(LogError, match=said):
            read_table(written(tmp_path / "log.jsonl", [*lines, bad]))
