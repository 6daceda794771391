"""A fixed-interval smoother: each estimate uses the whole log, not only what came before. Offline only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.errors import EstimationError
from distal.estimators import AdaptiveFilter, first_values, state_units
from distal.kernels import Feed, advance, covariance_of, mean_of, variances_of
from distal.logs import Log, frozen, true_angles
from distal.results import Estimate
from distal.rig import Rig
from distal.run.offline import out_of_bounds, priors_of, samples_of


def smooth(log: Log, rig: Rig, compiled: bool = True) -> Estimate:
    """Return the estimate of `adaptive` smoothed backwards over the log (Rauch, Tung and Striebel, AIAA Journal 3, 1965).

    G = P_k Φᵀ (P⁻_{k+1})⁻¹, x^s_k = x_k + G (x^s_{k+1} − x⁻_{k+1}), and, as a sum of what cannot be negative,
    P^s_k = (I − G Φ) P_k (I − G Φ)ᵀ + G (P^s_{k+1} + Q) Gᵀ with Q = P⁻_{k+1} − Φ P_k Φᵀ: (28) of
    docs/reference/adaptive-equations.md. Φ is the whole transition of the filter's own predictions: joints, what fades,
    plays, bridges of gaps. Rows of G are zero for states that are guards of the filter (`State.smoothed`), and rows and
    columns for those that take a share of the gain (`StateVector.slow`); P^s holds for any G.

    Args:
        compiled: compile the kernel where possible.

    Raises:
        EstimationError: the log lacks a sensor, or the sensors do not suffice.
    """
    runner = AdaptiveFilter(rig, compiled, trace=True, name="adaptive, smoothed")
    samples = samples_of(log, runner.channels, runner.name)
    belief = runner.initial(log.time[0], first_values(samples))
    rows, last = runner.checked_rows(belief, log.time, samples)
    carries, ys = advance(runner.kernel, Feed(belief.carry, rows, runner.numbers))
    n, m, joints = belief.size, len(runner.measured), tuple(joint.name for joint in rig.joints)
    if len(out_of_bounds(mean_of(carries, n), variances_of(carries, n), len(joints))):
        raise EstimationError(f"{log.source}: the filter left all bounds; check the units of the log and the rig")
    means, covariances = mean_of(carries, n).copy(), covariance_of(carries, n).copy()
    predicted, rest = ys[:, 2 * m : 2 * m + n], ys[:, 2 * m + n :].reshape(-1, 2, n, n)
    # columns lie one after the other: a covariance is symmetric, a transition is turned round
    uncertain, transitions = rest[:, 0], np.swapaxes(rest[:, 1], 1, 2)
    # each state in its own prior std, so that the inverse is well scaled
    scale = np.maximum(runner.states.stds, 1e-12)
    # with a share of the gain its equations do not hold: such states stay as the filter had them
    slow = list(runner.states.slow)
    unsmoothed, quick = [*runner.states.unsmoothed, *slow], np.setdiff1d(np.arange(n), slow)
    for k in range(len(rows) - 2, -1, -1):
        transition, before = transitions[k + 1], covariances[k]
        ahead = uncertain[k + 1] / np.outer(scale, scale)
        cross = (before @ transition.T) / scale
        gain = np.zeros((n, n))
        gain[:, quick] = (
            np.linalg.lstsq(ahead[np.ix_(quick, quick)], cross[:, quick].T, rcond=1e-12)[0].T / scale[quick]
        )
        gain[unsmoothed] = 0.0
        means[k] += gain @ (means[k + 1] - predicted[k + 1])
        process = uncertain[k + 1] - transition @ before @ transition.T
        left = np.eye(n) - gain @ transition
        smoothed = left @ before @ left.T + gain @ (covariances[k + 1] + process) @ gain.T
        covariances[k] = (smoothed + smoothed.T) / 2
    if rig.discrepancy is not None:
        correct(means, covariances, log, rig, compiled, last)
    values, variances = runner.innovations_of(ys[last], samples)
    prior_means, prior_stds = priors_of(runner)
    return Estimate(
        runner.name,
        rig.name,
        log.time,
        runner.state_names,
        frozen(means[last]),
        frozen(np.einsum("kii->ki", covariances[last])),
        runner.measured,
        frozen(values),
        frozen(variances),
        truths=true_angles(log, joints),
        covariances=frozen(covariances[last]),
        joint_names=joints,
        prior_means=prior_means,
        prior_stds=prior_stds,
        stamps=log.stamps,
        state_kinds=runner.state_kinds,
        state_parts=runner.state_parts,
        state_units=state_units(runner),
    )


def correct(means: Floats, covariances: Floats, log: Log, rig: Rig, compiled: bool, last: NDArray[np.intp]) -> None:
    """Add the correction by the rig's discrepancy, which depends on the readings alone, to a smoothed estimate.

    Args:
        means: to change, of all rows, (k, n).
        covariances: to change, (k, n, n).
        rig: with a discrepancy.
        compiled: compile the kernel where possible.
        last: each sample's own row.
    """
    runner = AdaptiveFilter(rig, compiled)
    samples = samples_of(log, runner.channels, runner.name)
    belief = runner.initial(log.time[0], first_values(samples))
    carries, ys = runner.advanced(belief, log.time, samples)
    states, report = carries[:, : means.shape[1]], runner.report.only(range(len(rig.joints)))
    means[last] += report.means(states, ys) - states
    covariances[last] = report.covariances(covariances[last], ys)
