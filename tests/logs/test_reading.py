"""Logs from files: what is read, and what is refused by file, row and column."""

from __future__ import annotations

import re
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


def file(folder: Path, text: str | bytes, name: str = "log.csv") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_reads_csv_and_parquet_alike(tmp_path: Path, pulley_rig: Rig) -> None:
    log = read_log(file(tmp_path, GOOD), pulley_rig)
    np.testing.assert_allclose(log.time, [0, 0.01, 0.02])
    np.testing.assert_allclose(log.channels["x2"], [2e-3, 2.1e-3, 2.2e-3])
    assert log.rate == pytest.approx(100)
    pl.read_csv(tmp_path / "log.csv").write_parquet(tmp_path / "log.parquet")
    other = read_log(tmp_path / "log.parquet", pulley_rig)
    for name in log.channels:
        np.testing.assert_array_equal(log.channels[name], other.channels[name])


@pytest.mark.parametrize(
    "text",
    [
        GOOD.replace(",", ";"),
        GOOD.replace(",", "\t"),
        GOOD.replace("\n", "\r\n"),
        "\ufeff" + GOOD,
        GOOD + "\n\n",
        GOOD.replace("t,x1", " t , x1 "),
        GOOD.replace("t,x1", '"t","x1"'),
    ],
)
def test_reads_other_habits(tmp_path: Path, pulley_rig: Rig, text: str) -> None:
    np.testing.assert_allclose(
        read_log(file(tmp_path, text), pulley_rig).channels["x1"], [1e-3, 1.1e-3, 1.2e-3]
    )


def test_units_signs_and_columns(tmp_path: Path, pulley_rig: Rig) -> None:
    rig = pulley_rig.with_values(
        {
            "sensors.x1.unit": "mm",
            "sensors.x1.sign": -1,
            "sensors.x1.column": "pot",
            "log.time": {"column": "ms", "unit": "ms"},
        }
    )
    text = "ms,pot,x2,u1,u2\n0,-1,2e-3,2,2\n10,-1.1,2e-3,2,2\n"
    log = read_log(file(tmp_path, text), rig)
    np.testing.assert_allclose(log.time, [0, 0.01])
    np.testing.assert_allclose(log.channels["x1"], [1e-3, 1.1e-3])


@pytest.mark.parametrize("empty", ["", "nan", "NaN", "NA", "null", "-"])
def test_empty_cells_are_missing(tmp_path: Path, pulley_rig: Rig, empty: str) -> None:
    log = read_log(file(tmp_path, GOOD.replace("2.1e-3", empty)), pulley_rig)
    assert np.isnan(log.channels["x2"][1])
    assert np.isfinite(log.channels["x2"][[0, 2]]).all()


BAD = [
    (GOOD.replace("x2", "x3"), r"log\.csv: column 'x2' is missing; did you mean"),
    (GOOD.replace("2.1e-3", "2w"), r"log\.csv: row 3, column 'x2': '2w' is not a finite number"),
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
    ("\n\n", r"is empty"),
    (GOOD.replace("x2", "x1"), r"column 'x1' more than once"),
    (b"PK\x03\x04\x00\x00", r"is not text"),
    (GOOD.encode() + b"0.03,\xff\xfe,1,1,1\n", r"row 5: is not UTF-8"),
]


TORN = [
    (GOOD.replace("2.1e-3", "two"), "row 3, column 'x2': 'two' is no number: taken as missing", 3),
    (GOOD.replace("2.1e-3", "-inf"), "row 3, column 'x2': '-inf' is no number", 3),
    (GOOD.replace(",2.0,2.1\n0.02", "\n0.02"), "row 3: is too short", 2),
    (GOOD.replace("0.02,", "0.02,9,"), "row 4: is too long", 2),
    (GOOD.replace("0.02,", ","), "row 4 left out, 1 in all: a stamp missing", 2),
]


@pytest.mark.filterwarnings("always::distal.errors.DistalWarning")
@pytest.mark.parametrize(("text", "said", "rows"), TORN)
def test_single_odd_rows_are_left_out_and_said(
    tmp_path: Path, pulley_rig: Rig, text: str, said: str, rows: int
) -> None:
    with pytest.warns(DistalWarning) as caught:
        log = read_log(file(tmp_path, text), pulley_rig)
    assert said in str(caught[0].message)
    assert len(log) == rows
    assert np.isfinite(log.channels["x1"]).all()


@pytest.mark.parametrize(("text", "said"), BAD)
def test_bad_logs_are_refused(
    tmp_path: Path, pulley_rig: Rig, text: str | bytes, said: str
) -> None:
    with pytest.raises(LogError, match=said) as caught:
        read_log(file(tmp_path, text), pulley_rig)
    assert "\n" not in str(caught.value)
    assert str(tmp_path / "log.csv") in str(caught.value)


def test_unreadable_files(tmp_path: Path, pulley_rig: Rig) -> None:
    with pytest.raises(LogError, match="cannot be read"):
        read_log(tmp_path / "missing.csv", pulley_rig)
    with pytest.raises(LogError, match="is a folder"):
        read_log(tmp_path, pulley_rig)
    with pytest.raises(LogError, match="not a Parquet file"):
        read_log(file(tmp_path, GOOD, "log.parquet"), pulley_rig)
    pl.DataFrame(
        {"t": [0.0, 1.0], "x1": ["a", "b"], "x2": [0.0, 0], "u1": [0.0, 0], "u2": [0.0, 0]}
    ).write_parquet(tmp_path / "text.parquet")
    with pytest.raises(LogError, match=r"row 1, column 'x1': 'a' is not a finite number"):
        read_log(tmp_path / "text.parquet", pulley_rig)


def test_truth_from_a_column_a_file_and_a_reference(
    tmp_path: Path, paper_rig: Rig, pulley_rig: Rig
) -> None:
    lines = GOOD.splitlines()
    text = "\n".join([lines[0] + ",angle", *(f"{line},0.{i}" for i, line in enumerate(lines[1:]))])
    path = file(tmp_path, text)
    np.testing.assert_allclose(
        read_log(path, pulley_rig, truth="angle").truth["theta"], [0.0, 0.1, 0.2]
    )
    assert "theta" not in read_log(path, pulley_rig).truth
    other = file(tmp_path, "t,theta\n0,0\n0.02,0.4\n", "truth.csv")
    np.testing.assert_allclose(
        read_log(path, pulley_rig, truth=other).truth["theta"], [0, 0.2, 0.4]
    )
    # the paper rig's encoder counts degrees
    encoder = file(tmp_path, text.replace("angle", "encoder"), "encoder.csv")
    np.testing.assert_allclose(
        read_log(encoder, paper_rig).truth["theta"], np.deg2rad([0.0, 0.1, 0.2])
    )
    with pytest.raises(
        LogError, match=r"'angel' is neither a file nor a column \(the log has t, x1"
    ):
        read_log(path, pulley_rig, truth="angel")
    with pytest.raises(LogError, match="does not overlap"):
        read_log(path, pulley_rig, truth=file(tmp_path, "t,theta\n10,0\n11,0\n", "late.csv"))
    assert np.isnan(
        read_truth(file(tmp_path, "t,theta\n0.01,0\n1,1\n", "part.csv"), np.array([0.0, 0.5]))[
            "theta"
        ][0]
    )


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
    time = 0.1 * np.arange(len(values))
    column = np.array(values) * 1e-5
    log = Log(
        time,
        {"x1": column, "x2": column[::-1], "u1": column * 1e3, "u2": column * 0},
        {"theta": column * 0},
    )
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
def test_any_numbers_below_a_good_header_are_read_or_refused(
    tmp_path: Path, pulley_rig: Rig, tail: str
) -> None:
    try:
        log = read_log(file(tmp_path, GOOD + tail), pulley_rig)
    except (LogError, DistalWarning):  # what is no row at the end is left out with a warning
        return
    assert np.all(np.diff(log.time) > 0)


def test_frames_are_logs_too(pulley_rig: Rig) -> None:
    frame = pl.read_csv(GOOD.encode())
    expected = [1e-3, 1.1e-3, 1.2e-3]
    for one in (frame, frame.to_pandas()):
        np.testing.assert_allclose(read_log(one, pulley_rig).channels["x1"], expected)
        np.testing.assert_allclose(read_log(one, pulley_rig, truth="u1").truth["theta"], 2.0)
    with pytest.raises(LogError, match="column 'x2' is missing"):
        read_log(frame.drop("x2"), pulley_rig)
    with pytest.raises(LogError, match=r"a log is a path, a frame or a distal\.Log; list came"):
        read_log([1, 2], pulley_rig)


def test_where_the_truth_comes_from_is_said(tmp_path: Path, paper_rig: Rig) -> None:
    text = "\n".join(
        f"{line},{tail}" for line, tail in zip(GOOD.splitlines(), ("encoder", "0", "1", "2"))
    )
    read = read_log(file(tmp_path, text), paper_rig)
    assert str(read.truth_source) == "column 'encoder', the reference sensor"
    assert read.truth_kind is TruthKind.SENSOR


@pytest.mark.parametrize(("kept", "value"), [("first", 1.1e-3), ("last", 1.2e-3)])
def test_one_of_the_rows_with_one_stamp_is_kept(
    tmp_path: Path, pulley_rig: Rig, kept: str, value: float
) -> None:
    text = GOOD.replace("0.02,", "0.01,") + "0.03,1.3e-3,2.3e-3,2.0,2.1\n"
    log = read_log(file(tmp_path, text), pulley_rig.with_values({"log.time.repeated": kept}))
    np.testing.assert_array_equal(log.time, [0.0, 0.01, 0.03])
    np.testing.assert_array_equal(log.channels["x1"], [1e-3, value, 1.3e-3])


def test_rows_of_each_topic_become_rows_of_all(tmp_path: Path, pulley_rig: Rig) -> None:
    """As a union of the stamps of several topics is written, each row with one value."""
    values = np.random.default_rng(5).normal(size=(30, 4))
    rows = [
        f"{0.1 * k + 0.001 * i:.4f}," + ",".join("" if j != i else f"{v}" for j in range(4))
        for k, row in enumerate(values.tolist())
        for i, v in enumerate(row)
    ]
    log = read_log(file(tmp_path, "\n".join(["t,x1,x2,u1,u2", *rows])), pulley_rig)
    np.testing.assert_allclose(log.time, 0.1 * np.arange(30), atol=1e-9)
    for i, name in enumerate(("x1", "x2", "u1", "u2")):
        np.testing.assert_allclose(log.channels[name], values[:, i])


def test_rows_in_the_order_of_texts_are_sorted(tmp_path: Path, pulley_rig: Rig) -> None:
    stamps = sorted(f"{0.25 * k}" for k in range(60))
    text = "\n".join(["t,x1,x2,u1,u2", *(f"{t},{t},0,{t},-{t}" for t in stamps)])
    with pytest.warns(DistalWarning, match="were not in the order of their stamps"):
        log = read_log(file(tmp_path, text), pulley_rig)
    np.testing.assert_allclose(log.time, 0.25 * np.arange(60))
    np.testing.assert_allclose(log.channels["x1"], log.time)


@pytest.mark.parametrize(
    "header",
    [
        "T,X1,X2,U1,U2",
        "t,rigX1,rigX2,U1,u_2",
        "t[s],x1[m],x2(m),u1 (N),u2[N]",
        "__t,/rig/x1,/rig/x2,/rig/u1,rig.u2",
    ],
)
def test_columns_are_known_by_their_words(tmp_path: Path, pulley_rig: Rig, header: str) -> None:
    log = read_log(file(tmp_path, GOOD.replace("t,x1,x2,u1,u2", header)), pulley_rig)
    np.testing.assert_allclose(log.channels["x2"], [2e-3, 2.1e-3, 2.2e-3])
    np.testing.assert_allclose(log.time, [0.0, 0.01, 0.02])


def test_of_two_columns_with_the_same_words_none_is_taken(tmp_path: Path, pulley_rig: Rig) -> None:
    text = GOOD.replace("t,x1,x2", "t,a/x1,b/x1")
    with pytest.raises(LogError, match="column 'x1' is missing"):
        read_log(file(tmp_path, text), pulley_rig)


@pytest.mark.parametrize("name", ["timestamp", "Time [s]", "ts", "Stamp(s)"])
def test_a_usual_name_of_the_time_is_enough(tmp_path: Path, pulley_rig: Rig, name: str) -> None:
    log = read_log(file(tmp_path, GOOD.replace("t,x1", f"{name},x1")), pulley_rig)
    np.testing.assert_allclose(log.time, [0.0, 0.01, 0.02])


def test_two_runs_between_one_another_are_not_one(tmp_path: Path, pulley_rig: Rig) -> None:
    """The clock of the second began anew, half a step off."""
    runs = [(0.02 * k + off, way * k) for off, way in ((0.0, 1), (0.01, -1)) for k in range(60)]
    text = "\n".join(["t,x1,x2,u1,u2", *(f"{t:.3f},{x},{-x},{x},{x}" for t, x in runs)])
    with pytest.warns(DistalWarning, match="the clock was set back 1 times"):
        log = read_log(file(tmp_path, text), pulley_rig)
    np.testing.assert_array_equal(log.channels["x1"], np.arange(60))


@pytest.mark.parametrize("name", ["Clock", "millis since boot", "datenum"])
def test_a_time_of_another_name_is_proposed(tmp_path: Path, pulley_rig: Rig, name: str) -> None:
    path = file(tmp_path, GOOD.replace("t,x1", f"{name},x1"))
    with pytest.raises(LogError, match="may be the time") as caught:
        read_log(path, pulley_rig)
    column, *_ = re.findall(r"--set 'log.time.column=\"([^\"]+)\"'", str(caught.value))
    described = pulley_rig.with_values({"log.time.column": column})
    np.testing.assert_allclose(read_log(path, described).time, [0.0, 0.01, 0.02])
