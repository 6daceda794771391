"""Public logs of a da Vinci grasper, which are fetched once and compared with known fingerprints:
`python examples/da_vinci/logs.py` prints their paths.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from urllib.request import urlopen

import numpy as np
from numpy.typing import NDArray

from distal.errors import LogError
from distal.kernels import cache_folder
from distal.logs import write_whole

SOURCE = (
    "https://raw.githubusercontent.com/MRDLab/mis-tool-characterization/"
    "03658b2ccefef9adceebc38dd4a17bd6e190cd2e/data/Tool_4_Maryland_L_2/{run}.TXT"
)
"""Address of the file of a run: Medical Robotics and Devices Lab Data Repository, Open Database
License 1.0.
"""

LICENCE = """Logs of a da Vinci Maryland grasper from the Medical Robotics and Devices Lab Data
Repository (MRDLab/mis-tool-characterization, commit 03658b2, folder
data/Tool_4_Maryland_L_2), made available under the Open Database License 1.0
(opendatacommons.org/licenses/odbl/1-0); contents under the Database Contents License 1.0.
Altered: counts turned into units, every fifth row kept (1 kHz to 200 Hz), columns named.
"""

FINGERPRINTS = {
    "00": "1f6bcb7e187a16dc715688b045637a5769be630541517e94fb2c66bea4c13f60",
    "01": "94e9785413e2658f965386543604b630ad92e5bcc5df65149ce4d2170ebfbc68",
    "02": "70a5764e59b921507249509b00a8ed39a0689980c49209cdac0281b440a47993",
    "03": "60cf4e1417c83f568fc71c34ba48a031652e5afbbd342c75421eefd8adf6a525",
    "20": "56933bb4dac8261b579a51dd1cdedea09bcaed9394a2c3c6efa90284c1a04b69",
    "21": "2858aee86807c57579752bff0c38bbfb1c7df78558299451037cb00b703017e3",
    "22": "3100710dc5c1577c32a73ce6e9f531146f8640963d4052791e5e45f5142db350",
    "23": "41a27d8a98b71da27251c1bde333e4efc5a2b7c4db389f44e9b7b21f8ea595cc",
    "40": "a4537d05f55fdff074eeecf4ddf1b8510a45777f8c40b57fe1cffc24f9d9b5a3",
    "41": "3b500b2d1d383a2402ba80ff80b19efc1f206900c271a7d78c9966affdd57ca3",
    "42": "11134bb6e82b80f240a27332a56e3e8702f65f89f43b017d39b0caea4bf83c4f",
    "43": "06691aec2acfe5e2f1d74aee60f7de80770d256bfd9427adbe1fc449a8f053a3",
}
"""Run → SHA-256 of the part of its file that is used: stamps [ms] and counts of every fifth row."""


TORQUE = 0.04872866 / 1224
"""Torque per count of both torque sensors [N m]. Source: judgement."""

FACTORS = (1e-3, 360.0 / 8192.0, TORQUE, 1e-3, 0.09, TORQUE)
"""Units per count of each used column: time [s], angle [°], torque [N m], motor current [A], jaw
angle [°], jaw torque [N m]. Source: definition (formats of the raw files).
"""

COLUMNS = ("t_s", "theta_prox_deg", "tau_prox_Nm", "i_motor_A", "theta_true_deg", "tau_true_Nm")
RAW = (0, 1, 2, 3, 4, 5)
"""Positions of the used columns in the raw files: time, proximal encoder and torque, motor current,
jaw encoder and torque. Source: definition (formats of the raw files).
"""


def da_vinci_grasper(folder: str | Path | None = None) -> tuple[Path, ...]:
    """Return the paths of 12 logs (CSV) of a da Vinci grasper, and fetch those that are not there
    yet.

    Run XY has motion frequency class X and resistive torque class Y; each run takes 20 s. The
    columns are those that the shipped rig ``da-vinci-grasper`` names.

    Args:
        folder: where the logs are kept. By default it is ``da_vinci_grasper`` in the folder that
            $DISTAL_DATA names, from which nothing is fetched, else in the user's cache.

    Raises:
        LogError: the logs cannot be fetched, or a fetched file differs from its fingerprint.
    """
    shared = os.environ.get("DISTAL_DATA") if folder is None else None
    folder = Path(folder or Path(shared or cache_folder()) / "da_vinci_grasper")
    paths = tuple(folder / f"run_{run}.csv" for run in FINGERPRINTS)
    missing = [path for path in paths if not path.is_file()]
    if shared:
        if missing:
            raise LogError(
                f"{missing[0]}: is not there; DISTAL_DATA must be the folder that holds "
                "da_vinci_grasper"
            )
        return paths
    folder.mkdir(parents=True, exist_ok=True)
    for run, path in zip(FINGERPRINTS, paths):
        if path in missing:
            counts = counts_of(_fetched(run))
            check_fingerprint(run, counts)
            write_whole(path, csv_of(counts))
    write_whole(folder / "LICENCE.txt", LICENCE)
    return paths


def _fetched(run: str) -> str:
    """Return the text of a raw file."""
    url = SOURCE.format(run=run)
    try:
        with urlopen(url, timeout=10.0) as answer:
            text: str = answer.read().decode(errors="replace")
    except OSError as problem:
        raise LogError(f"{url}: cannot be fetched ({problem}); are you online?") from None
    return text


def counts_of(text: str) -> NDArray[np.int64]:
    """Return stamps [ms] and counts of every fifth row of a raw file's text, (n, 6).

    Lines that begin with % are comments.
    """
    lines = [line for line in text.splitlines() if line and not line.startswith("%")]
    try:
        rows = np.array([[float(cell) for cell in line.split(",")[:6]] for line in lines[::5]])
        scaled = rows[:, RAW] * np.array([1e3, 1.0, 1.0, 1e3, 1.0, 1.0])
    except (ValueError, IndexError):
        raise LogError(
            "the fetched file is not a table of numbers; the source has changed"
        ) from None
    counts: NDArray[np.int64] = np.round(scaled).astype(np.int64)
    return counts


def fingerprint(counts: NDArray[np.int64]) -> str:
    """Return the SHA-256 of a run's counts, (n, 6)."""
    return hashlib.sha256(np.ascontiguousarray(counts, dtype="<i8").tobytes()).hexdigest()


def check_fingerprint(run: str, counts: NDArray[np.int64]) -> None:
    """Raise a `LogError` where the counts of a run, (n, 6), differ from the known fingerprint."""
    digest = fingerprint(counts)
    if digest != FINGERPRINTS[run]:
        raise LogError(
            f"run {run}: the fetched file is not the one that is known (its counts have SHA-256 "
            f"{digest[:16]}…, not "
            f"{FINGERPRINTS[run][:16]}…); nothing was kept"
        )


def csv_of(counts: NDArray[np.int64]) -> str:
    """Return a run's counts, (n, 6), as a CSV text in the units that the columns name."""
    rows = [
        ",".join(f"{cell:.8f}".rstrip("0").rstrip(".") for cell in row)
        for row in counts * np.array(FACTORS)
    ]
    return "\n".join([",".join(COLUMNS), *rows]) + "\n"


if __name__ == "__main__":
    print(*da_vinci_grasper())
