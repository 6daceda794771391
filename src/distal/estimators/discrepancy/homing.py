"""A discrepancy after a homing move: this run's coefficients, by Bayes' rule."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from distal.estimators.affine import after_window
from distal.estimators.discrepancy.samples import Samples, design
from distal.rig import Discrepancy

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def homed(discrepancy: Discrepancy, samples: Samples, window: Bools) -> tuple[Discrepancy, float]:
    """Return a discrepancy after a homing move, and how surprising the move was in standard deviations.

    Mean and covariance are the prior of this run's coefficients, the window their likelihood, with as many samples
    counting as one as what is left is correlated. A move that is far off widens the prior, see `after_window`.

    Args:
        discrepancy: as learned from logs.
        samples: of the run, whole.
        window: where the angle is known, (k,).
    """
    phi, joints, worst = design(discrepancy, samples), [], 0.0
    for j, joint in enumerate(discrepancy.joints):
        there = window & np.isfinite(samples.truths[:, j])
        if not there.any():
            joints.append(joint)
            continue
        x, y = phi[there], samples.truths[there, j] - samples.angles[there, j]
        count = max(discrepancy.correlation_time / samples.interval, 1.0)
        after, off = after_window(joint, x, y, count, discrepancy.logs)
        joints.append(after)
        worst = max(worst, off)
    return discrepancy.model_copy(update={"joints": tuple(joints)}), worst
