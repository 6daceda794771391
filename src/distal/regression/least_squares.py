"""Least squares of logs, as yardsticks and of servos; and folds: which logs are held out together.

As yardsticks they give the angles by the readings, as ten lines of NumPy would do it: without
prior, band or limits, and in no rig file. Each fit is compared with them on the same held-out
logs, which shows whether its physical model errs less.

Of servos, where logs hold the setpoints that were sent, they give stiffness K and dead band δ: one
with a lag T stands at the position s for which  u − s = F/K + δ d + T ds/dt,  with u its setpoint,
F its force and d, from −1 to 1, its last direction of motion.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from distal.arrays import Floats
from distal.errors import FitError
from distal.logs import Log
from distal.regression.posterior import Samples, played
from distal.rig import Capstan, Rig, Slider

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


def _straight(samples: Samples) -> Floats:
    return samples.held


def _with_lags(samples: Samples) -> Floats:
    since = samples.time - samples.time[0]
    earlier = [
        np.column_stack([np.interp(since - lag, since, column) for column in samples.held.T])
        for lag in LAGS
    ]
    return np.column_stack([samples.held, *earlier])


YARDSTICKS: Mapping[str, Callable[[Samples], Floats]] = {
    "least squares": _straight,
    "least squares with lags": _with_lags,
}
"""Name → function that returns the columns φ(y) beside the constant, (k, n), from the samples of a
log.
"""


def yardstick_error(name: str, training: Sequence[Samples], held_out: Samples) -> float:
    """Return the RMS error of the yardstick `name` over all joints of a held-out log [rad], NaN
    where a joint's angle is known in no training log.

    It takes all samples of the training logs whose angle is known, see `YARDSTICKS`.
    """
    test, *designs = (
        np.column_stack([np.ones(len(log.time)), YARDSTICKS[name](log)])
        for log in (held_out, *training)
    )
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


TURNS = 3.0
"""Distance after which a drive has changed its direction, in standard deviations of its sensor's
random error. Source: judgement.
"""

TRIMMED = 3.0
"""Residual beyond which a sample is an outlier and is left out, in robust standard deviations.
Source: judgement.
"""

LEAST_RATIO = 3.0
"""Ratio of an estimate to its standard error, above which it is written. Source: judgement."""

INDEPENDENT = 0.25
"""Time after which residuals count as independent [s]. Source: judgement."""

FEWEST_OF_DRIVE = 100
"""Least number of samples of a drive for an estimate. Source: judgement."""


def servos_of(logs: Sequence[Log], rig: Rig) -> dict[str, object]:
    """Return path by names → value of the servos whose setpoints are in the logs: stiffness [N
    m/rad of a capstan, N/m of a slider] and dead band [rad, m].

    A value is left out where it is not clearly above zero.
    """
    servos: dict[str, object] = {}
    for drive in rig.drives:
        parts = [part for log in logs if (part := _rows(log, rig, drive)) is not None]
        if not parts:
            continue
        matrix, left = (np.concatenate(each) for each in zip(*((m, y) for m, y, _ in parts)))
        count = sum(seconds for _, _, seconds in parts) / INDEPENDENT
        if len(left) < FEWEST_OF_DRIVE:
            continue
        values, errors = _trimmed(matrix, left, count)
        path = f"drives.{drive.name}.servo"
        if values[0] > LEAST_RATIO * errors[0]:
            servos[f"{path}.stiffness"] = float(f"{1.0 / values[0]:.6g}")
        if values[1] > LEAST_RATIO * errors[1]:
            servos[f"{path}.dead_band"] = float(f"{values[1]:.6g}")
    return servos


def _rows(log: Log, rig: Rig, drive: Capstan | Slider) -> tuple[Floats, Floats, float] | None:
    """Return the columns F, d and ds/dt of a drive, (k, 3), its errors u − s, (k,), and the length
    of the log [s]; None where the log lacks setpoint, position or force.
    """
    sensors = {s.measures: s for s in rig.sensors if s.of == drive.name}
    if drive.name not in log.goals or not {"position", "force"} <= set(sensors):
        return None
    position, force = (log.channels.get(sensors[kind].name) for kind in ("position", "force"))
    if position is None or force is None:
        return None
    goal = log.goals[drive.name]
    half = max(TURNS * sensors["position"].noise, 1e-9)
    is_read = np.isfinite(position)
    way = np.full(len(log), np.nan)  # the last direction of motion, −1 to 1
    way[is_read] = (position[is_read] - played(position[is_read], half)) / half
    matrix = np.column_stack([force, way, np.gradient(position, log.time)])
    left = goal - position
    known = np.isfinite(matrix).all(axis=1) & np.isfinite(left)
    return matrix[known], left[known], float(np.ptp(log.time)) * float(known.mean())


def _trimmed(matrix: Floats, left: Floats, count: float) -> tuple[Floats, Floats]:
    """Return coefficients by least squares without outliers, and their standard errors if `count`
    samples are independent.
    """
    kept = np.ones(len(left), dtype=bool)
    values = np.zeros(matrix.shape[1])
    for _ in range(3):
        values[:] = np.linalg.lstsq(matrix[kept], left[kept], rcond=None)[0]
        rest = left - matrix @ values
        spread = 1.48 * float(np.median(np.abs(rest[kept]))) + 1e-12
        kept = np.abs(rest) <= TRIMMED * spread
    information = matrix[kept].T @ matrix[kept] * min(count / len(left), 1.0)
    inverse = np.linalg.pinv(information)
    return values, spread * np.sqrt(np.maximum(np.diagonal(inverse), 0.0))
