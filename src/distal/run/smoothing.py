"""A fixed-interval smoother: each estimate uses the whole log, also the samples after it. Offline
only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.errors import EstimationError
from distal.estimators import AdaptiveFilter, first_values
from distal.kernels import Feed, advance, covariance_of, mean_of, variances_of
from distal.logs import Log
from distal.results import Estimate
from distal.rig import Rig
from distal.run.offline import Run, finished, out_of_bounds, samples_of


def smooth(log: Log, rig: Rig, compiled: bool = True) -> Estimate:
    """Return the estimate of `adaptive` smoothed backwards over the log (Rauch, Tung and Striebel,
    AIAA Journal 3, 1965).

    G = P_k Φᵀ (P⁻_{k+1})⁻¹, x^s_k = x_k + G (x^s_{k+1} − x⁻_{k+1}), and, written so that it cannot
    be negative, P^s_k = (I − G Φ) P_k (I − G Φ)ᵀ + G (P^s_{k+1} + Q) Gᵀ with Q = P⁻_{k+1} − Φ P_k
    Φᵀ: (28) of docs/reference/adaptive-equations.md. Φ is the whole transition of the filter's own
    prediction: of joints, of states that fade, of plays, and across bridged gaps. Rows of G are
    zero for states that are guards of the filter (`State.smoothed`), and rows and columns for those
    that take a share of the gain (`StateVector.slow`); P^s holds for any G.

    Raises:
        EstimationError: the log lacks a sensor, the sensors do not suffice, or the filter diverged.
    """
    estimator = AdaptiveFilter(rig, compiled, trace=True, name="adaptive, smoothed")
    samples = samples_of(log, estimator.channels, estimator.name, estimator.bridged)
    belief = estimator.initial(log.time[0], first_values(samples))
    rows, last = estimator.checked_rows(belief, log.time, samples)
    kernel_states, ys = advance(
        estimator.kernel, Feed(belief.kernel_state, rows, estimator.parameters)
    )
    n = belief.size
    m = len(estimator.measured)
    if len(
        out_of_bounds(mean_of(kernel_states, n), variances_of(kernel_states, n), len(rig.joints))
    ):
        raise EstimationError(
            f"{log.source}: the filter left all bounds; check the units of the log and the rig"
        )
    means = mean_of(kernel_states, n).copy()
    covariances = covariance_of(kernel_states, n).copy()
    predicted = ys[:, 2 * m : 2 * m + n]
    matrices = ys[:, 2 * m + n :].reshape(-1, 2, n, n)
    # CasADi's matrices lie column by column: a covariance is symmetric, a transition has to be
    # transposed
    predicted_covariances = matrices[:, 0]
    transitions = np.swapaxes(matrices[:, 1], 1, 2)
    # each state in its own prior std, so that the inverse is well scaled
    scale = np.maximum(estimator.states.stds, 1e-12)
    # with a share of the gain its equations do not hold: such states stay as the filter had them
    slow = list(estimator.states.slow)
    unsmoothed = [*estimator.states.unsmoothed, *slow]
    quick = np.setdiff1d(np.arange(n), slow)
    for k in range(len(rows) - 2, -1, -1):
        transition = transitions[k + 1]
        before = covariances[k]
        ahead = predicted_covariances[k + 1] / np.outer(scale, scale)
        cross = (before @ transition.T) / scale
        gain = np.zeros((n, n))
        solution, *_ = np.linalg.lstsq(ahead[np.ix_(quick, quick)], cross[:, quick].T, rcond=1e-12)
        gain[:, quick] = solution.T / scale[quick]
        gain[unsmoothed] = 0.0
        means[k] += gain @ (means[k + 1] - predicted[k + 1])
        process = predicted_covariances[k + 1] - transition @ before @ transition.T
        left = np.eye(n) - gain @ transition
        covariance = left @ before @ left.T + gain @ (covariances[k + 1] + process) @ gain.T
        covariances[k] = (covariance + covariance.T) / 2
    if rig.map is not None:
        correct(means, covariances, log, rig, compiled, last)
    spreads = np.einsum("kii->ki", covariances)
    run = Run(log, estimator, samples, belief, None)
    innovations = estimator.innovations_of(ys[last], samples)
    return finished(run, means[last], spreads[last], *innovations, covariances[last])


def correct(
    means: Floats, covariances: Floats, log: Log, rig: Rig, compiled: bool, last: NDArray[np.intp]
) -> None:
    """Put the angles by the rig's maps into means and covariances, in place.

    What a map adds to the filter's own angle is not smoothed: a second run of the filter, with
    the map, gives it. Changed are the rows `last`, those of the samples.
    """
    estimator = AdaptiveFilter(rig, compiled)
    samples = samples_of(log, estimator.channels, estimator.name, estimator.bridged)
    belief = estimator.initial(log.time[0], first_values(samples))
    kernel_states, ys = estimator.advanced(belief, log.time, samples)
    states = kernel_states[:, : means.shape[1]]
    report = estimator.report.only(range(len(rig.joints)))
    means[last] += report.means(states, ys) - states
    covariances[last] = report.covariances(covariances[last], ys)
