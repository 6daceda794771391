"""Right readings that are left out where a log is read: `python -m benchmarks.door [--seeds 20]
[--rigs 300]` writes logs of all shipped scenarios, of rigs that are drawn (`tests.support`), and
reads them back; with DISTAL_DATA the real logs there too. A reading is left out that was written
and is missing. Errors of sensors are as the rigs say, so that each of them is right.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
from tests.support.drawn_logs import logs_of
from tests.support.drawn_rigs import drawn_rig

from benchmarks.report import table
from distal import Log, Rig, load_rig, load_scenario, read_log, scenario_rig, simulate, write_log
from distal.errors import DistalWarning
from distal.logs import read_table
from distal.rig import build_rig
from distal.simulation import shipped_scenarios

REAL = {
    "da_vinci_grasper/run_*.csv": "da-vinci-grasper",
    "da_vinci_poses/*.csv": "da-vinci-grasper",
    "finger/finger2N_*.csv": "finger-2n",
    "finger/wrist_instrument_*.csv": "wrist-instrument",
}
"""Logs below DISTAL_DATA → the shipped rig that reads them."""


def counted(written: dict[str, np.ndarray], log: Log, rig: Rig) -> tuple[int, int]:
    """Return the numbers of readings that were written, and of those that are missing."""
    present = missing = 0
    for name, values in log.channels.items():
        column = next(sensor.log_column for sensor in rig.sensors if sensor.name == name)
        there = np.isfinite(written[column])
        present += int(there.sum())
        missing += int((there & ~np.isfinite(values)).sum())
    return present, missing


def through_file(log: Log, rig: Rig, path: Path) -> tuple[int, int]:
    """Return the counts of a log that goes through a file."""
    write_log(log, rig, path)
    return of_file(path, rig)


def of_file(path: Path, rig: Rig) -> tuple[int, int]:
    """Return the counts of a file."""
    cells = read_table(path)
    written = {name.partition(" [")[0]: cells.values(name) for name in cells.names}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DistalWarning)
        return counted(written, read_log(path, rig), rig)


def main() -> None:
    """Print a row for each source of logs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--rigs", type=int, default=300)
    parser.add_argument("--first-seed", type=int, default=8800)
    arguments = parser.parse_args()
    counts: dict[str, Counter[str]] = {}

    def add(name: str, of_log: tuple[int, int]) -> None:
        row = counts.setdefault(name, Counter())
        row["logs"] += 1
        row["readings"] += of_log[0]
        row["left out"] += of_log[1]

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        for name in shipped_scenarios():
            scenario = load_scenario(name)
            rig = scenario_rig(scenario)
            for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
                add("shipped scenarios", through_file(simulate(rig, scenario, seed), rig, path))
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.rigs):
            drawn = drawn_rig(seed, False)
            rig = build_rig(drawn.raw, "drawn")
            for log in logs_of(drawn, seed)[0][:2]:
                add("drawn rigs", through_file(log, rig, path))
    folder_of_data = os.environ.get("DISTAL_DATA")
    for pattern, name in REAL.items() if folder_of_data else ():
        for real in sorted(Path(str(folder_of_data)).glob(pattern)):
            if not real.name.endswith(".truth.csv"):
                add("real and given logs", of_file(real, load_rig(name)))
    rows = [
        (name, *(str(row[k]) for k in ("logs", "readings", "left out")))
        for name, row in counts.items()
    ]
    table("door", "right readings left out", ["logs of", "logs", "readings", "left out"], rows)


if __name__ == "__main__":
    main()
