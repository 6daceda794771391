"""The state in which a filter begins a run after its homing move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from distal.arrays import Floats
from distal.estimators import AdaptiveFilter, Belief
from distal.homing.apply import calibrate_contact, calibrated, homing_prior
from distal.homing.least_squares import led_astray, with_straight_line
from distal.homing.window import Window
from distal.logs import Log
from distal.threads import one_blas_thread

ASTRAY_NOTE = (
    "on the second half of the homing move the filter erred {} and least squares from the first "
    "half clearly less: the "
    "rig is described wrong, so the angle is taken from least squares on the whole move (affine)"
)


@dataclass(frozen=True)
class Homed:
    """A run after its homing move: the filter with the maps of this run, its first belief, and
    values of its channels.

    The notes say how the move was used.
    """

    estimator: AdaptiveFilter
    start: Belief
    samples: Floats
    notes: tuple[str, ...] = ()


@one_blas_thread()
def home(
    estimator: AdaptiveFilter,
    start: Belief,
    log: Log,
    samples: Floats,
    truths: Floats,
    homing: float,
) -> Homed:
    """Return filter, first belief and samples of a run, adapted by its homing move of `homing` s.

    With a discrepancy the move corrects it. Else the filter reads the reference; where least
    squares does clearly better within the move, that is reported. The filter's `samples`, (k,
    n_channels), have the reference within the window; `truths` are the true angles [rad], NaN where
    not known, (k, n_joints).
    """
    notes = tuple[str, ...]()
    if estimator.discrepancy is not None:
        estimator, begun, samples, _ = calibrated(estimator, start, log, samples, truths, homing)
    else:
        begun = homing_prior(Window.of(estimator, start, log, samples, truths, homing))
        errs = led_astray(estimator, start, log, samples, truths, homing)
        if errs is not None:
            estimator, begun = with_straight_line(estimator, begun, log, samples, homing)
            erred = ", ".join(f"{np.rad2deg(size):.1f}°" for size in errs if np.isfinite(size))
            notes = (ASTRAY_NOTE.format(f"by {erred}" if erred else "without bounds"),)
    if estimator.contact is not None:
        estimator = calibrate_contact(estimator, log, samples, homing)
    return Homed(estimator, begun, samples, notes)
