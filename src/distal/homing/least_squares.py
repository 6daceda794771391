"""Find whether a homing move gives the filter wrong numbers, by least squares on the same window,
and then report that.

Both learn from the first half of the window and are tested on the second half. If there the
filter's error is outside its own band and larger than that of a straight line, although its numbers
fit the first half, the rig is described wrong. Its angle is then reported by the straight line of
the whole window.
"""

from __future__ import annotations

import numpy as np

from distal.arrays import Floats
from distal.errors import EstimationError
from distal.estimators import (
    AdaptiveFilter,
    AffineEstimator,
    Belief,
    affine_samples,
    channels_of,
    first_values,
)
from distal.estimators.adaptive.filter_function import adaptive_layout
from distal.homing.apply import ASTRAY, homing_prior
from distal.homing.window import Window
from distal.logs import Log, frozen
from distal.regression import predict
from distal.regression.random_effects import row_of
from distal.rig import Affine, Rig
from distal.sensor_errors import position_offsets

SHIFTED = ("centre", "low", "high")
"""The fields of a map in the unit of the readings, with their offsets."""

FIRST = 0.5
"""Share of the window for learning; the rest is for testing."""

CLEARLY = 1.5
"""Least squares is used if the filter's error on the rest of the window is this many times larger.
"""

STILL = np.deg2rad(0.5)
"""A reference that moves less than this gives the zero, but not the slope of a straight line [rad].
"""


def led_astray(
    estimator: AdaptiveFilter,
    start: Belief,
    log: Log,
    samples: Floats,
    truths: Floats,
    homing: float,
) -> Floats | None:
    """Return the RMS error of the filter on the second half of a homing move [rad], (n_joints,), if
    it was led astray.

    It was if for some joint its error is outside its band and clearly larger than that of least
    squares, and for no joint least squares is clearly worse. NaN stands for a joint that is not
    known there, infinity for a filter that diverged. The arguments `samples`, `truths` and `homing`
    are as for `home`.
    """
    since = log.time - log.time[0]
    until = int(np.searchsorted(since, homing))
    late = since[:until] >= FIRST * homing
    half = samples[:until].copy()
    half[late, len(estimator.positions) :] = np.nan
    try:
        line = _line(estimator.rig, log, FIRST * homing)
        straight = affine_samples(log, estimator.rig)
    except EstimationError:
        return None  # too few samples, of a sensor or of a joint's truth, for a straight line
    begun = homing_prior(Window.of(estimator, start, log, half, truths, FIRST * homing))
    window = Window(estimator, begun, log.time[:until], half, truths[:until])
    done = window.scan(begun.kernel_state, half)
    if done is None:
        return np.full(truths.shape[1], np.inf)
    errors, variances = window.errors(done[0])
    sizes, of_line, surprise = (np.full(errors.shape[1], np.nan) for _ in range(3))
    for j, error in enumerate(errors.T):
        compared = late & np.isfinite(error)
        reference = truths[:until, j][np.isfinite(truths[:until, j])]
        if not compared.any() or np.ptp(reference) < STILL:
            continue
        predicted = np.interp(since[:until], straight.time, predict(line, straight, j).values)
        sizes[j] = np.sqrt(np.mean(error[compared] ** 2))
        of_line[j] = np.sqrt(np.mean((truths[:until, j] - predicted)[compared] ** 2))
        surprise[j] = np.mean(error[compared] ** 2 / variances[compared, j])
    return sizes if line_is_better(sizes, of_line, surprise) else None


def line_is_better(sizes: Floats, of_line: Floats, surprise: Floats) -> bool:
    """Return whether least squares is clearly better for a joint whose filter is outside its band,
    and worse for none.

    Of each joint, (n_joints,): RMS errors of the filter, `sizes`, NaN where not known, and
    `of_line` of least squares [rad], and `surprise`, mean e²/P of the filter.
    """
    astray = (sizes > CLEARLY * of_line) & (surprise > ASTRAY)
    return bool(astray.any() and not np.any(of_line > CLEARLY * sizes))


def with_straight_line(
    estimator: AdaptiveFilter, begun: Belief, log: Log, samples: Floats, homing: float
) -> tuple[AdaptiveFilter, Belief]:
    """Return a filter that reports the angle by least squares on a homing move of `homing` s, and
    its first belief.

    It begins as after the move, with the values `samples` of its channels, (k, n_channels).
    """
    line = _line(estimator.rig, log, homing)
    offsets = position_offsets(estimator.rig, line.channels)  # which the filter takes off
    line = line.model_copy(
        update={name: row_of(np.array(getattr(line, name)) - offsets) for name in SHIFTED}
    )
    sensors = {sensor.name: sensor for sensor in estimator.rig.sensors}
    references = [sensors[name] for name in estimator.channels[len(estimator.positions) :]]
    with_line = AdaptiveFilter(estimator.rig, False, references=references, line=line)
    size = adaptive_layout(estimator.states).size
    memory = with_line.initial(begun.time, first_values(samples)).kernel_state[size:]  # of all maps
    return with_line, Belief(
        begun.time, frozen(np.concatenate([begun.kernel_state[:size], memory])), begun.size
    )


def _line(rig: Rig, log: Log, homing: float) -> Affine:
    """Return the straight line of a window, by least squares alone or as a correction of the one in
    the rig file.
    """
    if rig.affine is not None and rig.affine.channels != channels_of(rig, "affine").names:
        rig = rig.model_copy(update={"affine": None})  # learned from other sensors
    line = AffineEstimator(rig, False, homing=True).after_homing(log, homing).affine
    assert line is not None
    return line
