"""A whole way of the docs as commands in a shell, in an empty folder, with the installed wheel.

The plant lacks nothing that a user's rig has: a sheath, a spring, other arms. `make journeys` takes
more seeds (DISTAL_JOURNEYS).
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import tomlkit

from distal import write_log
from distal.fitting.fit import plain_value
from tests.journeys.matrix import REPLAY
from tests.journeys.shell import installed, ran
from tests.support.foreign_plants import finger_log, finger_rig

SEEDS = range(int(os.environ.get("DISTAL_JOURNEYS", "1")))
TO_C = f"""
{sys.executable} {REPLAY} fitted.toml joint > firmware/replay.c
cd firmware
cc -std=c99 -O2 -fno-math-errno replay.c joint.c -lm -o replay
./replay ../run_3.csv > ../replayed.csv
"""


@pytest.fixture(scope="module")
def commands(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return installed(tmp_path_factory.mktemp("wheel"))


@pytest.mark.slow
@pytest.mark.more  # fits of the command line: tests/test_tutorial.py, tests/cli/test_fit.py
@pytest.mark.parametrize("seed", SEEDS)
def test_a_researcher_with_logs_of_a_rig(seed: int, commands: Path, tmp_path: Path) -> None:
    """A finger with a Bowden cable, whose friction along the cable its file is silent about: fit,
    estimate, command, stream, export and run the C.
    """

    def said(lines: str) -> str:
        done = ran(lines, tmp_path, commands)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def rms(rig: str) -> float:
        """Return the error that is printed [°]."""
        lines = said(
            f"distal rig check {rig}\n"
            f"distal estimate run_3.csv --rig {rig} -e adaptive --no-what-if "
            "--out estimate.csv --unit rad"
        ).splitlines()
        return float(next(row for row in map(str.split, lines) if row[:1] == ["adaptive"])[1])

    def angles(name: str) -> np.ndarray:
        frame = pl.read_csv(tmp_path / f"{name}.csv")
        return frame[next(head for head in frame.columns if head.startswith("theta"))].to_numpy()

    rig = finger_rig()
    text = tomlkit.dumps(plain_value(rig.model_dump(exclude_defaults=True)))
    (tmp_path / "mine.toml").write_text("# my finger\n" + text, encoding="utf-8")
    for i in range(4):
        write_log(finger_log(10 * seed + i, 8.0), rig, tmp_path / f"run_{i}.csv")
    before = rms("mine.toml")
    fit = "distal fit run_0.csv run_1.csv run_2.csv --rig mine.toml --out fitted.toml"
    assert "wrote fitted.toml" in said(fit)
    assert "# my finger" in (tmp_path / "fitted.toml").read_text(encoding="utf-8")
    assert rms("fitted.toml") < 0.5 * before
    time = np.arange(0.0, 4.0, 0.01)
    desired = 40.0 - 20.0 * np.cos(np.pi * time / 2.0)
    pl.DataFrame({"t [s]": time, "theta [deg]": desired}).write_csv(tmp_path / "desired.csv")
    said(
        """
        distal command desired.csv --rig fitted.toml --out commands.csv
        distal stream --rig fitted.toml --unit rad < run_3.csv > stream.csv
        distal export-c fitted.toml --out firmware --name joint
        """
    )
    np.testing.assert_allclose(angles("stream"), angles("estimate"), atol=1e-9)
    assert np.isfinite(angles("commands")).all()
    if shutil.which("cc") is not None:
        said(TO_C)
        np.testing.assert_allclose(angles("replayed"), angles("estimate"), atol=1e-7)
