"""Homing of a filter: the homing move adapts first the parameters of the rig, then the learned maps
that correct the model's error.
"""

from __future__ import annotations

import numpy as np

from distal.arrays import Floats
from distal.estimators import AdaptiveFilter, Belief, of_part
from distal.homing.most_likely import most_likely_start
from distal.homing.window import Window
from distal.kernels import covariance_of, mean_of, variances_of
from distal.logs import Log, true_torques
from distal.regression import Samples, given

ASTRAY = 1.5
"""Limit of the mean e²/P of the angle over the window without reference [1]; beyond it the filter's
parameters are not used. Source: judgement.
"""


def plain_samples(
    estimator: AdaptiveFilter, start: Belief, log: Log, samples: Floats, truths: Floats
) -> Samples:
    """Return the readings of a filter over a log, the filter's own angles, and the errors of these,
    true minus estimated.

    Args:
        estimator: the filter; the angles are those before its maps correct them.
        start: belief before the first sample.
        log: with its stamps.
        samples: values of the channels, (k, n_channels).
        truths: true angles [rad], NaN where not known, (k, n_joints).
    """
    kernel_states = estimator.advanced(start, log.time, samples).kernel_states
    nj = truths.shape[1]
    n = start.size
    angles = mean_of(kernel_states, n)[:, :nj].copy()
    variances = variances_of(kernel_states, n)[:, :nj].copy()
    # a map reads the positions of drives as the filter tracks them, while they are read
    readings = [
        column if at is None else np.where(np.isfinite(column), kernel_states[:, at], np.nan)
        for column, at in zip(samples.T, estimator.positions)
    ]
    since = log.time - log.time[0]
    return Samples(log.source, since, np.column_stack(readings), angles, truths - angles, variances)


def homing_prior(window: Window) -> Belief:
    """Return the first belief of a filter that reads the reference over the window.

    It is the filter's usual prior, if the filter then finds parameters with which its angle stays
    in its band over the window. Else the parameters and their covariance are those of
    `most_likely_start`.
    """
    return window.start if is_followed(window) else most_likely_start(window)


def is_followed(window: Window) -> bool:
    """Return whether the filter, which reads the reference over the window, finds parameters with
    which its angle stays in its band there without the reference.
    """
    done = window.scan(window.start.kernel_state, window.samples)
    if done is None:
        return False
    lasting = np.flatnonzero(window.estimator.states.lasting)
    after = done[0][-1]
    kernel_state = window.start.kernel_state.copy()
    kernel_state[lasting] = after[lasting]
    square = np.ix_(lasting, lasting)
    n = window.start.size
    covariance_of(kernel_state, n)[square] = covariance_of(after, n)[square]
    return window.within(kernel_state, ASTRAY)


def calibrated(
    estimator: AdaptiveFilter,
    start: Belief,
    log: Log,
    samples: Floats,
    truths: Floats,
    homing: float,
) -> tuple[AdaptiveFilter, Floats]:
    """Return filter and samples of a run whose rig has maps of the angles.

    The run itself reads no reference. Its errors of the angle in the window, the first `homing` s,
    condition the maps. The `samples` and `truths` are as for `home`.
    """
    unaided = samples.copy()
    unaided[:, len(estimator.positions) :] = np.nan
    early = log.time - log.time[0] < homing
    plain = plain_samples(estimator, start, log, unaided, truths)
    names = estimator.channels[: len(estimator.positions)]
    after = tuple(
        given(
            learned, of_part(plain, estimator.rig, names, learned.joints, learned.channels), early
        )
        for learned in estimator.maps.filter
    )
    maps = estimator.maps.model_copy(update={"filter": after})
    return estimator.with_maps(maps), unaided


def calibrate_torque(
    estimator: AdaptiveFilter, log: Log, samples: Floats, homing: float
) -> AdaptiveFilter:
    """Return the filter with its maps of the torque conditioned on the true torques in the window;
    unchanged if the log has none.

    The window is the first `homing` s of the log; `samples` are the values of the channels, (k,
    n_channels).
    """
    torques = true_torques(log, estimator.rig.joint_names)
    if torques is None:
        return estimator
    early = log.time - log.time[0] < homing
    names = estimator.channels[: len(estimator.positions)]
    plain = torque_samples(log, samples[:, : len(names)], torques)
    after = tuple(
        given(
            learned, of_part(plain, estimator.rig, names, learned.joints, learned.channels), early
        )
        for learned in estimator.maps.torque
    )
    return estimator.with_maps(estimator.maps.model_copy(update={"torque": after}))


def torque_samples(log: Log, readings: Floats, torques: Floats) -> Samples:
    """Return the samples of a map of the torque over a log.

    Args:
        log: with its stamps.
        readings: of the sensors, NaN where missing, (k, m).
        torques: true external torques [N m], NaN where not known, (k, n_joints).
    """
    none = np.zeros((len(log), 0))
    since = log.time - log.time[0]
    return Samples(log.source, since, readings, none, torques, np.zeros(torques.shape))
