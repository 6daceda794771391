"""A fixed-interval smoother: each estimate uses the whole log, not only what came before. Offline only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from distal.errors import EstimationError
from distal.estimators.adaptive import AdaptiveFilter
from distal.estimators.estimate import first_values, out_of_bounds, samples_of
from distal.estimators.result import Estimate
from distal.logs import Log, frozen
from distal.rig import Rig

Floats = NDArray[np.float64]


def smooth(log: Log, rig: Rig, compiled: bool = True) -> Estimate:
    """Return the estimate of `adaptive` smoothed backwards over the log (Rauch, Tung and Striebel, 1965).

    C_k = P_k Φᵀ (P⁻_{k+1})⁻¹, x^s_k = x_k + C_k (x^s_{k+1} − x⁻_{k+1}), P^s_k = P_k + C_k (P^s_{k+1} − P⁻_{k+1}) C_kᵀ, with
    the slopes Φ of the filter's own predictions, bridges of gaps included.

    Args:
        log: sensors over time.
        rig: the description.
        compiled: compile the kernel where possible.

    Raises:
        EstimationError: the log lacks a sensor, or the sensors do not suffice.
    """
    runner = AdaptiveFilter(rig, compiled, trace=True, name="adaptive, smoothed")
    samples = samples_of(log, runner.channels, runner.name)
    belief = runner.initial(log.time[0], first_values(samples))
    rows, last = runner._rows(np.diff(log.time, prepend=log.time[0]), samples)
    carries, ys = runner.kernel.scan(belief.carry, rows, runner._p)
    n, m = belief.size, len(runner.measured)
    if np.any(np.isinf(samples)) or len(out_of_bounds(carries[:, :n], carries[:, n : n + n * n : n + 1])):
        raise EstimationError(f"{log.source}: the filter left all bounds; check the units of the log and the rig")
    means, covariances = carries[:, :n].copy(), carries[:, n : n + n * n].reshape(-1, n, n).copy()
    predicted, uncertain = ys[:, 2 * m : 2 * m + n], ys[:, 2 * m + n : 2 * m + n + n * n].reshape(-1, n, n)
    slopes = ys[:, 2 * m + n + n * n :].reshape(-1, 2, n)
    fade = runner.torque_fade(rows[:, 0])
    # each state in its own prior std, so that the inverse is well scaled
    scale = np.maximum(runner.prior_stds, 1e-12)
    for k in range(len(rows) - 2, -1, -1):
        transition = np.eye(n)
        transition[:2] = slopes[k + 1]
        if runner.torque_at is not None:
            transition[runner.torque_at, runner.torque_at] = fade[k + 1]
        ahead = uncertain[k + 1] / np.outer(scale, scale)
        cross = (covariances[k] @ transition.T) / scale
        gain = np.linalg.lstsq(ahead, cross.T, rcond=1e-12)[0].T / scale
        means[k] += gain @ (means[k + 1] - predicted[k + 1])
        change = gain @ (covariances[k + 1] - uncertain[k + 1]) @ gain.T
        covariances[k] += (change + change.T) / 2
    spreads = np.einsum("kii->ki", covariances)
    np.maximum(spreads, 0.0, out=spreads)
    values, variances = runner._innovations(ys[last], samples)
    return Estimate(
        runner.name,
        rig.name,
        log.time,
        runner.state_names,
        frozen(means[last]),
        frozen(spreads[last]),
        runner.measured,
        frozen(values),
        frozen(variances),
        log.truth.get("theta"),
        frozen(covariances[last]),
    )
