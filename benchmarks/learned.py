"""Rigs that `distal learn` writes from logs alone, beside least squares and boosted trees.

`python -m benchmarks.learned plants [--first-seed 8000] [--only finger-2n]` draws logs of plants
that share no code with `distal.model` (`benchmarks.touch`), runs `distal learn` on their
calibration logs without a rig file, reads the file that it wrote, and judges it on logs of free
motion that nothing has seen. Beside it stands the yardstick that errs least on each calibration log
by the rest of them: least squares, the same with lags, and boosted trees.

`python -m benchmarks.learned by-hand` fits by `distal fit` the rig files that somebody wrote for
these plants, and judges both on the same logs.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import table
from benchmarks.shell import command, estimate
from benchmarks.touch import CASES, Drawn, fitted
from distal import Rig, load_rig, read_log
from distal.errors import EstimationError
from distal.estimators import samples_of_angles
from distal.regression import YARDSTICKS, Samples, yardstick_error

Floats = NDArray[np.float64]

TREES = "boosted trees"
"""Name of the yardstick that no rig file can hold."""

DELAYS = (0.05, 0.2, 0.8)
"""Delays of the earlier readings that the trees see too [s]."""

OF_BAND = 0.95
"""Share of the errors that a band shall hold."""


@dataclass(frozen=True)
class Outcome:
    """How a rig did on logs that nothing has seen.

    Args:
        rms: RMS error of each log [°].
        inside: share of the samples inside the band, over all logs and joints.
        half: mean half-width of the band over that which holds 95 % of the errors [1].
    """

    rms: tuple[float, ...]
    inside: float
    half: float


def tree_error(training: Sequence[Samples], held_out: Samples) -> float:
    """Return the RMS error of boosted trees over all joints of a held-out log [rad]."""
    from sklearn.ensemble import HistGradientBoostingRegressor

    squares = []
    columns = _seen_by_trees(held_out)
    for joint in range(held_out.targets.shape[1]):
        rows = [np.isfinite(log.targets[:, joint]) for log in training]
        phi = np.vstack([_seen_by_trees(log)[known] for log, known in zip(training, rows)])
        angles = np.concatenate([log.targets[known, joint] for log, known in zip(training, rows)])
        trees = HistGradientBoostingRegressor(random_state=0).fit(phi, angles)
        error = trees.predict(columns) - held_out.targets[:, joint]
        squares.append(error[np.isfinite(error)] ** 2)
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def _seen_by_trees(samples: Samples) -> Floats:
    since = samples.time - samples.time[0]
    earlier = [
        np.column_stack([np.interp(since - delay, since, column) for column in samples.readings.T])
        for delay in DELAYS
    ]
    return np.column_stack([samples.readings, *earlier])


Yardstick = Callable[[Sequence[Samples], Samples], float]


def yardsticks() -> Mapping[str, Yardstick]:
    """Return name → function of training logs and a held-out log → RMS error [rad]."""
    found: dict[str, Yardstick] = {
        name: lambda training, held_out, name=name: yardstick_error(  # type: ignore[misc]
            name, training, held_out
        )
        for name in YARDSTICKS
    }
    return {**found, TREES: tree_error}


def best_yardstick(
    training: Sequence[Samples], others: Sequence[Samples]
) -> tuple[str, tuple[float, ...], dict[str, float]]:
    """Return the yardstick that errs least on each training log by the rest of them, its RMS errors
    on other logs [°], and the mean of every yardstick there [°].
    """
    folds = range(len(training))
    known = yardsticks()
    own = {
        name: np.mean([error([training[i] for i in folds if i != k], training[k]) for k in folds])
        for name, error in known.items()
    }
    best = min(own, key=lambda name: own[name])
    every = {
        name: [float(np.rad2deg(error(training, log))) for log in others]
        for name, error in known.items()
    }
    return best, tuple(every[best]), {name: float(np.mean(of)) for name, of in every.items()}


def outcome_of(rig: Rig, paths: Sequence[Path]) -> Outcome:
    """Return how a rig does on logs that nothing has seen."""
    rms, errors, halves = [], [], []
    for path in paths:
        log = read_log(path, rig)
        try:
            result = estimate(log, rig)
        except EstimationError:  # the filter of a rig that lacks its physics left all bounds
            result = estimate(log, rig, "regression")
        own = np.rad2deg(result.errors()).reshape(len(result.time), -1)
        known = np.isfinite(own)
        stds = result.angle_stds.reshape(own.shape)
        rms.append(float(np.sqrt(np.mean(own[known] ** 2))))
        errors.append(np.abs(own[known]))
        halves.append(1.96 * np.rad2deg(stds[known]))
    error, half = np.concatenate(errors), np.concatenate(halves)
    needed = float(np.quantile(error, OF_BAND))
    return Outcome(tuple(rms), float(np.mean(error <= half)), float(np.mean(half)) / needed)


def learned(paths: Sequence[Path], folder: Path, *words: str) -> tuple[Rig | None, float, str]:
    """Return the rig that `distal learn` writes from logs, the seconds that it took, and what it
    printed.
    """
    began = time.perf_counter()
    done = command(folder, "learn", *map(str, paths), "--out", "learned.toml", *words)
    seconds = time.perf_counter() - began
    if done.returncode:
        return None, seconds, done.stderr.strip()
    return load_rig(folder / "learned.toml"), seconds, done.stdout


def row_of(
    name: str, training: Sequence[Path], judged: Sequence[Path], *words: str
) -> tuple[str, ...]:
    """Return the cells of a rig: errors, those of the yardsticks, and the band."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rig, seconds, said = learned(training, Path(folder), *words)
        if rig is None:
            print(said[-400:], file=sys.stderr)
            return (name, "no file", "", "", "", "", "", f"{seconds:.0f}")
        outcome = outcome_of(rig, judged)
        samples = [samples_of_angles(read_log(path, rig), rig) for path in (*training, *judged)]
        count = len(training)
        best, errors, every = best_yardstick(samples[:count], samples[count:])
    ratios = np.array(outcome.rms) / np.array(errors)
    beside = " ".join(f"{error:.2f}" for error in every.values())
    cells = (
        name,
        f"{np.mean(outcome.rms):.3f}",
        f"{np.mean(errors):.3f} ({best})",
        f"{np.median(ratios):.2f}",
        beside,
        f"{100 * outcome.inside:.0f}",
        f"{outcome.half:.2f}",
        f"{seconds:.0f}",
    )
    print(*cells, sep=" | ", file=sys.stderr)
    return cells


COLUMNS = (
    "rig",
    "learned [°]",
    "the yardstick that its logs choose [°]",
    "ratio, median",
    "straight, lags, trees [°]",
    "inside [%]",
    "half-width over what 95 % need",
    "seconds",
)


def hand_written(drawn: Drawn, name: str) -> tuple[str, ...]:
    """Return the cells of a rig from logs beside a rig that somebody wrote, both fitted by the
    command to the same logs: RMS errors, their ratio, and the shares inside the band, in free
    motion and while touched.
    """
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rig, _, said = learned(drawn.calibration, Path(folder))
        if rig is None:
            print(said[-400:], file=sys.stderr)
            return (name, "no file", *[""] * (len(BESIDE) - 2))
        found = outcome_of(rig, drawn.free)
        touched = outcome_of(rig, drawn.touched)
        file = fitted(drawn, Path(folder))
        by_hand = outcome_of(file, drawn.free)
        by_hand_touched = outcome_of(file, drawn.touched)
    ratios = np.array(found.rms) / np.array(by_hand.rms)
    cells = (
        name,
        f"{np.mean(found.rms):.3f}",
        f"{np.mean(by_hand.rms):.3f}",
        f"{np.median(ratios):.2f}",
        f"{100 * found.inside:.0f}",
        f"{100 * by_hand.inside:.0f}",
        *(
            f"{np.mean(outcome.rms):.2f}, {100 * outcome.inside:.0f} %"
            for outcome in (touched, by_hand_touched)
        ),
    )
    print(*cells, sep=" | ", file=sys.stderr)
    return cells


BESIDE = (
    "rig",
    "learned [°]",
    "hand-written, fitted [°]",
    "ratio, median",
    "inside [%]",
    "hand-written, inside [%]",
    "touched: learned [°], inside",
    "touched: hand-written",
)


def drawn_cases(first: int, only: str | None) -> Iterator[tuple[str, Drawn]]:
    """Yield name and logs of the plants of `benchmarks.touch`; the logs are gone after each."""
    for name, drawn_by in CASES.items():
        if (only is None or name == only) and "touched" not in name:
            with tempfile.TemporaryDirectory() as folder:
                yield name, drawn_by(first, Path(folder))


def beside_hand_written(first: int, only: str | None) -> None:
    """Print the errors on these plants beside those of their rig files."""
    rows = [hand_written(drawn, name) for name, drawn in drawn_cases(first, only)]
    table("learned-by-hand", f"beside rigs that somebody wrote, seed {first}", BESIDE, rows)


def plants(first: int, only: str | None) -> None:
    """Print the errors on these plants beside those of yardsticks."""
    cases = drawn_cases(first, only)
    rows = [row_of(name, drawn.calibration, drawn.free) for name, drawn in cases]
    table("learned-plants", f"distal learn, seed {first}", COLUMNS, rows)


def main() -> None:
    """Run a part."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=("plants", "by-hand"))
    parser.add_argument("--first-seed", type=int, default=8000)
    parser.add_argument("--only")
    arguments = parser.parse_args()
    part = plants if arguments.part == "plants" else beside_hand_written
    part(arguments.first_seed, arguments.only)


if __name__ == "__main__":
    main()
