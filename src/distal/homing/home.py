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
"""The note on an estimate whose angle least squares gives; the braces hold the filter's error."""


@dataclass(frozen=True)
class Homed:
    """A run after its homing move.

    Args:
        estimator: the filter with the maps of this run.
        start: its first belief.
        samples: values of its channels, (k, n_channels).
        notes: sentences on how the move was used.
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
    """Return filter, first belief and samples of a run, adapted by its homing move.

    If the rig has a discrepancy, the move corrects it. Else the filter reads the reference in the
    window; where least squares does clearly better on the move, it gives the reported angle.

    Args:
        estimator: the filter, whose channels contain the reference.
        start: its belief before the first sample.
        log: the whole run.
        samples: values of its channels, with the reference only in the window, (k, n_channels).
        truths: true angles [rad], NaN where not known, (k, n_joints).
        homing: length of the window [s].
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
