"""The iterated filter: `adaptive`, but each row of the update is linearised again where the row has
moved the state.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from distal.estimators import AdaptiveFilter
from distal.estimators.adaptive import StateVector
from distal.estimators.adaptive.drive_tracking import MEMORY, tracking
from distal.estimators.adaptive.filter_inputs import Interval, Prediction
from distal.estimators.adaptive.joint_motion import moved
from distal.estimators.adaptive.prediction import play, predicted, revert
from distal.estimators.adaptive.update import (
    ROW,
    SLOPED,
    Comparison,
    comparison_function,
    rows_function,
    weights,
)
from distal.estimators.kinematic import Downdate, along
from distal.kernels import Kernel
from distal.rig import Rig

UPDATES = 3
"""How often each row is linearised; 1 is `adaptive`."""


class IteratedFilter(AdaptiveFilter):
    """`adaptive` with an iterated update; it cannot be exported.

    Args:
        rig: the description.
        compiled: compile its kernel where possible.
        updates: how often each row is linearised.
        name: of the estimator.
    """

    def __init__(
        self, rig: Rig, compiled: bool = True, updates: int = UPDATES, name: str = "iterated"
    ) -> None:
        super().__init__(rig.bare(), compiled=False, name=name)
        self._kernel = Kernel(iterated_function(self.states, self.substeps, updates), compiled)


def iterated_function(states: StateVector, count: int, updates: int) -> ca.Function:
    """Return (kernel_state, x, p) → (kernel_state⁺, y), as `adaptive_function`.

    Args:
        states: the state vector.
        count: sub-steps per interval.
        updates: how often each row is linearised.
    """
    n, nd, context = len(states), states.context.n_drives, states.context
    kernel_state, x = (
        ca.MX.sym("kernel_state", n + n * n + nd * (MEMORY + 1)),
        ca.MX.sym("x", context.width),
    )
    p = ca.MX.sym("p", len(context.mechanism.parameters))
    mean, covariance = kernel_state[:n], ca.reshape(kernel_state[n : n + n * n], n, n)
    begin = n + n * n
    memory = ca.reshape(kernel_state[begin : begin + nd * MEMORY], MEMORY, nd)
    kept = ca.vertsplit(kernel_state[begin + nd * MEMORY :])
    tracks = tracking(states)(mean, memory, x, p)
    motion = moved(states, count, mean, covariance, Interval(tracks, memory, x, p))
    interval = Interval(tracks, memory, x, p)
    state, spread = predicted(states, mean, covariance, motion, interval)
    transition = ca.MX(
        ca.DM.eye(n).full()
    )  # asked for by `revert` and `play`; only smoothing reads it
    prediction = Prediction(state, spread, transition)
    revert(states, prediction, {}, interval)
    for i in range(nd):
        if states.transmitted(i) is not None:
            kept[i] = play(states, i, prediction, motion.rates, kept[i], interval)
    after, spread, kept, y = iterated_update(
        states, prediction, motion.rates, kept, interval, updates
    )
    for at, lowest in enumerate(states.lowest):
        if np.isfinite(lowest):
            after[at] = ca.fmax(after[at], lowest)
    following = ca.vertcat(after, ca.vec(spread), ca.vec(tracks[:MEMORY, :]), *kept)
    return ca.Function(
        "iterated", [kernel_state, x, p], [following, y], ["kernel_state", "x", "p"], ["next", "y"]
    )


def iterated_update(
    states: StateVector,
    prediction: Prediction,
    rates: Any,
    memory: Sequence[Any],
    interval: Interval,
    updates: int,
) -> tuple[Any, Any, list[Any], Any]:
    """Return what `adaptive`'s update returns; each row is linearised at the prior, then where it
    has moved the state.

    Args:
        states: the state vector.
        prediction: for the sample.
        rates: mean speed of each drive over the interval.
        memory: what is remembered of each drive's force.
        interval: with its sample.
        updates: how often each row is linearised.
    """
    prior, covariance = prediction.state, Downdate(prediction.covariance)
    tracks, x, p = interval.tracks, interval.x, interval.p
    (table, function), nominal = rows_function(states), states.context.parameters(p, ["interval"])
    mean, kept, innovations, spreads = ca.MX(prior), list(memory), list[Any](), list[Any]()
    for k, row in enumerate(table):
        point = ca.MX(prior)
        for _ in range(updates):
            outputs = function(point, tracks, rates, x, p)
            at, moved = ROW.parts(outputs[k]), mean - point
            slopes = dict(zip(SLOPED, ca.horzsplit(outputs[len(table) + k])))
            by_value, by_limit, by_asymmetry = (covariance.times(slopes[part]) for part in SLOPED)
            now = [at[part] + along(slopes[part], moved) for part in SLOPED]
            found = Comparison(now[0], at["variance"], 0)
            if row.drive is not None:
                of_limit, of_value = (
                    along(slopes["limit"], by_limit),
                    along(slopes["value"], by_value),
                )
                memory_of = kept[row.drive]
                residual = ca.vertcat(
                    *now, at["variance"], of_limit, of_value, memory_of, at["mask"]
                )
                compare = comparison_function(states, row.drive)
                found = Comparison(*compare(residual, tracks[:, row.drive], x[0], p))
            across = found.by_limit * by_limit + found.by_asymmetry * by_asymmetry - by_value
            spread = found.by_limit * along(slopes["limit"], across)
            spread += found.by_asymmetry * along(slopes["asymmetry"], across)
            spread += found.variance - along(slopes["value"], across)
            weigh = weights(states.context.robustness, row.trusted)
            weight, shown = weigh(spread, found.innovation, at["mask"], found.counts)
            change = (weight * found.innovation) * across
            point = mean + change
        shares = states.gain_shares(row.drive, row.trusted, nominal)
        if shares:
            change[list(shares)] *= ca.vertcat(*shares.values())
        if row.drive is not None:
            declared = states.context.declares_friction(row.drive)
            kept[row.drive] = found.memory + (along(slopes["value"], change) if declared else 0)
        mean = mean + change
        covariance.take(ca.sqrt(weight) * across, list(shares), ca.vertcat(*shares.values()))
        innovations.append(shown)
        spreads.append(spread)
    measured = [k for k, row in enumerate(table) if row.measured]
    y = ca.vertcat(*(innovations[k] for k in measured), *(spreads[k] for k in measured))
    return mean, covariance.matrix(), kept, y
