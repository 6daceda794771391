"""Homing of a filter: the homing move adapts first the parameters of the rig, then the learned maps
that correct the model's error.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from distal.arrays import Floats
from distal.estimators import AdaptiveFilter, Belief
from distal.homing.most_likely import (
    INDEPENDENT,
    INDEPENDENT_CORRECTED,
    SHARE_CORRECTED,
    most_likely_start,
)
from distal.homing.window import Window
from distal.kernels import covariance_of, mean_of, variances_of
from distal.logs import Log, frozen, true_torques
from distal.regression import Samples, calibrate_window
from distal.rig import Rig
from distal.sensor_errors import position_offsets

PASSES = 2
"""Number of times that the window is filtered [1]: each pass begins with the parameters found by
the last one, and with their prior stds. Source: judgement.
"""

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
    tracked = estimator.discrepancy is None or estimator.discrepancy.tracked
    columns = zip(samples.T, estimator.positions)
    readings = [
        kernel_states[:, at] if tracked and at is not None else held(column)
        for column, at in columns
    ]
    interval = float(np.median(np.diff(log.time))) if len(log) > 1 else 1.0
    since = log.time - log.time[0]
    return Samples(
        log.source, since, np.column_stack(readings), angles, truths - angles, variances, interval
    )


def held(values: Floats) -> Floats:
    """Return `values`, (k,), with each missing one replaced by the last finite one before it, or at
    the beginning by the first finite one.
    """
    is_finite = np.isfinite(values)
    last = np.maximum.accumulate(np.where(is_finite, np.arange(len(values)), -1))
    filled: Floats = values[np.where(last >= 0, last, int(np.argmax(is_finite)))]
    return filled


def parameters_homed(window: Window) -> Belief:
    """Return a belief before the first sample with the rig's parameters as a homing move shows
    them.

    They are those that the filter finds, if its angle then stays in its band over the window, else
    those of `most_likely_start`. A learned map corrects the remaining error.
    """
    filtered = parameters_filtered(window)
    if filtered is not None:
        return filtered
    return most_likely_start(window, errors_last(float(window.time[-1] - window.time[0])))


def errors_last(length: float) -> float:
    """Return the time for which errors are assumed to last [s], in a window of `length` s, where a
    learned map corrects the angle afterwards.
    """
    return max(INDEPENDENT, min(INDEPENDENT_CORRECTED, SHARE_CORRECTED * length))


def homing_prior(window: Window) -> Belief:
    """Return the first belief of a filter that reads the reference over the window.

    It is the filter's usual prior, if the filter then finds parameters with which its angle stays
    in its band over the window. Else the parameters and their covariance are those of
    `most_likely_start`.
    """
    return (
        window.start
        if parameters_filtered(window, passes=1) is not None
        else most_likely_start(window)
    )


def parameters_filtered(window: Window, passes: int = PASSES) -> Belief | None:
    """Return a belief before the first sample with the parameters that the filter finds; None if
    its angle leaves its band.

    The filter reads the reference over the window in each of the `passes`. Each pass begins with
    the parameters found by the last one, so that it linearises there, and with their prior
    covariance; their returned covariance is that after the last pass. Then the filter runs without
    the reference, and its angle must stay in its band.
    """
    estimator = window.estimator
    start = window.start
    lasting = np.flatnonzero(estimator.states.lasting)
    n = start.size
    kernel_state = start.kernel_state.copy()
    after = start.kernel_state
    for _ in range(passes):
        done = window.scan(kernel_state, window.samples)
        if done is None:
            return None
        after = done[0][-1]
        kernel_state = start.kernel_state.copy()
        kernel_state[lasting] = after[lasting]
    square = np.ix_(lasting, lasting)
    covariance_of(kernel_state, n)[square] = covariance_of(after, n)[square]
    return (
        Belief(start.time, frozen(kernel_state), n) if window.within(kernel_state, ASTRAY) else None
    )


def calibrated(
    estimator: AdaptiveFilter,
    start: Belief,
    log: Log,
    samples: Floats,
    truths: Floats,
    homing: float,
) -> tuple[AdaptiveFilter, Belief, Floats, float]:
    """Return filter, first belief and samples of a run whose rig has a discrepancy, and how
    surprising its homing move was.

    The run itself reads no reference. The window, the first `homing` s, gives the parameters of the
    rig; its remaining errors of the angle correct the discrepancy. The `samples` and `truths` are
    as for `home`.
    """
    assert estimator.discrepancy is not None
    begun = parameters_homed(Window.of(estimator, start, log, samples, truths, homing))
    unaided = samples.copy()
    unaided[:, len(estimator.discrepancy.channels) :] = np.nan
    early = log.time - log.time[0] < homing
    plain = plain_samples(estimator, begun, log, unaided, np.where(early[:, None], truths, np.nan))
    discrepancy, surprise = calibrate_window(estimator.discrepancy, plain, early)
    return estimator.with_map(discrepancy), begun, unaided, surprise


def calibrate_contact(
    estimator: AdaptiveFilter, log: Log, samples: Floats, homing: float
) -> AdaptiveFilter:
    """Return the filter with its contact map corrected by the true torques in the window; unchanged
    if the log has none.

    The window is the first `homing` s of the log; `samples` are the values of the channels, (k,
    n_channels).
    """
    learned = estimator.contact
    assert learned is not None
    torques = true_torques(log, estimator.rig.joint_names)
    if torques is None:
        return estimator
    window = log.time - log.time[0] < homing
    channels = {name: samples[:, i] for i, name in enumerate(learned.channels)}
    contact, _ = calibrate_window(
        learned, torque_samples(log, estimator.rig, channels, torques), window
    )
    return estimator.with_map(contact)


def torque_samples(log: Log, rig: Rig, channels: Mapping[str, Floats], torques: Floats) -> Samples:
    """Return the inputs of a contact map over a log, and the true torques.

    Args:
        log: with its stamps.
        rig: whose known offsets are subtracted from the readings.
        channels: channel → its readings, (k,), in the order of the map; missing ones are held.
        torques: true external torques [N m], NaN where not known, (k, n_joints).
    """
    readings = [
        held(values) - offset
        for values, offset in zip(channels.values(), position_offsets(rig, list(channels)))
    ]
    interval = float(np.median(np.diff(log.time))) if len(log) > 1 else 1.0
    none = np.zeros((len(log), 0))
    since = log.time - log.time[0]
    return Samples(
        log.source,
        since,
        np.column_stack(readings),
        none,
        torques,
        np.zeros(torques.shape),
        interval,
    )
