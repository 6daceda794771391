"""Every rig through every command, with a truth in the log: no fault, no traceback, finite bands.

A quick part runs with every test, all of it with `make test-all`. With DISTAL_DATA the real logs of
an instrument go through `distal estimate` too.
"""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from distal import load_rig
from tests.journeys.matrix import (
    ESTIMATE,
    EXAMPLES,
    MADE,
    OTHERS,
    Case,
    cases,
    write_logs,
)
from tests.journeys.shell import environment, ran

COMPILES = shutil.which("cc") is not None
QUICK = 5
"""Number of rows of each matrix that always run."""


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Path, Path]]:
    """Rig → its file and the folder of its logs, made when they are asked for."""
    return Files(tmp_path_factory.mktemp("matrix"))


class Files(dict[str, tuple[Path, Path]]):
    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __missing__(self, name: str) -> tuple[Path | str, Path]:
        folder = self.folder / Path(name).stem
        folder.mkdir()
        file: Path | str = name
        if name == "fitted":
            write_logs(load_rig("capstan-joint"), folder)
            ran("distal fit log_0.csv --rig capstan-joint --out rig.toml", folder)
        elif name in MADE:
            for path in (EXAMPLES / "finger_logs").glob("run_*.csv"):
                frame = pl.read_csv(path).head(800)
                frame = frame if name == "learned" else frame.drop("current [mA]")
                frame.write_csv(folder / path.name)
            ran("distal learn run_0.csv run_1.csv run_2.csv --out rig.toml", folder)
        elif name.endswith(".toml"):
            file = EXAMPLES / "da_vinci" / name
        if name in MADE:
            file = folder / "rig.toml"
        write_logs(load_rig(file), folder)
        self[name] = file, folder
        return self[name]


def bands(path: Path) -> np.ndarray:
    """Return the columns of a file that are standard deviations of angles; those of a torque are
    zero where no touch is looked for.
    """
    header = path.read_text(encoding="utf-8").splitlines()[0].split(",")
    at = [i for i, name in enumerate(header) if re.match(r"(?!external).*_std( \[|$)", name)]
    return np.genfromtxt(path, delimiter=",", skip_header=1, usecols=at, ndmin=2)


def rows() -> list[object]:
    found = list[object]()
    for factors in (ESTIMATE, OTHERS):
        quick = 0
        for case in cases(factors):
            is_quick = quick < QUICK and case.rig not in MADE[1:] and case.command != "fit"
            quick += is_quick
            marks = [pytest.mark.slow] if is_quick else [pytest.mark.slow, pytest.mark.more]
            found.append(pytest.param(case, marks=marks, id=str(case)))
    return found


@pytest.mark.parametrize("case", rows())
def test_a_row(case: Case, files: Files, tmp_path: Path) -> None:
    if case.command == "export-c" and not COMPILES:
        pytest.skip("no C compiler")
    rig, folder = files[case.rig]
    log = folder / f"log_{list(ESTIMATE['truth']).index(case.truth)}.csv"
    for path in (log, log.with_suffix(".truth.csv")):
        shutil.copy(path, tmp_path)
    done = ran(case.words(rig, log), tmp_path)
    out = tmp_path / "out.csv"
    if done.returncode == 0 and out.exists():
        stds = bands(out)
        assert stds.shape[1] > 0
        assert np.isfinite(stds).all()
        assert (stds > 0.0).all()


@pytest.mark.slow
def test_ctrl_c_ends_with_130(tmp_path: Path) -> None:
    with subprocess.Popen(
        ["distal", "simulate", "series-1", "--runs", "100000", "--out", "out"],
        cwd=tmp_path,
        env=environment(),
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        time.sleep(2.0)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in said


@pytest.mark.parametrize("homing", ["3s", pytest.param("0.2s", marks=pytest.mark.more)])
@pytest.mark.parametrize(
    "pose",
    [
        "da_vinci_grasper/run",
        pytest.param("da_vinci_poses/pitch", marks=pytest.mark.more),
        pytest.param("da_vinci_poses/roll", marks=pytest.mark.more),
    ],
)
def test_real_logs_with_the_truth_beside_them(
    pose: str, homing: str, data: Path, tmp_path: Path
) -> None:
    """With the words on a log that follow its estimate, at which 33 of 56 once ended in a fault."""
    paths = sorted((data / pose).parent.glob(f"{Path(pose).name}_*.csv"))
    assert len(paths) > 1
    for path in paths:
        done = ran(f"distal estimate {path} --rig da-vinci-grasper --homing {homing}", tmp_path)
        assert done.returncode == 0, done.stderr
        assert "error: " not in done.stderr
