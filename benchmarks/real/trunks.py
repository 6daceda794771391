"""Two soft trunks, each with six tendons (github.com/StanfordASL/trunk-stack, commit 8b4b923, MIT).

Three rigid bodies along the trunk are seen by motion capture at 100 Hz. The angles are the tilts of
the two segments between them, about both horizontal axes. Nothing measures a force.

* *servos*: the positions of six servos are read, in degrees;
* *DC motors*: only the commands of six motors are in the logs, without a unit.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.real.split import Split
from distal.logs import write_columns

COMMIT = "8b4b9234b287a0403d1844821bfad79e36e1f66f"
FOLDER = "stack/main/data/trajectories/dynamic"

RATE = 100.0
"""Samples a second, as the repository's scripts have it [Hz]."""

ROWS = 4000
"""Rows of a training log: 40 s."""

JUDGED_ROWS = 6000
"""Rows of a log to judge by: a minute."""

SEGMENTS = {"upper": (1, 2), "lower": (2, 3)}
"""Segment of a trunk → the bodies at its ends."""


def _table(repository: Path, name: str) -> pd.DataFrame:
    """Return a file of the repository, which may be a clone without a work tree."""
    done = subprocess.run(
        ["git", "-C", str(repository), "show", f"{COMMIT}:{FOLDER}/{name}"],
        capture_output=True,
        check=True,
    )
    return pd.read_csv(BytesIO(done.stdout))


def _columns(bodies: pd.DataFrame, motors: pd.DataFrame) -> dict[str, np.ndarray]:
    columns = {"t [s]": (bodies["ID"] - bodies["ID"].iloc[0]).to_numpy() / RATE}
    columns |= {name: values.to_numpy() for name, values in motors.items()}
    for segment, (a, b) in SEGMENTS.items():
        down = bodies[f"y{a}"] - bodies[f"y{b}"]
        for axis in "xz":
            aside = bodies[f"{axis}{b}"] - bodies[f"{axis}{a}"]
            tilt = np.degrees(np.arctan2(aside, down)).to_numpy()
            columns[f"{segment}_{axis} tilt [deg]"] = tilt
    return columns


def _written(columns: dict[str, np.ndarray], rows: slice, path: Path) -> Path:
    write_columns({name: values[rows] for name, values in columns.items()}, path)
    return path


def _servos(repository: Path, name: str) -> dict[str, np.ndarray]:
    table = _table(repository, f"servo_motor_archive/observations_{name}.csv")
    motors = {f"motor{i} [deg]": table[f"phi{i}"] for i in range(1, 7)}
    return _columns(table, pd.DataFrame(motors))


def _dc_motors(repository: Path, name: str) -> dict[str, np.ndarray]:
    bodies = _table(repository, f"dc_motor_archive/observations_{name}.csv")
    commands = _table(repository, f"dc_motor_archive/control_inputs_{name}.csv")
    both = bodies.merge(commands, on="ID")
    motors = {f"motor{i} [rad]": both[f"u{i}"] for i in range(1, 7)}
    return _columns(both, pd.DataFrame(motors))


def splits(repository: Path, folder: Path) -> Iterator[Split]:
    """Yield the fixed splits: three logs of 40 s to learn from, whole other files to judge by."""
    for title, of, training, judged in (
        ("trunk, servos", _servos, "controlled_1", ("controlled_2", "controlled_11")),
        ("trunk, servos, 300 g at its tip", _servos, "controlled_1", ("controlled_1_300g",)),
        ("trunk, commands of DC motors", _dc_motors, "controlled_3", ("controlled_4",)),
    ):
        columns = of(repository, training)
        stem = title.replace(", ", "_").replace(" ", "-")
        logs = [
            _written(columns, slice(k * ROWS, (k + 1) * ROWS), folder / f"{stem}_run_{k}.csv")
            for k in range(3)
        ]
        others = [
            _written(of(repository, name), slice(JUDGED_ROWS), folder / f"{stem}_{name}.csv")
            for name in judged
        ]
        yield Split(title, tuple(logs), tuple(others))
