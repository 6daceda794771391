"""Several logs on the command line: a folder of estimates, a line each, bad ones named."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from distal import estimate, load_rig
from distal.cli.app import app

RIG = ["--rig", "paper-2008-printed", "--set", 'joints.0.initial="-25 deg"']


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("runs")
    done = CliRunner().invoke(
        app, ["simulate", "series-2", "--runs", "3", "--seed", "9", "--out", str(folder)]
    )
    assert done.exit_code == 0, done.output
    assert "3 runs of 8 s, seeds 9 to 11" in done.output
    return sorted(str(path) for path in folder.glob("*.csv"))


def test_runs_have_their_seeds(runs: list[str], tmp_path: Path) -> None:
    assert [Path(run).name for run in runs] == ["run_09.csv", "run_10.csv", "run_11.csv"]
    alone = tmp_path / "alone.csv"
    assert (
        CliRunner()
        .invoke(app, ["simulate", "series-2", "--seed", "10", "--out", str(alone)])
        .exit_code
        == 0
    )
    assert alone.read_text() == Path(runs[1]).read_text()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::distal.errors.DistalWarning")
def test_estimates_go_to_a_folder(runs: list[str], tmp_path: Path) -> None:
    out, one = tmp_path / "estimates", tmp_path / "one.csv"
    options = [*RIG, "--estimator", "inextensible", "--unit", "rad", "--all", "--out"]
    done = CliRunner().invoke(app, ["estimate", *runs, *options, str(out)])
    assert done.exit_code == 0, done.output
    assert "wrote 3 estimates" in done.output
    assert CliRunner().invoke(app, ["estimate", runs[2], *options, str(one)]).exit_code == 0
    assert pl.read_csv(out / "run_11.csv").equals(pl.read_csv(one))


@pytest.mark.filterwarnings("ignore::distal.errors.DistalWarning")
def test_a_bad_log_is_named_and_the_others_are_done(runs: list[str], tmp_path: Path) -> None:
    bad = tmp_path / "bad.csv"
    bad.write_text("t,x1\n0,1\n1,2\n")
    out = tmp_path / "estimates"
    done = CliRunner().invoke(
        app, ["estimate", runs[0], str(bad), runs[1], *RIG, "--out", str(out)]
    )
    assert done.exit_code == 2
    assert "bad.csv" in done.output
    assert sorted(path.name for path in out.iterdir()) == ["run_09.csv", "run_10.csv"]


@pytest.mark.filterwarnings("ignore::distal.errors.DistalWarning")
def test_the_table_of_many_has_each_ones_band_and_error(runs: list[str]) -> None:
    """Beside each log stand half the width of its band, its RMS error, and how much is inside, as
    of the log alone.
    """
    done = CliRunner().invoke(app, ["estimate", *runs[:2], *RIG, "--estimator", "inextensible"])
    assert done.exit_code == 0, done.output
    rig = load_rig("paper-2008-printed", ['joints.0.initial="-25 deg"'])
    for run in runs[:2]:
        result = estimate(run, rig, "inextensible")
        half = np.rad2deg(1.96 * np.median(result.angle_stds))
        expected = [
            f"±{half:.2f}",
            f"{np.rad2deg(result.rms_error()):.3f}",
            f"{100 * result.inside_band():.0f} %",
        ]
        (line,) = (
            line for line in done.output.splitlines() if Path(run).name in line and "±" in line
        )
        assert re.search(r"\s+".join(map(re.escape, expected)), line), (expected, line)
