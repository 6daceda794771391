"""A map from several logs: what they have in common, and how it differs from log to log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from distal.errors import EstimationError
from distal.estimators.affine.homing import NORMAL, filled
from distal.estimators.affine.mapping import design, frame
from distal.estimators.affine.readings import Readings
from distal.estimators.affine.regression import SMALLEST_STD, correlated_samples, line, updated
from distal.rig import Affine, AffineJoint, Rig

Floats = NDArray[np.float64]

ITERATIONS = 100
"""Steps of expectation–maximisation for the spread between logs."""


def learned(readings: Sequence[Readings], rig: Rig, bands: Sequence[float], directions: bool) -> Affine:
    """Return the map of some logs: each log's coefficients are drawn from one normal distribution, which is learned.

    y_i = X_i b_i + e_i, b_i ~ N(b, Σ): the random-effects model of Laird and Ware (Biometrics 38, 1982), by
    expectation–maximisation. The next log's coefficients are b with covariance Σ + cov(b); from a single log nothing is
    known of Σ, and the covariance is that of least squares.

    Args:
        readings: of the logs.
        rig: the description.
        bands: half-width of the play of each position sensor [SI].
        directions: whether the directions of motion are columns too.

    Raises:
        EstimationError: a joint's angle is in no log.
    """
    made, kept = frame(readings, rig, bands)
    m = len(kept)
    columns = [0, *(1 + np.flatnonzero(kept)), *(1 + m + np.arange(len(bands)) if directions else [])]
    joints, times = [], []
    for j, joint in enumerate(made.joints):
        parts = []
        for one in readings:
            there = np.isfinite(one.angles[:, j])
            if there.sum() > len(columns):
                parts.append((design(made, one)[np.ix_(there, columns)], one.angles[there, j], one.interval))
        if not parts:
            raise EstimationError(f"affine: the angle of '{joint.joint}' is known in no log; give the truth of one")
        found, time = _joint(joint, columns, parts)
        joints.append(found)
        times.append(time)
    return made.model_copy(update={"joints": tuple(joints), "correlation_time": max(times)})


def _joint(
    joint: AffineJoint, columns: Sequence[int], parts: Sequence[tuple[Floats, Floats, float]]
) -> tuple[AffineJoint, float]:
    """Return the map of one joint and the correlation time of its residuals [s]."""
    if len(parts) == 1:
        only = line(*parts[0][:2])
        return filled(joint, columns, only.coefficients, only.covariance, only.std), only.correlated * parts[0][2]
    grams = [part[0].T @ part[0] for part in parts]
    moments = [part[0].T @ part[1] for part in parts]
    mean = np.linalg.pinv(sum(grams)) @ sum(moments)
    ones = [line(part[0], part[1]) for part in parts]
    lengths = np.array([len(part[1]) for part in parts])
    count = np.array([one.correlated for one in ones])
    std = np.sqrt(max(np.average([one.std**2 for one in ones], weights=lengths), SMALLEST_STD**2))
    spread = _start(parts, mean, std)
    for _ in range(ITERATIONS):
        drawn = [updated(mean, spread, gram, moment, std**2 * own) for gram, moment, own in zip(grams, moments, count)]
        means = np.array([after for after, _ in drawn])
        mean = means.mean(axis=0)
        off = means - mean
        # the mean is of the same logs: one degree of freedom less
        spread = (off.T @ off + sum(left for _, left in drawn)) / (len(parts) - 1)
    spread = _shrunk(spread, len(parts))
    residuals = [part[1] - part[0] @ after for part, after in zip(parts, means)]
    std = max(float(np.sqrt(np.mean(np.concatenate(residuals) ** 2))), SMALLEST_STD)
    times = [correlated_samples(own) * part[2] for own, part in zip(residuals, parts)]
    covariance = spread * (1.0 + 1.0 / len(parts))
    return filled(joint, columns, mean, covariance, std), float(np.mean(times))


def _start(parts: Sequence[tuple[Floats, Floats, float]], mean: Floats, std: float) -> Floats:
    """Return a wide spread to start from: as if every coefficient alone explained what the common map leaves."""
    left = np.concatenate([y - x @ mean for x, y, _ in parts])
    return np.eye(len(mean)) * max(float(np.mean(left**2)), std**2)


def _shrunk(spread: Floats, logs: int) -> Floats:
    """Return the spread with its correlations drawn to zero, the more the fewer logs there are for n of them."""
    share = len(spread) / (len(spread) + logs - 1)
    shrunk: Floats = (1.0 - share) * spread + share * np.diag(np.diag(spread))
    return shrunk


def sized(affine: Affine, errors: Sequence[Sequence[tuple[Floats, Floats, Floats]]], smallest: float) -> Affine:
    """Return the map with the covariance between logs sized so that 95 % of errors on left-out logs are in the band.

    Args:
        affine: the map.
        errors: for each joint, each left-out log's (errors [rad], variance from the coefficients, the rest of it).
        smallest: least factor of the standard deviation.
    """
    joints = []
    for joint, logs in zip(affine.joints, errors):
        factor = _factor([np.vstack(parts) for parts in logs], smallest) if logs else smallest
        covariance = tuple(tuple(factor**2 * value for value in row) for row in joint.covariance)
        joints.append(joint.model_copy(update={"covariance": covariance}))
    return affine.model_copy(update={"joints": tuple(joints)})


def _factor(logs: Sequence[Floats], smallest: float) -> float:
    """Return the least factor c ≥ smallest for which, over all logs alike, 95 % have e² ≤ 1.96² (c² u + v)."""
    needed, weights = [], []
    for error, between, within in logs:
        wanted = np.maximum(error**2 / NORMAL**2 - within, 0.0)
        needed.append(np.sqrt(wanted / np.maximum(between, 1e-30)))
        weights.append(np.full(len(error), 1.0 / len(error)))
    factors, share = np.concatenate(needed), np.concatenate(weights)
    order = np.argsort(factors)
    reached = np.cumsum(share[order]) / share.sum()
    at = min(int(np.searchsorted(reached, 0.95)), len(order) - 1)
    return float(np.clip(factors[order][at], smallest, LARGEST))


LARGEST = 100.0
"""Largest factor by which errors on left-out logs widen the spread between logs."""
