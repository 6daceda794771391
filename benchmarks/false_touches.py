"""Touches that are reported where there are none: hours of free motion, fast steps included.

`python -m benchmarks.false_touches [--minutes 60] [--first-seed 9000] [--only finger-2n]` fits each
rig by the command to logs of one seed, and streams logs of others, whose motions no fit has seen.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.chain_logs import make_log
from benchmarks.report import table
from benchmarks.strangers.coupled_finger import finger_log, postures
from benchmarks.touch import CASES, DURATION, fitted, onsets
from distal import read_log
from distal.logs import write_columns

Columns = dict[str, NDArray[np.float64]]


def of_chain(plant: str) -> Callable[[int, int], Columns]:
    """Return what draws columns of a chain in another simulator: an instrument, a motion."""

    def columns(instrument: int, seed: int) -> Columns:
        return make_log(plant, ("servo", "step")[seed % 2], seed, instrument=instrument)[0]

    return columns


def of_coupled_finger(instrument: int, seed: int) -> Columns:
    """Return columns of the finger of two servos, every second time in steps of 0.1 s."""
    del instrument  # there is one
    goals = postures(seed, DURATION, *((1.25, 0.1), (1.3, 0.9))[seed % 2])
    return finger_log(goals, DURATION, seed)[0]


PLANTS: dict[str, Callable[[int, int], Columns]] = {
    "finger, two servos": of_coupled_finger,
    "finger-2n": of_chain("finger2N"),
    "finger-n-plus-1": of_chain("finger_n1"),
    "wrist-instrument": of_chain("wrist_instrument"),
}


def counted(name: str, seed: int, minutes: float) -> list[str]:
    """Return the row of one rig."""
    with tempfile.TemporaryDirectory() as position:
        folder, begun, seconds, k = Path(position), 0, 0.0, 0
        rig = fitted(CASES[name](seed, folder), folder)
        while seconds < 60 * minutes:
            k += 1
            path = folder / "calm.csv"
            write_columns(PLANTS[name](seed, seed + 100 + k), path)
            log = read_log(path, rig)
            begun += onsets(rig, log)
            seconds += float(np.ptp(log.time))
    return [name, f"{begun} in {seconds / 60:.0f} min", f"{600 * begun / seconds:.2f}"]


def main() -> None:
    """Run, print and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--first-seed", type=int, default=9000)
    parser.add_argument("--only", choices=list(PLANTS), action="append")
    arguments = parser.parse_args()
    rows = [
        counted(name, arguments.first_seed, arguments.minutes) for name in arguments.only or PLANTS
    ]
    table("false-touches", "Free motion", ("rig", "touches", "in 10 min"), rows)


if __name__ == "__main__":
    main()
