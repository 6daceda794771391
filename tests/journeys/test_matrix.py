"""Every rig through every command, with a truth in the log: no fault, no traceback, finite bands.

A quick part runs with every test, all of it with `make test-all`. With DISTAL_DATA the real logs of
an instrument go through `distal estimate` too.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from distal import load_rig
from tests.journeys.matrix import (
    ESTIMATE,
    EXAMPLES,
    MADE,
    OTHERS,
    POSITIONS,
    Case,
    cases,
    described,
    write_logs,
)
from tests.support.positions_only import Positions, write

SEEDS = {1: 21, 2: 24, 3: 25}
"""Joints of a rig of positions only → its seed; the one of two joints has two motors for each."""

COMPILES = shutil.which("cc") is not None
QUICK = 5
"""Number of rows of each matrix that always run."""


def environment() -> dict[str, str]:
    """Return that of a user who has no setting of distal but a cache."""
    kept = {name: v for name, v in os.environ.items() if not name.startswith("DISTAL_")}
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return {**kept, "DISTAL_CACHE": os.environ["DISTAL_CACHE"], "PATH": path}


def ran(lines: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run lines of a shell; what ends them is an error that a user can mend, in one line."""
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", lines],
        cwd=folder,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=600,
    )
    said = done.stdout + done.stderr
    assert "Traceback" not in said, said
    assert "fault of distal" not in said, said
    assert done.returncode in (0, 2), said
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) <= 1 or done.returncode == 0, said
    assert errors or done.returncode == 0, said
    return done


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
        elif name == "learned":
            for path in (EXAMPLES / "finger_logs").glob("run_*.csv"):
                lines = path.read_text(encoding="utf-8").splitlines()[:801]
                (folder / path.name).write_text("\n".join(lines) + "\n", encoding="utf-8")
            ran("distal learn run_0.csv run_1.csv run_2.csv --out rig.toml", folder)
        elif name in POSITIONS:
            joints = int(name[-1])
            for k in range(3):
                write(
                    Positions.drawn(SEEDS[joints], joints).log(k, 12.0)[0], folder / f"run_{k}.csv"
                )
            ran("distal learn run_0.csv run_1.csv run_2.csv --out rig.toml", folder)
        elif name.endswith(".toml"):
            file = EXAMPLES / "da_vinci" / name
        if name in MADE:
            file = folder / "rig.toml"
        write_logs(load_rig(file) if name in MADE else described(name), folder)
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


POSES = ("da_vinci_grasper/run", "da_vinci_poses/pitch", "da_vinci_poses/roll")


@pytest.mark.parametrize("homing", ["3s", pytest.param("0.2s", marks=pytest.mark.more)])
@pytest.mark.parametrize(
    "log", [0, pytest.param(slice(1, None), id="the rest", marks=pytest.mark.more)]
)
@pytest.mark.parametrize(
    "pose", [POSES[0], *(pytest.param(pose, marks=pytest.mark.more) for pose in POSES[1:])]
)
def test_real_logs_with_the_truth_beside_them(
    pose: str, log: int | slice, homing: str, data: Path, tmp_path: Path
) -> None:
    """With the words on a log that follow its estimate, at which 33 of 56 once ended in a fault."""
    paths = sorted((data / pose).parent.glob(f"{Path(pose).name}_*.csv"))
    assert len(paths) > 1
    for path in [paths[log]] if isinstance(log, int) else paths[log]:
        done = ran(f"distal estimate {path} --rig da-vinci-grasper --homing {homing}", tmp_path)
        assert done.returncode == 0, done.stderr
        assert "error: " not in done.stderr
