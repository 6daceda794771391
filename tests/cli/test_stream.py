"""`distal stream`: lines in, lines out at once; as a process where that
matters.
"""

from __future__ import annotations

import io
import json
import signal
import subprocess
import sys
from collections.abc import Callable
from csv import reader as rows_of

import numpy as np
import polars as pl
import pytest

from distal import Log, Rig, estimate, load_scenario, scenario_rig, simulate
from distal.cli import main
from distal.logs import write_log

Run = Callable[..., tuple[str, str, int]]
COMMAND = [sys.executable, "-m", "distal", "stream", "--rig", "paper-2008-printed"]
for path, value in load_scenario("series-2").set.items():
    COMMAND += ["--set", f"{path}={json.dumps(value)}"]


@pytest.fixture(scope="module")
def rig() -> Rig:
    return scenario_rig(load_scenario("series-2"))


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    return simulate(rig, load_scenario("series-2"), 5).select(slice(0, 300))


@pytest.fixture(scope="module")
def csv(rig: Rig, log: Log, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("stream") / "log.csv"
    write_log(log, rig, path)
    return path.read_text()


def as_json(csv: str) -> list[str]:
    return [
        json.dumps(row)
        for row in pl.read_csv(csv.encode()).select("t", "x1", "u1", "x2", "u2").to_dicts()
    ]


@pytest.fixture
def run(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """The same within this process, which saves the second that a process takes to begin."""

    def call(text: str, *options: str) -> tuple[str, str, int]:
        monkeypatch.setattr(sys, "argv", ["distal", *COMMAND[3:], *options])
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
        capfd.readouterr()
        with pytest.raises(SystemExit) as stopped:
            main()
        said = capfd.readouterr()
        return said.out, said.err, int(stopped.value.code or 0)

    return call


def test_csv_in_csv_out(run: Run, rig: Rig, log: Log, csv: str) -> None:
    out, err, code = run(csv)
    assert code == 0, err
    rows = pl.read_csv(out.encode())
    np.testing.assert_allclose(
        rows["theta [deg]"], np.rad2deg(estimate(log, rig).theta), atol=1e-12
    )
    assert set(rows["health"]) == {"untested"}
    assert "300 samples in" in err


def test_angles_in_degrees(run: Run, csv: str) -> None:
    """As the log has them, in CSV and JSON."""
    radians = pl.read_csv(run(csv, "--unit", "rad")[0].encode())
    out, err, code = run(csv)
    assert code == 0, err
    rows = pl.read_csv(out.encode())
    for name in ("theta", "theta_std"):
        np.testing.assert_allclose(
            rows[f"{name} [deg]"], np.rad2deg(radians[f"{name} [rad]"]), rtol=1e-12
        )
    first = json.loads(run(csv, "--unit", "deg", "--json")[0].splitlines()[0])
    assert first["theta"] == rows["theta [deg]"][0]
    assert run(csv, "--unit", "grad")[1:] == (
        "error: --unit grad: angles are written in rad or deg\n",
        2,
    )


def test_json_in_json_out(run: Run, rig: Rig, log: Log, csv: str) -> None:
    out, err, code = run("\n".join(as_json(csv)))
    assert code == 0, err
    rows = [json.loads(line) for line in out.splitlines()]
    assert [row["t"] for row in rows] == pytest.approx(log.time)
    np.testing.assert_allclose(
        [row["theta"] for row in rows], np.rad2deg(estimate(log, rig).theta), atol=1e-12
    )


@pytest.mark.slow
def test_other_ways_to_write_csv(run: Run, csv: str) -> None:
    known, _, _ = run(csv)
    rows = [line.split(",")[:5] for line in csv.splitlines()]
    for text in (
        "\ufeff" + csv.replace("\n", "\r\n"),
        "# a comment\n" + "\n".join(";".join(row) for row in rows),
        "\n".join("\t".join(row) for row in rows),
        "\n".join(",".join(f'"{cell}"' for cell in row) for row in rows),
        "\n".join(
            ", ".join(["note", *row]) if i == 0 else ", ".join(['"a, b"', *row])
            for i, row in enumerate(rows)
        ),
    ):
        out, err, code = run(text)
        assert code == 0, err
        assert out == known
    out, err, _ = run("\n".join(",".join(row[:4]) for row in rows))
    assert "the stream has no column u2" in err
    assert out.splitlines()[1].split(",")[3] == "missing"


def test_a_stream_that_begins_midway(run: Run, csv: str) -> None:
    good = as_json(csv)
    out, err, code = run("\n".join([good[0][9:], *good[1:40]]))
    assert code == 0, err
    words = [json.loads(line)["health"] for line in out.splitlines()]
    assert words == ["bad"] + ["untested"] * 39


def test_bad_json_is_answered(run: Run, csv: str) -> None:
    good = as_json(csv)
    odd = [
        "[]",
        "3",
        "{",
        '{"x1": 1}',
        '{"t": "soon"}',
        '{"t": 0.3051, "x1": "wide"}',
        '{"t": 0.305, "x1": true}',
        '{"t": NaN}',
    ]
    out, err, code = run("\n".join([*good[:30], *odd, *good[31:]]))
    assert code == 0, err
    rows = [json.loads(line) for line in out.splitlines()]
    assert [row["health"] for row in rows[30:38]] == ["bad"] * 8
    assert rows[38]["health"] == "gap"
    assert rows[-1]["health"] == "untested"


def test_each_line_is_answered_at_once_and_stopped_it_says_how_many_came(csv: str) -> None:
    lines = csv.splitlines(keepends=True)
    process = subprocess.Popen(
        COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(lines[0])
    for line in lines[1:51]:
        process.stdin.write(line)
        process.stdin.flush()
        if line is lines[1]:
            assert process.stdout.readline().startswith("t [s],theta [deg]")
        assert process.stdout.readline().startswith(line.split(",")[0])
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "50 samples" in err
    assert err.splitlines()[-1] == "stopped"


def test_a_stream_without_its_header_says_what_the_first_line_lacks(run: Run) -> None:
    """Not what the last row of numbers lacks as a header."""
    out, err, code = run("ms,x9\n0,1.5\n10,2.5\n")
    assert (out, code) == ("", 2)
    assert (
        err.splitlines()[-1]
        == "error: the stream's header lacks the time column 't' (it has ms, x9)"
    )


@pytest.mark.slow
def test_what_cannot_begin_is_one_line(run: Run, csv: str) -> None:
    for text, options, said in (
        ("t,a\n1,2\n", [], "none of the columns x1, x2, u1, u2"),
        ("t,t,x1\n1,2,3\n", [], "'t' twice"),
        (csv, ["-e", "particle"], "unknown estimator"),
    ):
        out, err, code = run(text, *options)
        assert code == 2, (options, err)
        assert said in err
        assert "Traceback" not in err
    out, err, code = run("")
    assert (out, code) == ("", 0)


def test_an_empty_last_cell_of_a_line_with_tabs(run: Run) -> None:
    """It is a cell: the sensor is missing in that sample, and the sample is not lost."""
    rows = ["t\tx1\tx2\tu1\tu2", "0\t0\t0\t2\t2", "0.01\t0\t0\t2\t", "0.02\t0\t0\t2\t2"]
    out, err, code = run("\n".join(rows))
    assert code == 0, err
    health = [line.split(",")[-2] for line in out.splitlines()[1:]]
    assert len(health) == 3
    assert "bad" not in health


def test_a_line_that_is_no_sample_has_the_cells_of_the_others(run: Run, csv: str) -> None:
    """With a joint that may be touched there are columns of its torque."""
    lines = csv.splitlines()[:6]
    touched = "--set", 'joints.0.external_torque.std="0.1 N m"'
    out, err, code = run("\n".join([*lines[:3], "x,y", *lines[3:]]) + "\n", *touched)
    assert code == 0, err
    header, *answers = list(rows_of(out.splitlines()))
    assert header[-3] == "external_torque_std [N m]"
    bad = [answer for answer in answers if answer[-2] == "bad"]
    assert [answer[:-2] for answer in bad] == [[""] * (len(header) - 2)]
    assert bad[0][-1].startswith("2 cells came, ")
    assert {len(answer) for answer in answers} == {len(header)}
