"""Rigs of which only positions are measured: `python -m benchmarks.positions_only [--rigs 30]
[--first-seed 9400]` draws rigs of one to three joints with one or two motors each
(`benchmarks.drawn_positions`), learns each by `distal learn` from four logs of 15 s, and
estimates two others by `distal estimate`. The error is beside that of the better of two ways by
hand, each with its best half-width of play: an affine map, and one with plays of the motors. Errors
count after the first second.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.drawn_positions import Positions, write
from benchmarks.report import table
from benchmarks.shell import command

Floats = NDArray[np.float64]

LEARNED, JUDGED = 4, 2
HALVES = np.deg2rad([0.25, 0.5, 1.0, 1.5, 2.0])
"""Half-widths of play that are tried by hand [rad]."""


def late(time: Floats, errors: Floats) -> Floats:
    """Return the errors after the first second, (k, n)."""
    return errors[time >= time[0] + 1.0]


def played(values: Floats, half: float) -> Floats:
    """Return readings, (k, n), behind a play of a half-width."""
    after = values.copy()
    for k in range(1, len(values)):
        after[k] = np.clip(after[k - 1], values[k] - half, values[k] + half)
    return after


def by_hand(logs: list[dict[str, Floats]], judged: list[tuple[dict[str, Floats], Floats]]) -> float:
    """Return the RMS error of the better way by hand [rad], with half-widths by the logs."""

    def columns(log: dict[str, Floats], half: float) -> Floats:
        motors = np.column_stack([np.deg2rad(c) for n, c in log.items() if n.startswith("motor")])
        plays = [played(motors, half)] if half else []
        return np.column_stack([np.ones(len(motors)), motors, *plays])

    def angles(log: dict[str, Floats]) -> Floats:
        return np.column_stack([np.deg2rad(c) for n, c in log.items() if n.startswith("joint")])

    ways = []
    for half in (0.0, *HALVES):
        phi = np.vstack([columns(log, half) for log in logs])
        known = np.vstack([angles(log) for log in logs])
        weights, *_ = np.linalg.lstsq(phi, known, rcond=None)
        ways.append((float(np.sum((phi @ weights - known) ** 2)), half, weights))
    _, half, weights = min(ways, key=lambda way: way[0])
    off = [late(log["t [s]"], columns(log, half) @ weights - exact) for log, exact in judged]
    return float(np.sqrt(np.mean(np.vstack(off) ** 2)))


def outcome(seed: int) -> tuple[int, float, float, float, float]:
    """Return joints, RMS error of distal and by hand [deg], coverage, and seconds of a rig."""
    rig = Positions.drawn(seed)
    made = [rig.log(100 * seed + k, 15.0) for k in range(LEARNED + JUDGED)]
    hand = by_hand([log for log, _ in made[:LEARNED]], made[LEARNED:])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for k, (log, _) in enumerate(made):
            write(log, folder / f"log_{k}.csv", ("joint",) if k >= LEARNED else ())
        begun = time.process_time(), time.perf_counter()
        words = [f"log_{k}.csv" for k in range(LEARNED)]
        done = command(folder, "learn", *words, "--out", "rig.toml")
        seconds = time.perf_counter() - begun[1]
        if done.returncode:
            raise RuntimeError(f"{seed}: {done.stderr.strip().splitlines()[-1]}")
        squares, inside = [], []
        for k in range(LEARNED, LEARNED + JUDGED):
            words = ["estimate", f"log_{k}.csv", "--rig", "rig.toml", "--out", "e.csv"]
            done = command(folder, *words, "--unit", "rad", "--no-what-if")
            if done.returncode:
                raise RuntimeError(f"{seed}: {done.stderr.strip().splitlines()[-1]}")
            header, *_ = (folder / "e.csv").read_text().splitlines()
            values = np.genfromtxt(folder / "e.csv", delimiter=",", skip_header=1)
            names = [each.partition(" ")[0] for each in header.split(",")]
            at = [i for i, n in enumerate(names) if n.startswith("theta") and "_std" not in n]
            of = [i for i, n in enumerate(names) if n.startswith("theta") and "_std" in n]
            error = values[:, at] - made[k][1]
            squares.append(np.mean(late(values[:, 0], error) ** 2))
            inside.append(np.mean(np.abs(error) <= 1.96 * values[:, of]))
    distal = float(np.rad2deg(np.sqrt(np.mean(squares))))
    return len(rig.plays), distal, float(np.rad2deg(hand)), float(np.mean(inside)), seconds


def main() -> None:
    """Print a row for each number of joints."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=30)
    parser.add_argument("--first-seed", type=int, default=9400)
    arguments = parser.parse_args()
    found = []
    for seed in range(arguments.first_seed, arguments.first_seed + arguments.rigs):
        found.append(outcome(seed))
        print(seed, *(f"{part:.3g}" for part in found[-1]), flush=True)
    rows = []
    for joints in sorted({each[0] for each in found}):
        part = np.array([each for each in found if each[0] == joints])
        ratios = part[:, 1] / part[:, 2]
        rows.append(
            (
                str(joints),
                str(len(part)),
                f"{np.median(part[:, 1]):.2f}",
                f"{np.median(part[:, 2]):.2f}",
                f"{np.exp(np.mean(np.log(ratios))):.2f}; {np.max(ratios):.2f}",
                f"{100 * np.mean(part[:, 3]):.0f}; {100 * np.min(part[:, 3]):.0f}",
                f"{np.median(part[:, 4]):.0f}",
            )
        )
    headers = ["joints", "rigs", "RMS [°]", "by hand [°]", "ratio: mean; worst"]
    headers += ["inside: mean; worst [%]", "learn [s]"]
    table("positions-only", "rigs of positions only", headers, rows)


if __name__ == "__main__":
    main()
