"""A soft neck of a spring that three motors bend (github.com/HUMASoft/Data-and-Results, commit
704ab9a, LGPL 2.1; Mena et al. 2020, doi 10.3389/frobt.2020.00027).

Encoders read the motors, an inertial sensor at the tip reads inclination and orientation, both at
100 Hz. The angles are the two tilts θ cos ψ and θ sin ψ of inclination θ and orientation ψ, since ψ
has no meaning near θ = 0. Nothing measures a force. The logs differ by the load at the tip.
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

COMMIT = "704ab9ab60a3430e1bede53c683f7507be2dc1e8"
ENDING = "imu_openloop/spring_test_{load}gr.csv"


def _file(repository: Path, load: int) -> pd.DataFrame:
    """Return the log with a load [g], from a repository that may lack a work tree."""
    git = ["git", "-C", str(repository)]
    names = subprocess.run(
        [*git, "ls-tree", "-r", "-z", "--name-only", COMMIT],
        capture_output=True,
        check=True,
        text=True,
    ).stdout.split("\0")
    name = next(name for name in names if name.endswith(ENDING.format(load=load)))
    done = subprocess.run([*git, "show", f"{COMMIT}:{name}"], capture_output=True, check=True)
    return pd.read_csv(BytesIO(done.stdout), index_col=False)


def _columns(table: pd.DataFrame) -> dict[str, np.ndarray]:
    columns = {"time [s]": table["time"].to_numpy()}
    for i in (1, 2, 3):
        columns[f"encoder{i} [deg]"] = table[f"encoder{i}"].to_numpy()
    tilt = table["inclination_sensor"].to_numpy()
    turned = np.radians(table["orientation_sensor"].to_numpy())
    columns["tilt_x [deg]"] = tilt * np.cos(turned)
    columns["tilt_y [deg]"] = tilt * np.sin(turned)
    return columns


def splits(repository: Path, folder: Path) -> Iterator[Split]:
    """Yield the fixed split: halves of the logs with 0 and 1000 g, judged with 500 g."""
    training = []
    for load in (0, 1000):
        columns = _columns(_file(repository, load))
        half = len(columns["time [s]"]) // 2
        for k in (0, 1):
            rows = slice(k * half, (k + 1) * half)
            training.append(folder / f"neck_{load}_{k}.csv")
            write_columns({n: values[rows] for n, values in columns.items()}, training[-1])
    judged = folder / "neck_500.csv"
    write_columns(_columns(_file(repository, 500)), judged)
    yield Split("soft neck, another load", tuple(training), (judged,))
