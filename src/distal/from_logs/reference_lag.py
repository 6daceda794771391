"""How much later a reference is than the drives, and whether that grows: two clocks, or a slow
camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from distal.arrays import Floats
from distal.from_logs.motion_data import MotionData

LONGEST_LAG = 0.3
"""Largest lag of a reference that is looked for [s]. Source: judgement."""


LAG_STEP = 0.005
"""Step of that search [s]. Source: judgement."""


GAIN = 0.8
"""A lag counts where it leaves less than this share of the residual [1]. Source: judgement."""


def reference_lag(logs: Sequence[MotionData], joint: int) -> float:
    """Return how much later a joint's reference is than the drives [s], 0 where no lag makes them
    agree clearly better.
    """
    lags = np.arange(-LONGEST_LAG, LONGEST_LAG + LAG_STEP / 2, LAG_STEP)
    residuals = _joint_residuals(logs, joint, lags)
    best = int(np.argmin(residuals))
    usual = residuals[len(lags) // 2]
    return float(lags[best]) if residuals[best] < GAIN * usual else 0.0


def reference_drift(logs: Sequence[MotionData], joint: int) -> float:
    """Return how much later a joint's reference is in the last third of the logs than in the first,
    both beside the drives [s]: of two clocks one is faster.
    """
    early, late = ([_third(log, k) for log in logs] for k in (0, 2))
    return reference_lag(late, joint) - reference_lag(early, joint)


def _third(log: MotionData, k: int) -> MotionData:
    count = len(log.time) // 3
    rows = slice(k * count, (k + 1) * count)
    names = ("time", "positions", "directions", "efforts", "angles")
    return replace(log, **{name: getattr(log, name)[rows] for name in names})


def _joint_residuals(logs: Sequence[MotionData], joint: int, lags: Floats) -> Floats:
    """Return what the drives, their directions and efforts leave of a joint that is moved back in
    time by each of the `lags` [s], (n_lags,) [rad], where it is known with all of them.
    """
    columns = []
    targets = []
    for log in logs:
        there = np.isfinite(log.angles[:, joint])
        if there.sum() < 2:
            continue
        first, last = log.time[there][[0, -1]]
        times = log.time[:, None] + lags
        usable = (times[:, 0] >= first) & (times[:, -1] <= last)
        if usable.sum() < 2:
            continue
        angles = np.interp(times[usable], log.time[there], log.angles[there, joint])
        efforts = log.efforts[:, np.isfinite(log.efforts).all(axis=0)]
        matrix = np.column_stack([log.positions, log.directions, efforts])[usable]
        columns.append(matrix - matrix.mean(axis=0))
        targets.append(angles - angles.mean(axis=0))
    if not columns:
        return np.zeros(len(lags))
    matrix = np.vstack(columns)
    size = np.maximum(np.sqrt(np.mean(matrix**2, axis=0)), 1e-300)
    target = np.vstack(targets)
    coefficients = np.linalg.lstsq(matrix / size, target, rcond=1e-9)[0]
    left = target - matrix / size @ coefficients
    return np.asarray(np.sqrt(np.mean(left**2, axis=0)))
