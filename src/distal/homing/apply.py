"""Homing with a discrepancy: the homing move adapts first the rig's numbers, then the error that
the model leaves.
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
"""How often the window is filtered: each pass begins with the numbers of the last one, and with
their prior stds.
"""

ASTRAY = 1.5
"""Limit of the mean e²/P of the angle without reference over the window; beyond it the filter's
numbers are not used.
"""


def plain_samples(
    estimator: AdaptiveFilter, start: Belief, log: Log, samples: Floats, truths: Floats
) -> Samples:
    """Return the readings of a filter over a log, its own angles, and true minus own angles.

    It begins with the belief before the first sample and reads `samples`, (k, n_channels); `truths`
    are the true angles [rad], NaN where not known, (k, n_joints).
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
    """Return `values`, (k,), each missing one replaced by the last before it, the first ones by the
    first finite one.
    """
    is_finite = np.isfinite(values)
    last = np.maximum.accumulate(np.where(is_finite, np.arange(len(values)), -1))
    filled: Floats = values[np.where(last >= 0, last, int(np.argmax(is_finite)))]
    return filled


def parameters_homed(window: Window) -> Belief:
    """Return a belief before the first sample with the rig's numbers as found by a homing move.

    They are the filter's own if its angle stays in its band with them, else the `most_likely`. A
    learned map corrects the remaining error.
    """
    filtered = parameters_filtered(window)
    if filtered is not None:
        return filtered
    return most_likely_start(window, errors_last(float(window.time[-1] - window.time[0])))


def errors_last(length: float) -> float:
    """Return the assumed duration of errors [s] where a learned map corrects the angle after a
    window of `length` s.
    """
    return max(INDEPENDENT, min(INDEPENDENT_CORRECTED, SHARE_CORRECTED * length))


def homing_prior(window: Window) -> Belief:
    """Return the first belief of a filter that reads the reference over the window.

    It is its usual prior if its angle then stays in its band over the window: it learns as it runs.
    Else it begins with the `most_likely` numbers and their covariance.
    """
    return (
        window.start
        if parameters_filtered(window, passes=1) is not None
        else most_likely_start(window)
    )


def parameters_filtered(window: Window, passes: int = PASSES) -> Belief | None:
    """Return a belief before the first sample with the numbers that the filter finds; None if its
    angle leaves its band.

    The filter reads the reference over the window in each pass. The next pass begins with the
    numbers found, so that it linearises at them; their covariance is that after the last. The angle
    must then stay in its band without reference.
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
    """Return filter, first belief and samples of a run after its homing move, and how surprising
    the move was.

    The run itself reads no reference: the discrepancy learns the errors of its angle over the
    window of `homing` s. The `truths` are as for `home`.
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
    """Return a filter with its contact map adapted to this run by the torque in the window, if the
    log has it.

    It reads `samples`, (k, n_channels); the window is the first `homing` s.
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
    """Return the inputs of a contact map over a log: readings less known offsets, missing ones
    held; and true torques.

    The channels, (k,) each, are in the order of the map; `torques` are [N m], NaN where not known,
    (k, n_joints).
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
