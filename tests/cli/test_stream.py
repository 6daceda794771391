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

import numpy as np
import polars as pl
import pytest

from distal import Log, Rig, estimate, load_scenario, scenario_rig, simulate
from distal.cli import main
from distal.logs import write_log

Run = Callable[..., tuple[str, str, int]]
Answers = Callable[..., pl.DataFrame]
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


@pytest.fixture
def answers(run: Run) -> Answers:
    """What a stream that is taken is answered with, of CSV or JSON."""

    def call(text: str, *options: str) -> pl.DataFrame:
        out, err, code = run(text, *options)
        assert code == 0, err
        return (pl.read_ndjson if out.startswith("{") else pl.read_csv)(out.encode())

    return call


@pytest.mark.parametrize(("unit", "factor"), [("deg", np.rad2deg(1.0)), ("rad", 1.0)])
def test_what_comes_as_csv_or_json_is_answered_so(
    answers: Answers, rig: Rig, log: Log, csv: str, unit: str, factor: float
) -> None:
    """As `estimate` has it, in the unit that is asked for."""
    result = estimate(log, rig)
    rows = answers(csv, "--unit", unit)
    assert set(rows["health"]) == {"untested"}
    found = answers("\n".join(as_json(csv)), "--unit", unit)
    np.testing.assert_allclose(found["t"], log.time)
    for name, values in (("theta", result.theta), ("theta_std", result.theta_std)):
        np.testing.assert_allclose(rows[f"{name} [{unit}]"], factor * values, atol=1e-12)
        np.testing.assert_array_equal(found[name], rows[f"{name} [{unit}]"])


@pytest.mark.slow
def test_other_ways_to_write_csv(run: Run, csv: str) -> None:
    known, _, _ = run(csv)
    rows = [line.split(",")[:5] for line in csv.splitlines()]
    for text in (
        "\ufeff" + csv.replace("\n", "\r\n"),
        "# a comment\n" + "\n".join(";".join(row) for row in rows),
        "\n".join("\t".join(row) for row in rows),
        "\n".join(",".join(f'"{cell}"' for cell in row) for row in rows),
        "\n".join(", ".join(['"a, b"' if i else "note", *row]) for i, row in enumerate(rows)),
    ):
        out, err, _ = run(text)
        assert out == known, err
    out, err, _ = run("\n".join(",".join(row[:4]) for row in rows))
    assert "the stream has no column u2" in err
    assert out.splitlines()[1].split(",")[3] == "missing"


def test_bad_json_is_answered(answers: Answers, csv: str) -> None:
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
    health = answers("\n".join([*good[:30], *odd, *good[31:]]))["health"].to_list()
    assert health[30:39] == [*["bad"] * 8, "gap"]
    assert health[-1] == "untested"
    midway = answers("\n".join([good[0][9:], *good[1:40]]), "--json")
    assert midway["health"].to_list() == ["bad"] + ["untested"] * 39


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


@pytest.mark.slow
def test_what_cannot_begin_is_one_line(run: Run, csv: str) -> None:
    """It says what the first line lacks, not what the last row of numbers lacks as a header."""
    for text, options, said in (
        ("ms,x9\n0,1.5\n10,2.5\n", [], "header lacks the time column 't' (it has ms, x9)"),
        ("t,a\n1,2\n", [], "none of the columns x1, x2, u1, u2"),
        ("t,t,x1\n1,2,3\n", [], "'t' twice"),
        (csv, ["-e", "particle"], "unknown estimator"),
        (csv, ["--unit", "grad"], "--unit grad: angles are written in rad or deg"),
    ):
        out, err, code = run(text, *options)
        assert (out, code) == ("", 2)
        assert said in err.splitlines()[-1]
    assert run("")[::2] == ("", 0)


def test_an_empty_last_cell_of_a_line_with_tabs(answers: Answers) -> None:
    """It is a cell: the sensor is missing in that sample, and the sample is not lost."""
    rows = ["t\tx1\tx2\tu1\tu2", "0\t0\t0\t2\t2", "0.01\t0\t0\t2\t", "0.02\t0\t0\t2\t2"]
    health = answers("\n".join(rows))["health"]
    assert len(health) == 3
    assert "bad" not in health


def test_a_line_that_is_no_sample_has_the_cells_of_the_others(answers: Answers, csv: str) -> None:
    """With a joint that may be touched there are columns of its torque."""
    lines = csv.splitlines()[:6]
    lines.insert(3, "x,y")
    rows = answers("\n".join(lines), "--set", 'joints.0.external_torque.std="0.1 N m"')
    assert rows.columns[-3] == "external_torque_std [N m]"
    *cells, health, why = rows.row(2)
    assert (set(cells), health) == ({None}, "bad")
    assert why.startswith("2 cells came, ")
    assert list(rows["health"] == "bad") == [False, False, True, False, False, False]
