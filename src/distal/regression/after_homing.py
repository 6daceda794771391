"""The update of a learned map by a homing move: the run's own coefficients, by Bayes' rule."""

from __future__ import annotations

import numpy as np

from distal.arrays import Bools, Floats
from distal.regression.features import Samples, design, squared_distances
from distal.regression.random_effects import (
    correlated_samples,
    posterior_of,
    row_of,
    rows_of_groups,
    surprise,
)
from distal.rig import JointMap, LearnedMap

ANYWHERE = (-1e9, 1e9)
"""Lowest and highest angle of a joint without bounds [rad]: no joint gets so far. Source:
judgement.
"""

EXPECTED = 3.0
"""RMS deviation of a homing move's coefficients from the stored map, in the map's standard
deviations, above which the map's covariance is widened. Source: judgement.
"""


def calibrate_window(
    learned: LearnedMap, samples: Samples, window: Bools, by_motion: bool = False
) -> tuple[LearnedMap, float]:
    """Return a map updated by a window in which its target was known, and how far the window's
    coefficients were from the map's, in standard deviations.

    The map's mean and covariance are the prior of this run's coefficients; the samples of the
    `window`, (k,), give the likelihood. Residuals are correlated, so that several samples count as
    one: for the map's correlation time, and with `by_motion` for at least that of the mapped value,
    since an error that depends on the position repeats with it. A window that is further off than
    `EXPECTED` widens the prior.
    """
    phi = design(learned, samples)
    joints = []
    worst = 0.0
    for j, joint in enumerate(learned.joints):
        rows = window & np.isfinite(samples.targets[:, j])
        if not rows.any():
            joints.append(joint)
            continue
        x = phi[rows]
        y = samples.targets[rows, j]
        count = max(learned.correlation_time / samples.interval, 1.0)
        if by_motion:
            count = max(count, correlated_samples(x @ np.asarray(joint.coefficients)))
        after, off = _after_window(joint, x, y, count, learned.logs)
        joints.append(after)
        worst = max(worst, off)
    return learned.model_copy(
        update={"joints": tuple(joints), "homed": _covered(learned, samples, window)}
    ), worst


def _covered(
    learned: LearnedMap, samples: Samples, window: Bools
) -> tuple[tuple[float, float], ...]:
    """Return the lowest and highest true value of each joint in a window, `ANYWHERE` for a joint
    that is not known there.
    """
    masks = [window & np.isfinite(target) for target in samples.targets.T]
    truths = (samples.targets + samples.angles if learned.uses_angles else samples.targets).T
    inside = [truth[mask] for truth, mask in zip(truths, masks)]
    return tuple(
        (float(truth.min()), float(truth.max())) if len(truth) else ANYWHERE for truth in inside
    )


def seen(learned: LearnedMap, samples: Samples) -> LearnedMap:
    """Return a map whose learned range is extended to the readings and angles of some samples."""
    every = samples.every[:, : len(learned.centre)]
    changes = {
        "low": row_of(np.minimum(learned.low, every.min(axis=0))),
        "high": row_of(np.maximum(learned.high, every.max(axis=0))),
        "reach": max(
            learned.reach, float(np.sqrt(np.max(squared_distances(learned, samples), initial=0.0)))
        ),
    }
    return learned.model_copy(update=changes)


def _after_window(
    joint: JointMap, x: Floats, y: Floats, count: float, logs: int
) -> tuple[JointMap, float]:
    """Return a joint's coefficients after a window, and how far the window's own were from them
    before, in standard deviations.

    The window has the design `x`, (k, n), and targets `y`, (k,), of which `count` count as one; the
    prior was learned from `logs` logs.
    """
    mean = np.asarray(joint.coefficients)
    covariance = np.asarray(joint.covariance)
    gram = x.T @ x
    moment = x.T @ y
    spread = joint.std**2 * count
    ratio = surprise(mean, covariance, gram, moment, spread) / max(
        int(np.count_nonzero(np.diag(covariance))), 1
    )
    if ratio > EXPECTED**2:
        covariance = covariance * ratio
    after, left = posterior_of(mean, covariance, gram, moment, spread)
    residual = y - x @ after
    # a residual that is larger than in the logs before it is this log's own
    square = float(np.mean(residual**2))
    independent = len(y) / max(count, correlated_samples(residual))
    weight = max(logs, 1)
    std = float(
        np.sqrt(
            max(
                joint.std**2,
                (weight * joint.std**2 + independent * square) / (weight + independent),
            )
        )
    )
    changed = JointMap(
        joint=joint.joint, coefficients=row_of(after), covariance=rows_of_groups(left), std=std
    )
    return changed, float(np.sqrt(ratio))
