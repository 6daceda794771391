"""A map from a homing move: learned from it alone, or a stored one corrected by it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from distal.errors import EstimationError
from distal.estimators.affine.mapping import design, frame, rows
from distal.estimators.affine.readings import Readings
from distal.estimators.affine.regression import correlated_samples, line, surprise, updated
from distal.rig import Affine, AffineJoint, Rig

Floats = NDArray[np.float64]

NORMAL = 1.959963984540054
"""The 97.5 % quantile of the normal distribution."""

EXPECTED = 3.0
"""A homing move whose coefficients are this many standard deviations off widens what the stored map said."""


def student(freedom: float) -> float:
    """Return by what a 95 % band is wider that knows its std from so many degrees of freedom: t_{0.975}/1.96.

    Args:
        freedom: degrees of freedom.
    """
    from scipy.special import stdtrit  # loaded late: it takes as long as all of distal

    return float(stdtrit(max(freedom, 1.0), 0.975)) / NORMAL


def learned_alone(readings: Readings, rig: Rig, bands: Sequence[float]) -> Affine:
    """Return the map of a homing move alone: least squares over its window, without directions.

    The window's residuals are correlated: N samples count as one, so k samples tell as much as k/N, and the band is that
    of Student's distribution with the k/N − n degrees of freedom that n coefficients leave.

    Args:
        readings: of the window.
        rig: the description.
        bands: half-width of the play of each position sensor [SI].

    Raises:
        EstimationError: the window has too few samples.
    """
    made, kept = frame([readings], rig, bands)
    columns = [0, *(1 + np.flatnonzero(kept))]
    joints, longest = [], 1.0
    for j, joint in enumerate(made.joints):
        there = np.isfinite(readings.angles[:, j])
        needed = len(columns) + 2
        if there.sum() < needed:
            raise EstimationError(
                f"{readings.source}: the homing window has {int(there.sum())} samples with a reference, affine needs "
                f"{needed} or more; home for longer, or learn from logs (distal fit)"
            )
        found = line(design(made, readings)[np.ix_(there, columns)], readings.angles[there, j])
        wider = student(found.freedom)
        joints.append(filled(joint, columns, found.coefficients, wider**2 * found.covariance, wider * found.std))
        longest = max(longest, found.correlated)
    return made.model_copy(update={"joints": tuple(joints), "logs": 0, "correlation_time": longest * readings.interval})


def filled(joint: AffineJoint, columns: Sequence[int], mean: Floats, covariance: Floats, std: float) -> AffineJoint:
    """Return a joint's map with some of its coefficients; the others are zero for certain.

    Args:
        joint: whose.
        columns: which coefficients, (n,).
        mean: theirs [rad], (n,).
        covariance: theirs [rad²], (n, n).
        std: of the residual [rad].
    """
    size = len(joint.coefficients)
    whole, square = np.zeros(size), np.zeros((size, size))
    whole[list(columns)] = mean
    square[np.ix_(columns, columns)] = covariance
    return AffineJoint(joint=joint.joint, coefficients=rows(whole[None])[0], covariance=rows(square), std=float(std))


def after_window(joint: AffineJoint, x: Floats, y: Floats, count: float, logs: int) -> tuple[AffineJoint, float]:
    """Return a joint's coefficients after a window of samples, by Bayes' rule, and how surprising it was in stds.

    Args:
        joint: mean and covariance before, the prior.
        x: columns in the window, (k, n).
        y: what they are to give [rad], (k,).
        count: how many samples count as one.
        logs: how many logs the prior was learned from.
    """
    mean, covariance = np.asarray(joint.coefficients), np.asarray(joint.covariance)
    gram, moment, spread = x.T @ x, x.T @ y, joint.std**2 * count
    ratio = surprise(mean, covariance, gram, moment, spread) / max(int(np.count_nonzero(np.diag(covariance))), 1)
    if ratio > EXPECTED**2:
        covariance = covariance * ratio
    after, left = updated(mean, covariance, gram, moment, spread)
    rest = y - x @ after
    # what this log leaves beyond the logs before it is its own
    own, independent = float(np.mean(rest**2)), len(y) / max(count, correlated_samples(rest))
    weight = max(logs, 1)
    std = float(np.sqrt(max(joint.std**2, (weight * joint.std**2 + independent * own) / (weight + independent))))
    made = AffineJoint(joint=joint.joint, coefficients=rows(after[None])[0], covariance=rows(left), std=std)
    return made, float(np.sqrt(ratio))


def corrected(affine: Affine, readings: Readings, rig: Rig) -> tuple[Affine, float]:
    """Return a stored map after a homing move, and how surprising the move was in standard deviations.

    The stored mean and covariance are the prior of this log's coefficients, the window their likelihood (Bayes' rule for
    Gaussians), with as many samples counting as one as the logs' residuals, or the motion in the window, are correlated:
    what least squares errs by depends on the place, and one slow sweep shows it once. Where the move is further off
    than `EXPECTED`, the prior is widened until it is not.

    Args:
        affine: as learned from logs.
        readings: of the window.
        rig: the description.
    """
    joints, worst = [], 0.0
    columns = design(affine, readings)
    for j, joint in enumerate(affine.joints):
        there = np.isfinite(readings.angles[:, j])
        if not there.any():
            joints.append(joint)
            continue
        x, y = columns[there], readings.angles[there, j]
        # errors that depend on the place repeat with the motion: they last as long as it does
        count = max(affine.correlation_time / readings.interval, correlated_samples(x @ np.asarray(joint.coefficients)))
        after, off = after_window(joint, x, y, count, affine.logs)
        joints.append(after)
        worst = max(worst, off)
    values = readings.values
    z = (values - np.asarray(affine.centre)) / np.asarray(affine.scale)
    far = float(np.sqrt(np.max(np.sum(z @ np.asarray(affine.distance) * z, axis=1), initial=0.0)))
    changes = {
        "joints": tuple(joints),
        "low": rows(np.minimum(affine.low, values.min(axis=0))[None])[0],
        "high": rows(np.maximum(affine.high, values.max(axis=0))[None])[0],
        "reach": max(affine.reach, far),
    }
    return affine.model_copy(update=changes), worst
