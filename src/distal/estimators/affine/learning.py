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
"""Most steps of expectation–maximisation for the spread between logs."""

SETTLED = 1e-3
"""It ends where a step changes the spread by less than this share."""

SMALLEST_SHARE = 1e-8
"""Combinations of columns with less than this share of the largest one's mean square are left out."""


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
        found, time = random_effects(joint, columns, parts)
        joints.append(found)
        times.append(time)
    return made.model_copy(update={"joints": tuple(joints), "correlation_time": max(times)})


def random_effects(
    joint: AffineJoint, columns: Sequence[int], parts: Sequence[tuple[Floats, Floats, float]]
) -> tuple[AffineJoint, float]:
    """Return the coefficients of one joint and the correlation time of the residuals [s].

    Args:
        joint: whose; its coefficients give their number.
        columns: which of them are learned, (n,).
        parts: of each log (design (k, n), angles [rad] (k,), interval [s]).
    """
    if len(parts) == 1:
        only = line(*parts[0][:2])
        return filled(joint, columns, only.coefficients, only.covariance, only.std), only.correlated * parts[0][2]
    basis = _basis([part[0] for part in parts])
    designs = [part[0] @ basis for part in parts]
    grams = [design.T @ design for design in designs]
    moments = [design.T @ part[1] for design, part in zip(designs, parts)]
    mean = np.linalg.pinv(sum(grams)) @ sum(moments)
    ones = [line(design, part[1]) for design, part in zip(designs, parts)]
    lengths = np.array([len(part[1]) for part in parts])
    count = np.array([one.correlated for one in ones])
    std = np.sqrt(max(np.average([one.std**2 for one in ones], weights=lengths), SMALLEST_STD**2))
    spread = _start(designs, [part[1] for part in parts], mean, std)
    for _ in range(ITERATIONS):
        drawn = [updated(mean, spread, gram, moment, std**2 * own) for gram, moment, own in zip(grams, moments, count)]
        means = np.array([after for after, _ in drawn])
        mean = means.mean(axis=0)
        off = means - mean
        before = spread
        # the mean is of the same logs: one degree of freedom less
        spread = (off.T @ off + sum(left for _, left in drawn)) / (len(parts) - 1)
        if np.abs(spread - before).max() < SETTLED * np.abs(spread).max():
            break
    spread = _shrunk(spread, len(parts))
    residuals = [part[1] - design @ after for design, part, after in zip(designs, parts, means)]
    std = max(float(np.sqrt(np.mean(np.concatenate(residuals) ** 2))), SMALLEST_STD)
    times = [correlated_samples(own) * part[2] for own, part in zip(residuals, parts)]
    covariance = basis @ (spread * (1.0 + 1.0 / len(parts))) @ basis.T
    covariance = 0.5 * (covariance + covariance.T)
    return filled(joint, columns, basis @ mean, covariance, std), float(np.mean(times))


def _basis(designs: Sequence[Floats]) -> Floats:
    """Return W for which the columns of X W are uncorrelated and of size one over all logs, (n, up to n).

    What is assumed of the spread between logs is assumed of such columns, so that it does not depend on how the same
    columns are written; combinations that hardly ever differ from zero are left at zero.
    """
    whole = np.vstack(designs)
    values, vectors = np.linalg.eigh(whole.T @ whole / len(whole))
    kept = values > SMALLEST_SHARE * values[-1]
    basis: Floats = vectors[:, kept] / np.sqrt(values[kept])
    return basis


def _start(designs: Sequence[Floats], angles: Sequence[Floats], mean: Floats, std: float) -> Floats:
    """Return a wide spread to start from: as if every coefficient alone explained what the common map leaves."""
    left = np.concatenate([y - x @ mean for x, y in zip(designs, angles)])
    return np.eye(len(mean)) * max(float(np.mean(left**2)), std**2)


def _shrunk(spread: Floats, logs: int) -> Floats:
    """Return the spread with its correlations drawn to zero where logs are too few to tell them, fewer than 2n + 1 for n.

    The share is n/(n + logs − 1): from few logs the spread has fewer directions than columns, and would be sure of the
    rest.
    """
    n = len(spread)
    if logs > 2 * n:
        return spread
    share = n / (n + logs - 1)
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
        factor = conformal_factor(logs, smallest, LARGEST) if logs else smallest
        covariance = tuple(tuple(factor**2 * value for value in row) for row in joint.covariance)
        joints.append(joint.model_copy(update={"covariance": covariance}))
    return affine.model_copy(update={"joints": tuple(joints)})


def conformal_factor(logs: Sequence[tuple[Floats, Floats, Floats]], least: float, largest: float) -> float:
    """Return the least factor c for which, over all logs alike, 95 % of errors have e² ≤ 1.96² (c² u + v).

    Args:
        logs: of each left-out log (errors e [rad], u, v).
        least: smallest factor.
        largest: largest factor.
    """
    needed, weights = [], []
    for error, scaled, fixed in logs:
        if len(error):
            wanted = np.maximum(error**2 / NORMAL**2 - fixed, 0.0)
            needed.append(np.sqrt(wanted / np.maximum(scaled, 1e-30)))
            weights.append(np.full(len(error), 1.0 / len(error)))
    factors, share = np.concatenate(needed), np.concatenate(weights)
    order = np.argsort(factors)
    reached = np.cumsum(share[order]) / share.sum()
    at = min(int(np.searchsorted(reached, 0.95)), len(order) - 1)
    return float(np.clip(factors[order][at], least, largest))


LARGEST = 100.0
"""Largest factor by which errors on left-out logs widen the spread between logs."""
