"""Motion beyond a homing move: how the error of a corrected angle grows with the distance from the
range that the move covered.
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
    """Return κ of each joint: the error for each radian beyond what a homing move covered.

    It is the 95 % quantile of the held-out logs' own κ (`cost_beyond`), 0 where nothing lies
    beyond.

    Args:
        partly: by index, logs after a homing move that covers half of their range.
        fit: returns the map learned without the log of an index, or None where there is none.
        joints: number of joints.
        homing: length of the homing move [s].
        by_motion: as in `calibrate_window`.
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
    """Return κ of a joint on a log, κ² = (mean e² − mean v)/mean h² over the samples beyond its
    homing move; None where there are none.

    e are the errors, v the variances without κ, and h is how far the angle is beyond what the move
    covered, see `features.beyond_homing`. The move took a time `homing` [s].
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
