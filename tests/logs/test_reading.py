"""Logs from files: what is read, and what is refused by file, row and column."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from distal import Log, Rig, read_log, write_log
from distal.errors import DistalWarning, LogError
from distal.logs import TruthKind, read_truth

GOOD = "t,x1,x2,u1,u2\n0.00,1e-3,2e-3,2.0,2.1\n0.01,1.1e-3,2.1e-3,2.0,2.1\n0.02,1.2e-3,2.2e-3,2.0,2.1\n"


Read = Callable[..., Log]


@pytest.fixture
def read(tmp_path: Path, pulley_rig: Rig) -> Read:
    """Write a file and read it by the rig with other values."""

    def call(text: str | bytes, values: dict[str, object] | None = None, **more: object) -> Log:
        path = tmp_path / "log.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_log(path, pulley_rig.with_values(values or {}), **more)

    return call


TIME, X1, X2 = np.array([0.0, 0.01, 0.02]), [1e-3, 1.1e-3, 1.2e-3], [2e-3, 2.1e-3, 2.2e-3]


@pytest.mark.parametrize(
    "text",
    [
        GOOD.replace(",", ";"),
        GOOD.replace(",", "\t"),
        GOOD + "\n\n",
        *(
            GOOD.replace("t,x1,x2,u1,u2", header)
            for header in (
                " t , x1 ,x2,u1,u2",
                '"t","x1",x2,u1,u2',
                "T,X1,X2,U1,U2",
                "t,rigX1,rigX2,U1,u_2",
                "t[s],x1[m],x2(m),u1 (N),u2[N]",
                "__t,/rig/x1,/rig/x2,/rig/u1,rig.u2",
                "timestamp,x1,x2,u1,u2",
                "Time [s],x1,x2,u1,u2",
                "ts,x1,x2,u1,u2",
                "Stamp(s),x1,x2,u1,u2",
            )
        ),
    ],
)
def test_reads_other_habits(read: Read, text: str) -> None:
    """Separators, line ends and quotes, columns that are known by their words, and a usual name of
    the time.
    """
    log = read(text)
    np.testing.assert_allclose(log.time, TIME)
    np.testing.assert_allclose(log.channels["x1"], X1)
    np.testing.assert_allclose(log.channels["x2"], X2)


def test_units_signs_and_columns(read: Read) -> None:
    sensor = {"sensors.x1.unit": "mm", "sensors.x1.sign": -1, "sensors.x1.column": "pot"}
    text = "ms,pot,x2,u1,u2\n0,-1,2e-3,2,2\n10,-1.1,2e-3,2,2\n"
    log = read(text, {**sensor, "log.time": {"column": "ms", "unit": "ms"}})
    np.testing.assert_allclose(log.time, [0, 0.01])
    np.testing.assert_allclose(log.channels["x1"], [1e-3, 1.1e-3])


@pytest.mark.parametrize("empty", ["", "nan", "NaN", "NA", "null", "-"])
def test_empty_cells_are_missing(read: Read, empty: str) -> None:
    log = read(GOOD.replace("2.1e-3", empty))
    np.testing.assert_allclose(log.channels["x2"], [2e-3, np.nan, 2.2e-3])


BAD = [
    (GOOD.replace("x2", "x3"), r"column 'x2' is missing; did you mean"),
    (GOOD.replace("t,x1,x2", "t,a/x1,b/x1"), "column 'x1' is missing"),
    (
        GOOD.replace("2.1e-3", '"0,0021"'),
        r"row 3, column 'x2': '0,0021'.*decimal point, not a comma",
    ),
    (
        GOOD.replace(",2.0,2.1\n0", "\n0"),
        r"row 2: is too short \(3 cells; the header has 5\)",
    ),
    (GOOD.replace("\n0.0", "\n9,0.0"), r"row 2: is too long \(6 cells; the header has 5\)"),
    (GOOD.replace("0.02,", "0.005,"), r"row 4: time goes back \(0\.005 s after 0\.01 s\)"),
    (GOOD.replace("0.02,", "0.01,"), r"row 4: time repeats .*--set .*=\"last\"' keeps the last"),
    ("t,x1,x2,u1,u2\n0,1e-3,2e-3,2,2\n", r"has one row"),
    ("t,x1,x2,u1,u2\n", r"no rows"),
    ("", r"is empty"),
    (GOOD.replace("x2", "x1"), r"column 'x1' more than once"),
]


TORN = [
    (GOOD.replace("2.1e-3", "-inf"), "row 3, column 'x2': '-inf' is no number", 3),
    (GOOD.replace("0.02,", ","), "row 4 left out, 1 in all: a stamp missing", 2),
]


@pytest.mark.parametrize(("text", "said", "rows"), TORN)
def test_single_odd_rows_are_left_out_and_said(read: Read, text: str, said: str, rows: int) -> None:
    with pytest.warns(DistalWarning) as caught:
        log = read(text)
    assert said in str(caught[0].message)
    assert len(log) == rows
    assert np.isfinite(log.channels["x1"]).all()


@pytest.mark.parametrize(("text", "said"), BAD)
def test_bad_logs_are_refused(read: Read, text: str | bytes, said: str) -> None:
    with pytest.raises(LogError, match=rf"^\S*log\.csv: .*{said}") as caught:
        read(text)
    assert "\n" not in str(caught.value)


def test_unreadable_files(tmp_path: Path, pulley_rig: Rig) -> None:
    (tmp_path / "log.parquet").write_text(GOOD)
    for name, said in (
        ("missing.csv", "cannot be read"),
        (".", "is a folder"),
        ("log.parquet", "cannot be read as Parquet"),
    ):
        with pytest.raises(LogError, match=said):
            read_log(tmp_path / name, pulley_rig)


def test_truth_from_a_column_a_file_and_a_reference(
    read: Read, tmp_path: Path, paper_rig: Rig
) -> None:
    frame = pl.read_csv(GOOD.encode()).with_columns(encoder=pl.Series([0.0, 0.1, 0.2]))
    text, other = frame.write_csv(), tmp_path / "truth.csv"
    np.testing.assert_allclose(read(text, truth="encoder").truth["theta"], [0.0, 0.1, 0.2])
    assert "theta" not in read(text).truth
    other.write_text("t,theta\n0,0\n0.02,0.4\n")
    np.testing.assert_allclose(read(text, truth=other).truth["theta"], [0, 0.2, 0.4])
    # the paper rig's encoder counts degrees
    log = read_log(frame, paper_rig)
    np.testing.assert_allclose(log.truth["theta"], np.deg2rad([0.0, 0.1, 0.2]))
    assert str(log.truth_source) == "column 'encoder', the reference sensor"
    assert log.truth_kind is TruthKind.SENSOR
    with pytest.raises(LogError, match=r"'e' is neither a file nor a column \(the log has t, x1"):
        read(text, truth="e")
    other.write_text("t,theta\n0.01,0\n1,1\n")
    assert np.isnan(read_truth(other, np.array([0.0, 0.5]))["theta"][0])
    other.write_text("t,theta\n10,0\n11,0\n")
    with pytest.raises(LogError, match="does not overlap"):
        read(text, truth=other)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.floats(-1e3, 1e3, allow_subnormal=False) | st.just(float("nan")), min_size=2, max_size=20
    ),
    st.sampled_from([".csv", ".parquet"]),
)
def test_what_is_written_is_read_back(
    tmp_path: Path, pulley_rig: Rig, values: list[float], ending: str
) -> None:
    column = np.array(values) * 1e-5
    channels = {"x1": column, "x2": column[::-1], "u1": column * 1e3, "u2": column * 0}
    log = Log(0.1 * np.arange(len(values)), channels, {"theta": column * 0})
    path = tmp_path / f"written{ending}"
    write_log(log, pulley_rig, path)
    back = read_log(path, pulley_rig)
    np.testing.assert_array_equal(back.time, log.time)
    for name in log.channels:
        np.testing.assert_array_equal(back.channels[name], log.channels[name])
    if np.isfinite(column).any():
        np.testing.assert_array_equal(back.truth["theta"], log.truth["theta"])


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(alphabet="0123456789.,;-e\nnatx \"'", max_size=120))
def test_any_numbers_below_a_good_header_are_read_or_refused(read: Read, tail: str) -> None:
    try:
        log = read(GOOD + tail)
    except (LogError, DistalWarning):  # what is no row at the end is left out with a warning
        return
    assert np.all(np.diff(log.time) > 0)


def test_a_list_is_no_log(pulley_rig: Rig) -> None:
    with pytest.raises(LogError, match=r"a log is a path, a frame or a distal\.Log; list came"):
        read_log([1, 2], pulley_rig)


@pytest.mark.parametrize(("kept", "value"), [("first", 1.1e-3), ("last", 1.2e-3)])
def test_one_of_the_rows_with_one_stamp_is_kept(read: Read, kept: str, value: float) -> None:
    text = GOOD.replace("0.02,", "0.01,") + "0.03,1.3e-3,2.3e-3,2.0,2.1\n"
    log = read(text, {"log.time.repeated": kept})
    np.testing.assert_array_equal(log.time, [0.0, 0.01, 0.03])
    np.testing.assert_array_equal(log.channels["x1"], [1e-3, value, 1.3e-3])


def frame(time: np.ndarray, *columns: np.ndarray) -> pl.DataFrame:
    return pl.DataFrame(dict(zip(("t", "x1", "x2", "u1", "u2"), (time, *columns))))


def test_a_row_that_has_a_time_alone_stays_a_row(read: Read) -> None:
    log = read("t,x1,x2,u1,u2\n0.0,0,,0,0\n0.1,,,,\n0.2,,0,,\n")
    assert log.time.tolist() == [0.0, 0.1, 0.2]
    assert np.isnan(log.channels["x1"][1:]).all()


def test_rows_of_each_topic_become_rows_of_all(pulley_rig: Rig) -> None:
    """As a union of the stamps of several topics is written, each row with one value."""
    values = np.random.default_rng(5).normal(size=(30, 4))
    time = 0.1 * np.arange(30)[:, None] + 0.001 * np.arange(4)
    cells = np.where(np.eye(4, dtype=bool), values[:, :, None], np.nan).reshape(-1, 4)
    log = read_log(frame(time.ravel(), *cells.T), pulley_rig)
    np.testing.assert_allclose(log.time, time[:, 0], atol=1e-9)
    for name, column in zip(("x1", "x2", "u1", "u2"), values.T):
        np.testing.assert_allclose(log.channels[name], column)


def test_rows_in_the_order_of_texts_are_sorted(pulley_rig: Rig) -> None:
    stamps = np.array(sorted(0.25 * np.arange(60), key=str))
    with pytest.warns(DistalWarning, match="were not in the order of their stamps"):
        log = read_log(frame(stamps, stamps, 0 * stamps, stamps, -stamps), pulley_rig)
    np.testing.assert_allclose(log.time, 0.25 * np.arange(60))
    np.testing.assert_allclose(log.channels["x1"], log.time)


def test_two_runs_between_one_another_are_not_one(pulley_rig: Rig) -> None:
    """The clock of the second began anew, half a step off."""
    time, x = 0.02 * np.arange(60), np.arange(60.0)
    x = np.concatenate([x, -x])
    with pytest.warns(DistalWarning, match="the clock was set back 1 times"):
        log = read_log(frame(np.concatenate([time, time + 0.01]), x, -x, x, x), pulley_rig)
    np.testing.assert_array_equal(log.channels["x1"], np.arange(60))


@pytest.mark.parametrize("name", ["Clock", "millis since boot", "datenum"])
def test_a_time_of_another_name_is_proposed(read: Read, name: str) -> None:
    text = GOOD.replace("t,x1", f"{name},x1")
    with pytest.raises(LogError, match="may be the time") as caught:
        read(text)
    column, *_ = re.findall(r"--set 'log.time.column=\"([^\"]+)\"'", str(caught.value))
    np.testing.assert_allclose(read(text, {"log.time.column": column}).time, TIME)
