"""Motion beyond a homing move: the error of a corrected angle for each radian beyond the range that
the move covered.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from distal.confidence import COVERED
from distal.regression.after_homing import calibrate_window
from distal.regression.features import Samples, beyond_homing, predict
from distal.rig import LearnedMap


def extrapolation(
    partly: Mapping[int, Samples],
    fit: Callable[[int], LearnedMap | None],
    joints: int,
    homing: float,
    by_motion: bool,
) -> tuple[float, ...]:
    """Return κ of each of the joints, by logs left out whose homing move of `homing` s covers half
    of their range.

    Each run has a κ of its own; what is returned is the 95 % quantile over the logs, 0 where
    nothing lies beyond. `fit` gives the map without a log by its index, None where there is none.
    """
    costs: list[list[float]] = [[] for _ in range(joints)]
    for i, out in partly.items():
        learned = fit(i)
        if learned is None:
            continue
        learned, _ = calibrate_window(learned, out, out.window(homing), by_motion)
        for j in range(joints):
            cost = cost_beyond(learned, out, j, homing)
            costs[j] += [] if cost is None else [cost]
    return tuple(float(np.quantile(of_joint, COVERED)) if of_joint else 0.0 for of_joint in costs)


def cost_beyond(learned: LearnedMap, samples: Samples, joint: int, homing: float) -> float | None:
    """Return κ of a log, κ² = (mean e² − mean v)/mean h² over what lies beyond its homing move;
    None where nothing does.

    e are the errors, v the variances without κ, h is from `beyond_homing`; the move took a time
    `homing` [s].
    """
    predicted = predict(learned, samples, joint)
    past = beyond_homing(learned, samples, joint, predicted.values)
    target = samples.targets[:, joint]
    rows = (samples.time >= homing) & np.isfinite(target) & (past > 0.0)
    if not rows.any():
        return None
    excess = float(
        np.mean(
            ((predicted.values - target) ** 2 - predicted.variances - predicted.filter_variances)[
                rows
            ]
        )
    )
    return float(np.sqrt(max(excess, 0.0) / float(np.mean(past[rows] ** 2))))
