"""All steps of the adaptive filter in their order: an interval, then a sample. The equations are
those of docs/reference/adaptive-equations.md.

The kernel state is the mean, the covariance, and what is remembered of each drive's motion, of
forces, and of torques on the joints.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from distal.estimators.adaptive.drive_tracking import MEMORY, Tracks, tracking
from distal.estimators.adaptive.independent_subsystems import filter_by_parts, subsystems_of
from distal.estimators.adaptive.internal_motion import follow, play
from distal.estimators.adaptive.interval import Interval, Prediction
from distal.estimators.adaptive.joint_motion import Moved, moved
from distal.estimators.adaptive.prediction import predicted, revert, shifted_variance
from distal.estimators.adaptive.slack_pairs import within_play
from distal.estimators.adaptive.states import StateVector
from distal.estimators.adaptive.touch import Remembered, touch_layout
from distal.estimators.adaptive.update import depths_in_stops, updated
from distal.expressions import MatrixNode, VectorNode
from distal.kernels import Layout, kernel_state_layout


def adaptive_layout(states: StateVector) -> Layout:
    """Return the layout of the kernel state: mean, covariance, and what is remembered of each
    drive's motion, of forces, and of torques on the joints.
    """
    context = states.context
    drives = MEMORY * context.n_drives
    return kernel_state_layout(len(states), drives=drives, **touch_layout(context))


@lru_cache(maxsize=32)
def adaptive_function(
    states: StateVector, resolution: float | None = None, trace: bool = False
) -> ca.Function:
    """Return the function (kernel_state, x, p) → (kernel_state⁺, y) of the displacement-driven
    filter; y = (innovations, variances).

    Args:
        resolution: of the joints' motion; see `FilterContext.substeps`.
        trace: append the predicted mean, its covariance and the transition to y, for smoothing.
    """
    nd = states.context.n_drives
    context = states.context
    layout = adaptive_layout(states)
    filters = [
        (part, adaptive_function(part.states, resolution, trace)) for part in subsystems_of(states)
    ]
    if filters:
        return filter_by_parts(states, filters, layout, trace)
    kernel_state = ca.MX.sym("kernel_state", layout.size)
    x = ca.MX.sym("x", context.width)
    p = ca.MX.sym("p", len(context.mechanism.parameters))
    mean, covariance, memory = (
        layout.part(kernel_state, name) for name in ("mean", "covariance", "drives")
    )
    tracks = tracking(states)(mean, memory, x, p)  # (1) to (6)
    interval = Interval(tracks, memory, x, p)
    motion = moved(states, context.substeps(resolution), mean, covariance, interval)  # (7) to (10)
    after = predicted(states, mean, covariance, motion, interval)  # (11), (12)
    prediction = Prediction(*after, _moving(states, motion))
    kept = Remembered.of(context, layout, kernel_state)
    revert(states, prediction, kept.opened, interval)  # (13)
    for i in range(nd):
        if states.transmitted(i) is not None:
            friction = kept.drives[i]["friction"]
            kept.drives[i]["friction"] = play(
                states, i, prediction, motion.rates, friction, interval
            )  # (14), (15)
    follow(states, prediction, interval)  # (15b)
    before = [ca.MX(prediction.state), ca.vec(prediction.covariance), ca.vec(prediction.transition)]
    mean, covariance, y = updated(states, prediction, motion.rates, kept, interval)  # (16) to (32)
    mean, covariance = within_play(states, mean, covariance, interval)  # (26b)
    _bounded(states, mean, covariance, tracks, p)
    remembered = Tracks(tracks).memory
    following = layout.joined(
        mean=mean,
        covariance=covariance,
        drives=remembered,
        **kept.joined(),
    )
    y = ca.vertcat(y, *before) if trace else y
    return ca.Function("adaptive", [kernel_state, x, p], [following, y])


def _bounded(
    states: StateVector, mean: VectorNode, covariance: MatrixNode, tracks: VectorNode, p: VectorNode
) -> None:
    """Keep states above their lowest values, and the variances of angles above those that stops and
    jumped zeros leave, in place.
    """
    for at, lowest in enumerate(states.lowest):
        if np.isfinite(lowest):
            least = states.context.parameters(p, [f"state.{at}.lowest"])
            mean[at] = ca.fmax(mean[at], least)  # (27)
    for j, depth in depths_in_stops(states, mean, p).items():
        # how deep a joint sits in its stop is known no better than the depth
        covariance[j, j] = ca.fmax(covariance[j, j], ca.fmax(depth, 0) ** 2)  # (27b)
    context = states.context
    nj = states.context.n_joints
    if context.robustness.zeros_jump:
        free = context.mechanism.free
        spread = context.mechanism.spread
        for j in free:
            covariance[j, j] = ca.fmax(
                covariance[j, j], shifted_variance(context, j, tracks, p)
            )  # (31)
        for j in set(range(nj)) - set(free):  # coupled ones err as these
            covariance[j, j] = ca.mtimes([spread[j, :], covariance[free, free], spread[j, :].T])


def _moving(states: StateVector, motion: Moved) -> MatrixNode:
    """Return the transition Φ, (n, n), of an interval in which nothing but angles and speeds
    moves.
    """
    n = len(states)
    nj = states.context.n_joints
    transition = ca.MX(ca.DM.eye(n).full())
    parameters = len(motion.chosen)
    transition[: 2 * nj, :] = 0
    transition[: 2 * nj, motion.chosen] = motion.slopes[:parameters, :].T
    for k, (at, slopes) in enumerate(motion.positions):
        if at:
            transition[: 2 * nj, at] += ca.mtimes(motion.slopes[parameters + k, :].T, slopes.T)
    return transition
