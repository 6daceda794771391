"""A discrepancy after a homing move: this run's coefficients, by Bayes' rule."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from distal.estimators.affine import correlated_samples, surprise, updated
from distal.estimators.discrepancy.samples import Samples, design
from distal.rig import AffineJoint, Discrepancy

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

EXPECTED = 3.0
"""A homing move whose coefficients are this many standard deviations off widens what was learned."""


def homed(discrepancy: Discrepancy, samples: Samples, window: Bools) -> tuple[Discrepancy, float]:
    """Return a discrepancy after a homing move, and how surprising the move was in standard deviations.

    Mean and covariance are the prior of this run's coefficients, the window their likelihood, with as many samples
    counting as one as what is left is correlated. Where the move is further off than `EXPECTED`, the prior is widened.

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
        mean, covariance = np.asarray(joint.coefficients), np.asarray(joint.covariance)
        count = max(discrepancy.correlation_time / samples.interval, 1.0)
        gram, moment, spread = x.T @ x, x.T @ y, joint.std**2 * count
        ratio = surprise(mean, covariance, gram, moment, spread) / max(int(np.count_nonzero(np.diag(covariance))), 1)
        worst = max(worst, float(np.sqrt(ratio)))
        if ratio > EXPECTED**2:
            covariance = covariance * ratio
        after, left = updated(mean, covariance, gram, moment, spread)
        rest = y - x @ after
        # what this run leaves beyond the logs before it is its own
        own, independent = float(np.mean(rest**2)), len(y) / max(count, correlated_samples(rest))
        weight = max(discrepancy.logs, 1)
        std = float(np.sqrt(max(joint.std**2, (weight * joint.std**2 + independent * own) / (weight + independent))))
        joints.append(
            AffineJoint(
                joint=joint.joint,
                coefficients=tuple(map(float, after)),
                covariance=tuple(tuple(map(float, row)) for row in left),
                std=std,
            )
        )
    return discrepancy.model_copy(update={"joints": tuple(joints)}), worst
