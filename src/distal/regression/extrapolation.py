"""Motion beyond a homing move: the error of a corrected angle for each radian beyond the range that the move covered."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from distal.regression.band import COVERED
from distal.regression.features import Samples, beyond_homing, predict
from distal.regression.window import calibrate_window
from distal.rig import LearnedMap


def extrapolation(
    partly: Mapping[int, Samples], told: Callable[[int], LearnedMap | None], joints: int, homing: float, by_motion: bool
) -> tuple[float, ...]:
    """Return κ of each joint, by logs left out whose homing move covers half of their range.

    Each run has a κ of its own; what is returned is the 95 % quantile over the logs, 0 where nothing lies beyond.

    Args:
        partly: the logs, by their index.
        told: returns the map learned from the others, None where there is none.
        joints: number of joints.
        homing: length of the homing window [s].
        by_motion: see `calibrate_window`.
    """
    costs: list[list[float]] = [[] for _ in range(joints)]
    for i, out in partly.items():
        learned = told(i)
        if learned is None:
            continue
        learned, _ = calibrate_window(learned, out, out.window(homing), by_motion)
        for j, own in enumerate(costs):
            cost = cost_beyond(learned, out, j, homing)
            own += [] if cost is None else [cost]
    return tuple(float(np.quantile(own, COVERED)) if own else 0.0 for own in costs)


def cost_beyond(learned: LearnedMap, samples: Samples, joint: int, homing: float) -> float | None:
    """Return κ of a log, κ² = (mean e² − mean v)/mean h² over what lies beyond its homing move; None where nothing does.

    e are the errors, v the variances without κ, h is from `beyond_homing`.

    Args:
        learned: after the move.
        homing: length of the homing window [s].
    """
    said = predict(learned, samples, joint)
    past, target = beyond_homing(learned, samples, joint, said.values), samples.targets[:, joint]
    there = (samples.time >= homing) & np.isfinite(target) & (past > 0.0)
    if not there.any():
        return None
    excess = float(np.mean(((said.values - target) ** 2 - said.variances - said.own)[there]))
    return float(np.sqrt(max(excess, 0.0) / float(np.mean(past[there] ** 2))))
