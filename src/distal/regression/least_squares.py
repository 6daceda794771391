"""Yardsticks, least squares of logs; and folds: which logs are held out together.

Yardsticks give the angles by the readings, as ten lines of NumPy would do it: without
prior, band or limits, and in no rig file. Each fit is compared with them on the same held-out
logs, which shows whether its physical model errs less.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from distal.arrays import Floats
from distal.errors import FitError
from distal.regression.posterior import Samples

FEWEST_LOGS = 3
"""With fewer logs nobody knows which of them is odd. Source: definition."""

MOST_FOLDS = 6
"""Largest number of folds: for each of them everything is learned anew. Source: judgement."""


def folds_of(groups: Sequence[str]) -> list[int]:
    """Return the fold of each log, numbered from 0: logs of one group are in one fold.

    There are at most `MOST_FOLDS`; with more groups several share a fold.
    """
    every = list(dict.fromkeys(groups))
    return [every.index(name) % MOST_FOLDS for name in groups]


def splits(folds: Sequence[int]) -> Iterator[tuple[list[int], list[int]]]:
    """Yield, for each fold, the indices of the logs that it holds out and of all other logs."""
    for fold in sorted(set(folds)):
        out = [i for i, fold_of_log in enumerate(folds) if fold_of_log == fold]
        yield out, [i for i, fold_of_log in enumerate(folds) if fold_of_log != fold]


def groups_of(names: Sequence[str], pattern: str | None, least: int = 2) -> list[str]:
    """Return the group of each log: its own name, or what a regular expression finds in its file
    name.

    The first parenthesis of the `pattern` finds the group, e.g. ``run_(.)``. Without a pattern,
    None, each log is a group of its own.

    Raises:
        FitError: the pattern is no regular expression, has no parenthesis or does not match a name,
            or there are fewer groups than `least`.
    """
    groups = list(names)
    if pattern is not None:
        try:
            expression = re.compile(pattern)
        except re.error as problem:
            raise FitError(f"'{pattern}': not a regular expression ({problem})") from None
        if expression.groups < 1:
            raise FitError(
                f"'{pattern}': needs a parenthesis around what names a group, e.g. 'run_(.)'"
            )
        groups = []
        for name in names:
            match = expression.search(Path(name).name)
            if match is None:
                raise FitError(f"'{pattern}': does not match '{Path(name).name}'")
            groups.append(str(match[1]))
    if len(set(groups)) < least:
        raise FitError(
            f"logs of at least {least} groups are needed; {len(names)} logs came, of "
            f"{len(set(groups))}"
        )
    return groups


LAGS = (0.05, 0.2, 0.8)
"""Delays of the earlier readings that "with lags" uses too [s]. Source: judgement."""


YARDSTICKS: Mapping[str, tuple[float, ...]] = {
    "least squares": (),
    "least squares with lags": LAGS,
}
"""Name → delays of the earlier readings that are used beside those of a sample [s]."""


def _columns(samples: Samples, lags: Sequence[float]) -> Floats:
    """Return a constant, the readings of a log, and earlier ones, (k, n)."""
    time = samples.time
    earlier = [np.interp(time - lag, time, column) for lag in lags for column in samples.held.T]
    return np.column_stack([np.ones(len(time)), samples.held, *earlier])


def yardstick_error(name: str, training: Sequence[Samples], held_out: Samples) -> float:
    """Return the RMS error of the yardstick `name` over all joints of a held-out log [rad], NaN
    where a joint's angle is known in no training log.

    It takes all samples of the training logs whose angle is known, see `YARDSTICKS`.
    """
    test, *designs = (_columns(log, YARDSTICKS[name]) for log in (held_out, *training))
    squares = []
    for joint in range(held_out.targets.shape[1]):
        targets = [samples.targets[:, joint] for samples in training]
        rows = [np.isfinite(target) for target in targets]
        phi = np.vstack([design[known] for design, known in zip(designs, rows)])
        angles = np.concatenate([target[known] for target, known in zip(targets, rows)])
        if not len(angles):
            return float("nan")
        # columns are scaled to one size against rounding errors
        size = np.maximum(np.sqrt(np.mean(phi**2, axis=0)), 1e-300)
        weights = np.linalg.lstsq(phi / size, angles)[0] / size
        error = test @ weights - held_out.targets[:, joint]
        squares.append(error[np.isfinite(error)] ** 2)
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def line_errors(logs: Sequence[Samples], folds: Sequence[int]) -> list[float]:
    """Return the RMS errors of least squares on logs, by the logs of the other folds [rad]; NaN as
    by `yardstick_error`.
    """
    return [
        yardstick_error("least squares", [logs[i] for i in remaining], logs[k])
        for out, remaining in splits(folds)
        for k in out
    ]
