"""What positions predict of forces: how long to average, and how much one sample may count.

`python -m benchmarks.redundancy FOLDER …` learns `LearnedMaps.efforts` of each folder's `*.toml`
from its logs `calibration_*.csv`, with each pair of time constants and each largest T², and judges
the logs `free_*.csv` (no word is right), `touched_*.csv`, and the first free log spoiled as in
`benchmarks.wrong_inputs`. Printed is the share of samples in which a force is not as in free
motion. Without a folder it takes a finger with a Bowden cable.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections import defaultdict
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
from tests.support.foreign_plants import finger_log, finger_rig

from benchmarks.report import table
from benchmarks.shell import write_rig
from benchmarks.wrong_inputs import KINDS, sensors_of
from distal import Log, Rig, load_rig, read_log, write_log
from distal.fitting.learned_maps import efforts_of
from distal.regression import features
from distal.run import redundancy

TIMES = ((1.0, 1.0), (3.0, 3.0), (1.0, 30.0), (3.0, 30.0))
LARGEST = (25.0, 1e6)
SPOILED = ("stuck", "offset", "scaled", "sign", "swap", "unit", "late")


def logs_of(folder: Path, rig: Rig) -> dict[str, list[Log]]:
    """Return the kind of log → the logs to be judged."""
    found = {
        kind: [read_log(path, rig) for path in sorted(folder.glob(f"{kind}_*.csv"))]
        for kind in ("free", "touched")
    }
    first = sorted(folder.glob("free_*.csv"))[0]
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "spoiled.csv"
        for kind in SPOILED:
            given = pd.read_csv(first)
            columns = dict.fromkeys(sensors_of(rig, given), float)
            changed = KINDS[kind](given.astype(columns), rig, np.random.default_rng(7))
            changed.to_csv(file, index=False)
            found[kind] = [read_log(file, rig)]
    return found


def shares(folder: Path, times: tuple[float, float], largest: float) -> dict[str, list[float]]:
    """Return the kind of log → the largest share of any forces in each [%]."""
    rig = load_rig(next(folder.glob("*.toml"))).bare()
    learned_from = [read_log(path, rig) for path in sorted(folder.glob("calibration_*.csv"))]
    with (
        patch.object(redundancy, "AVERAGED", times),
        patch.object(features, "MOST", largest),
    ):
        maps = efforts_of(learned_from, rig, range(len(learned_from)))
        learned = rig.with_map(efforts=maps)
        return {
            kind: [
                100 * max(redundancy.unlike_free_motion(log, learned).values(), default=0.0)
                for log in logs
            ]
            for kind, logs in logs_of(folder, rig).items()
        }


def drawn(folder: Path) -> Path:
    """Write the logs of a finger, whose plant shares no code with the model."""
    rig = finger_rig()
    write_rig(rig, folder / "finger.toml")
    for seed in range(5):
        name = f"calibration_{seed}.csv" if seed < 4 else "free_4.csv"
        write_log(finger_log(seed, 20.0), rig, folder / name)
    return folder


def main() -> None:
    """Print a row for each choice."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path)
    asked = parser.parse_args().folders
    rows = []
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as name:
        folders = asked or [drawn(Path(name))]
        warnings.simplefilter("ignore")
        for times in TIMES:
            for largest in LARGEST:
                of_kind = defaultdict(list)
                for folder in folders:
                    for kind, found in shares(folder, times, largest).items():
                        of_kind[kind] += found
                means = (f"{np.mean(found or [np.nan]):.0f}" for found in of_kind.values())
                free = f"{np.max(of_kind['free'], initial=0.0):.0f}"
                rows.append((f"{times[0]:g} and {times[1]:g} s, {largest:g}", free, *means))
    columns = (
        "means over, most",
        "free, worst [%]",
        "free [%]",
        "touched [%]",
        *(f"{kind} [%]" for kind in SPOILED),
    )
    table("redundancy", "Forces that are not as in free motion", columns, rows)


if __name__ == "__main__":
    main()
