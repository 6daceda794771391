"""The adaptive filter, whole: an interval, then a sample. The equations are those of docs/explanation/adaptive.md.

The carry is the mean, the covariance, what is remembered of each drive's motion, and of each drive's force.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from distal.estimators.adaptive.apart import parts_of, side_by_side
from distal.estimators.adaptive.drive_tracking import MEMORY, Tracks, tracking
from distal.estimators.adaptive.following import follow
from distal.estimators.adaptive.interval import Interval, Prediction
from distal.estimators.adaptive.motion import Moved, moved
from distal.estimators.adaptive.play import play
from distal.estimators.adaptive.prediction import predicted, revert
from distal.estimators.adaptive.states import StateVector
from distal.estimators.adaptive.update import updated
from distal.estimators.kalman import symmetric
from distal.expressions import MatrixNode, VectorNode
from distal.kernels import Layout, carry_layout


def adaptive_layout(states: int, drives: int) -> Layout:
    """Return the layout of the carry: mean, covariance, what is remembered of each drive's motion and of its force.

    Args:
        states: number of states.
        drives: number of drives.
    """
    return carry_layout(states, drives=MEMORY * drives, forces=drives)


@lru_cache(maxsize=32)
def adaptive_function(
    states: StateVector, resolution: float | None = None, loops: bool = False, trace: bool = False
) -> ca.Function:
    """Return (carry, x, p) → (carry⁺, y) of the displacement-driven filter; y = (innovations, variances).

    Args:
        states: the state vector.
        resolution: of the joints' motion; see `FilterContext.substeps`.
        loops: keep matrices as matrices, for small memories; else the update is one function of scalars, which is faster.
        trace: append the predicted mean, its covariance and the transition to y, for smoothing.
    """
    n, nd, context = len(states), states.context.n_drives, states.context
    parts = parts_of(states)
    if parts:
        filters = [adaptive_function(part.states, resolution, loops, trace) for part in parts]
        sizes = n, nd, context.width, len(context.channels.compared)
        numbers = len(context.mechanism.parameters)
        return side_by_side(parts, filters, adaptive_layout, sizes, numbers, trace)
    layout = adaptive_layout(n, nd)
    carry, x = ca.MX.sym("carry", layout.size), ca.MX.sym("x", context.width)
    p = ca.MX.sym("p", len(context.mechanism.parameters))
    mean, covariance, memory, forces = (layout.part(carry, name) for name in ("mean", "covariance", "drives", "forces"))
    tracks = tracking(states)(mean, memory, x, p)  # (1) to (6)
    motion = moved(
        states, context.substeps(resolution), mean, covariance, Interval(tracks, memory, x, p)
    )  # (7) to (10)
    arguments = [mean, covariance, *_parts(motion), tracks, memory, forces, x, p]
    step = corrected(states, arguments, loops=True) if loops else _Step(*_scalars(states, arguments)(*arguments))
    remembered = Tracks(tracks, nd).memory
    following = layout.joined(mean=step.mean, covariance=step.covariance, drives=remembered, forces=step.forces)
    y = step.y
    if trace:
        y = ca.vertcat(y, step.predicted_mean, ca.vec(step.predicted_covariance), ca.vec(step.transition))
    return ca.Function("adaptive", [carry, x, p], [following, y], ["carry", "x", "p"], ["next", "y"])


@dataclass(frozen=True)
class _Step:
    """The filter after a sample, and, with `predicted_` before their names and Φ, before its update."""

    mean: VectorNode
    covariance: MatrixNode
    forces: VectorNode
    y: VectorNode
    predicted_mean: VectorNode
    predicted_covariance: MatrixNode
    transition: MatrixNode


def corrected(states: StateVector, arguments: list[MatrixNode], loops: bool) -> _Step:
    """Return the filter after a sample, once the joints have moved.

    Args:
        states: the state vector.
        arguments: mean, covariance, the joints' motion, tracks, what is remembered of the drives' motions and forces, the
            sample, the parameters.
        loops: whether this stays a function of matrices.
    """
    mean, covariance, *joints, tracks, memory, forces, x, p = arguments
    motion, interval = Moved(*joints), Interval(tracks, memory, x, p)
    after = predicted(states, mean, covariance, motion, interval)  # (11), (12)
    prediction = Prediction(*after, _moving(states, motion))
    revert(states, prediction, interval)  # (13)
    prediction = prediction if loops else replace(prediction, covariance=symmetric(prediction.covariance))
    kept = [forces[i] for i in range(states.context.n_drives)]
    for i in range(states.context.n_drives):
        if states.transmitted(i) is not None:
            kept[i] = play(states, i, prediction, motion.rates, kept[i], interval)  # (14), (15)
    follow(states, prediction, interval)  # (15b)
    before = replace(prediction, state=ca.MX(prediction.state), covariance=ca.MX(prediction.covariance))
    mean, covariance, kept, y = updated(states, prediction, motion.rates, kept, interval, loops)  # (16) to (26)
    for at, lowest in enumerate(states.lowest):
        if np.isfinite(lowest):
            mean[at] = ca.fmax(mean[at], lowest)  # (27)
    names = states.context.mechanism.parameters.names
    for j, joint in enumerate(states.context.mechanism.rig.joints):
        if joint.stops is not None:
            low, high = (p[names.index(f"joints.{j}.stops.{end}")] for end in ("low", "high"))
            depth = ca.fmax(ca.fmax(mean[j] - high, low - mean[j]), 0)
            # how deep a joint sits in its stop is known no better than the depth
            covariance[j, j] = ca.fmax(covariance[j, j], depth * depth)  # (27b)
    return _Step(mean, covariance, ca.vertcat(*kept), y, before.state, before.covariance, before.transition)


def _moving(states: StateVector, motion: Moved) -> MatrixNode:
    """Return the transition Φ, (n, n), of an interval in which nothing but angles and speeds moves."""
    n, nj = len(states), states.context.n_joints
    transition = ca.MX(ca.DM.eye(n).full())
    transition[:nj, :], transition[nj : 2 * nj, :] = motion.angle_slopes[:, :n], motion.speed_slopes[:, :n]
    return transition


def _parts(whole: Moved | _Step) -> list[MatrixNode]:
    return [getattr(whole, field.name) for field in fields(whole)]


def _scalars(states: StateVector, arguments: list[MatrixNode]) -> ca.Function:
    """Return `corrected` as one function of scalars: what is zero or twice the same is then left out."""
    symbols = [ca.MX.sym(f"i{k}", *entry.shape) for k, entry in enumerate(arguments)]
    whole = ca.Function("update", symbols, _parts(corrected(states, symbols, loops=False)))
    scalars = [ca.SX.sym(f"i{k}", *entry.shape) for k, entry in enumerate(arguments)]
    return ca.Function("update", scalars, ca.cse([ca.densify(entry) for entry in whole.call(scalars, True)]))
