"""Compare filter and least squares on a homing move, and report the angle by least squares where it
is clearly better.

Both learn from the first half of the window and are tested on its second half. The rig is described
wrong if the filter's error there is outside its own band and clearly larger than that of the affine
map. Then the affine map that is learned from the whole window gives the reported angle.
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
"""The fields of a map that are in the unit of the readings and contain their offsets."""

FIRST = 0.5
"""Share of the window for learning [1]; the rest is for testing. Source: judgement."""

CLEARLY = 1.5
"""Ratio of two RMS errors from which on one is clearly larger [1]. Source: judgement."""

STILL = np.deg2rad(0.5)
"""A reference that moves less than this is not compared: it gives the zero, but not the slope of an
affine map [rad]. Source: judgement.
"""


def led_astray(
    estimator: AdaptiveFilter,
    start: Belief,
    log: Log,
    samples: Floats,
    truths: Floats,
    homing: float,
) -> Floats | None:
    """Return the RMS errors of the filter on the second half of a homing move [rad], (n_joints,),
    if least squares is clearly better there, else None.

    It is better if `line_is_better`. NaN stands for a joint whose angle is not known there,
    infinity for a filter that diverged. The `samples`, `truths` and `homing` are as for `home`.
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
    and clearly worse for none.

    Args:
        sizes: RMS errors of the filter [rad], NaN where not known, (n_joints,).
        of_line: RMS errors of least squares [rad], (n_joints,).
        surprise: mean e²/P of the filter, (n_joints,).
    """
    astray = (sizes > CLEARLY * of_line) & (surprise > ASTRAY)
    return bool(astray.any() and not np.any(of_line > CLEARLY * sizes))


def with_straight_line(
    estimator: AdaptiveFilter, begun: Belief, log: Log, samples: Floats, homing: float
) -> tuple[AdaptiveFilter, Belief]:
    """Return a filter that reports the angle by least squares on a homing move, and its first
    belief.

    Args:
        begun: its belief before the first sample, after the move was used.
        log: the whole run.
        samples: values of its channels, (k, n_channels).
        homing: length of the move [s].
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
    """Return the affine map of a window, by least squares alone or as a correction of the one in
    the rig file.
    """
    if rig.affine is not None and rig.affine.channels != channels_of(rig, "affine").names:
        rig = rig.model_copy(update={"affine": None})  # learned from other sensors
    line = AffineEstimator(rig, False, homing=True).after_homing(log, homing).affine
    assert line is not None
    return line
