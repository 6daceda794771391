"""Yardsticks: ordinary least squares of the angles on the readings, as ten lines of NumPy would do
it, and boosted trees where scikit-learn is installed.

They have no prior, no band and no limits, and no rig file holds them. Each fit is compared with
them on the same held-out logs, which shows whether its physical model errs less.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec

import numpy as np

from distal.arrays import Floats
from distal.regression.samples import Samples, played, splits

LAGS = (0.05, 0.2, 0.8)
"""Delays of the earlier readings that "with lags" uses too [s]. Source: judgement."""

PLAYS = (0.02, 0.05, 0.15)
"""Half-widths of the play operators of "with plays", as shares of the range of each reading.
Source: judgement.
"""


def _straight(samples: Samples, ranges: Floats) -> Floats:
    return samples.held


def _with_lags(samples: Samples, ranges: Floats) -> Floats:
    since = samples.time - samples.time[0]
    earlier = [
        np.column_stack([np.interp(since - lag, since, column) for column in samples.held.T])
        for lag in LAGS
    ]
    return np.column_stack([samples.held, *earlier])


def _with_plays(samples: Samples, ranges: Floats) -> Floats:
    passed = [
        played(column, share * width)
        for share in PLAYS
        for column, width in zip(samples.held.T, ranges)
    ]
    return np.column_stack([samples.held, *passed])


Regressor = Callable[[Floats, Floats, Floats], Floats]
"""Function of (φ, angles, φ of the held-out log) that returns its angles."""


def _least_squares(phi: Floats, angles: Floats, held_out: Floats) -> Floats:
    # columns are scaled to one size against rounding errors
    size = np.maximum(np.sqrt(np.mean(phi**2, axis=0)), 1e-300)
    predicted: Floats = held_out @ (np.linalg.lstsq(phi / size, angles)[0] / size)
    return predicted


def _boosted_trees(phi: Floats, angles: Floats, held_out: Floats) -> Floats:
    """Return what gradient boosting predicts (Friedman, Ann. Stat. 29, 2001), with the defaults of
    scikit-learn.
    """
    from sklearn.ensemble import HistGradientBoostingRegressor

    trees = HistGradientBoostingRegressor(random_state=0).fit(phi, angles)
    predicted: Floats = trees.predict(held_out)
    return predicted


YARDSTICKS: Mapping[str, tuple[Callable[[Samples, Floats], Floats], Regressor]] = {
    "least squares": (_straight, _least_squares),
    "least squares with lags": (_with_lags, _least_squares),
    "least squares with plays": (_with_plays, _least_squares),
    **(
        {"boosted trees with lags": (_with_lags, _boosted_trees)}
        if find_spec("sklearn") is not None
        else {}
    ),
}
"""Name → function that returns the columns φ(y) beside the constant, (k, n), from the samples of a
log and the ranges of the readings, (m,); and the regressor.
"""


def yardstick_error(name: str, training: Sequence[Samples], held_out: Samples) -> float:
    """Return the RMS error of the yardstick `name` over all joints of a held-out log [rad], NaN
    where a joint's angle is known in no training log.

    It takes all samples of the training logs whose angle is known, see `YARDSTICKS`.
    """
    ranges = np.ptp(np.vstack([samples.held for samples in training]), axis=0)
    columns, regressor = YARDSTICKS[name]
    squares = []
    test = _design(columns, held_out, ranges)
    designs = [_design(columns, samples, ranges) for samples in training]
    for joint in range(held_out.targets.shape[1]):
        targets = [samples.targets[:, joint] for samples in training]
        rows = [np.isfinite(target) for target in targets]
        phi = np.vstack([design[known] for design, known in zip(designs, rows)])
        angles = np.concatenate([target[known] for target, known in zip(targets, rows)])
        if not len(angles):
            return float("nan")
        error = regressor(phi, angles, test) - held_out.targets[:, joint]
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


def _design(
    columns: Callable[[Samples, Floats], Floats], samples: Samples, ranges: Floats
) -> Floats:
    return np.column_stack([np.ones(len(samples.time)), columns(samples, ranges)])
