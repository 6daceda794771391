"""The state in which a filter begins a run after its homing move."""

from __future__ import annotations

from dataclasses import dataclass

from distal.arrays import Floats
from distal.estimators import AdaptiveFilter, Belief
from distal.homing.apply import calibrate_torque, calibrated, homing_prior
from distal.homing.window import Window
from distal.logs import Log
from distal.threads import one_blas_thread


@dataclass(frozen=True)
class Homed:
    """A run after its homing move.

    Args:
        estimator: the filter with the maps of this run.
        start: its first belief.
        samples: values of its channels, (k, n_channels).
    """

    estimator: AdaptiveFilter
    start: Belief
    samples: Floats


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

    If the rig has maps of the angles, the move conditions them. Else the filter reads the reference
    in the window.

    Args:
        estimator: the filter, whose channels contain the reference.
        start: its belief before the first sample.
        log: the whole run.
        samples: values of its channels, with the reference only in the window, (k, n_channels).
        truths: true angles [rad], NaN where not known, (k, n_joints).
        homing: length of the window [s].
    """
    if estimator.maps.filter:
        estimator, samples = calibrated(estimator, start, log, samples, truths, homing)
        begun = start
    else:
        begun = homing_prior(Window.of(estimator, start, log, samples, truths, homing))
    if estimator.maps.torque:
        estimator = calibrate_torque(estimator, log, samples, homing)
    return Homed(estimator, begun, samples)
