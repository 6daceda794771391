"""Several logs on the command line: a folder of estimates, a line each, bad ones named."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from distal import estimate, load_rig
from distal.cli.app import app
from tests.cli.test_cli import run  # noqa: F401

RIG = """--rig paper-2008-printed --set 'joints.0.initial="-25 deg"'"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("runs")
    done = CliRunner().invoke(app, f"simulate series-2 --runs 3 --seed 9 --out {folder}")
    assert done.exit_code == 0, done.output
    assert "3 runs of 8 s, seeds 9 to 11" in done.output
    return sorted(folder.glob("*.csv"))


def test_runs_have_their_seeds(run, runs: list[Path], tmp_path: Path) -> None:
    assert [path.name for path in runs] == ["run_09.csv", "run_10.csv", "run_11.csv"]
    run(f"simulate series-2 --seed 10 --out {tmp_path / 'alone.csv'}")
    assert (tmp_path / "alone.csv").read_text() == runs[1].read_text()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::distal.errors.DistalWarning")
def test_estimates_go_to_a_folder_and_a_bad_log_is_named(
    run, runs: list[Path], tmp_path: Path
) -> None:
    bad, out, one = (tmp_path / name for name in ("bad.csv", "estimates", "one.csv"))
    bad.write_text("t,x1\n0,1\n1,2\n")
    options = f"{RIG} --estimator inextensible --unit rad --all --out"
    done = run(f"estimate {runs[0]} {bad} {runs[2]} {options} {out}")
    assert done.code == 2
    assert "bad.csv" in done.err
    assert "wrote 2 estimates" in done.out
    assert sorted(path.name for path in out.iterdir()) == ["run_09.csv", "run_11.csv"]
    assert run(f"estimate {runs[2]} {options} {one}").code == 0
    assert (out / "run_11.csv").read_text() == one.read_text()


@pytest.mark.filterwarnings("ignore::distal.errors.DistalWarning")
def test_the_table_of_many_has_each_ones_band_and_error(run, runs: list[Path]) -> None:
    """Beside each log stand half the width of its band, its RMS error, and how much is inside, as
    of the log alone.
    """
    done = run(f"estimate {runs[0]} {runs[1]} {RIG} --estimator inextensible")
    assert done.code == 0, done.err
    rig = load_rig("paper-2008-printed", ['joints.0.initial="-25 deg"'])
    for path in runs[:2]:
        result = estimate(path, rig, "inextensible")
        half, rms = np.rad2deg([1.96 * np.median(result.angle_stds), result.rms_error()])
        row = rf"{path.name} .*±{half:.2f} +{rms:.3f} +{100 * result.inside_band():.0f} %"
        assert re.search(row, done.out), row
