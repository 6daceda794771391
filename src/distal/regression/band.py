"""The size of a band, by the errors on logs left out (split conformal prediction by log; Lei et
al., JASA 113, 2018).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND, COVERED
from distal.regression.random_effects import rows_of_groups
from distal.rig import LearnedMap

SMALLEST_FACTOR = 0.5
LARGEST_FACTOR = 30.0
"""Least and largest factor by which errors on left-out logs change the width of the band."""

OWNS = (1.0, 0.5, 0.25)
"""Shares of the filter's own std that are tried: beside a learned band its error might be counted
twice.
"""

WEIGHT = 0.9
"""A smaller share is used if its band is narrower than this share of the wider band."""

BELOW_NOISE = 0.3
"""An error below this share of the reference's own noise is told no closer: there all maps are
alike.
"""

Errors = tuple[Floats, Floats, Floats]
"""On a log: errors e, variances u that are scaled, and variances v that are not."""


def student(freedom: float) -> float:
    """Return by what a 95 % band is wider that knows its std from so many degrees of freedom:
    t_{0.975}/1.96.
    """
    from scipy.special import stdtrit  # loaded late: it takes as long as all of distal

    return float(stdtrit(max(freedom, 1.0), (1 + COVERED) / 2)) / BAND


def conformal_factor(logs: Sequence[Errors], least: float, largest: float) -> float:
    """Return the smallest c from `least` to `largest` for which 95 % of all logs' errors have e² ≤
    1.96² (c² u + v).
    """
    needed = []
    weights = []
    for error, scaled, fixed in logs:
        if len(error):
            excess = np.maximum(error**2 / BAND**2 - fixed, 0.0)
            needed.append(np.sqrt(excess / np.maximum(scaled, 1e-30)))
            weights.append(np.full(len(error), 1.0 / len(error)))
    if not needed:
        return float(np.clip(1.0, least, largest))
    factors = np.concatenate(needed)
    share = np.concatenate(weights)
    order = np.argsort(factors)
    reached = np.cumsum(share[order]) / share.sum()
    at = min(int(np.searchsorted(reached, COVERED)), len(order) - 1)
    return float(np.clip(factors[order][at], least, largest))


def rms_beyond_noise(errors: Sequence[Sequence[Errors]], noise: float = 0.0) -> float:
    """Return the mean of RMS errors, of each log and joint alone, less the reference's own noise;
    NaN where there are none.

    The `noise`, a std, is of the reference's random error, which no map can explain: its variance
    is taken off.
    """
    squares = [float(np.mean(error**2)) for log in errors for error, _, _ in log if len(error)]
    rms = [np.sqrt(max(square - noise**2, (BELOW_NOISE * noise) ** 2)) for square in squares]
    return float(np.mean(rms)) if rms else float("nan")


def sized(learned: LearnedMap, errors: Sequence[Sequence[Errors]], enough: bool) -> LearnedMap:
    """Return a map with its band sized by the errors on logs left out.

    Of `OWNS`, the shares of the filter's own std, the one that gives the narrowest sized band is
    used; where there are not `enough` logs to choose, the worst one decides.
    """
    filtered = any(np.any(v > 0.0) for log in errors for _, _, v in log)
    shares = (1.0,) if not filtered else OWNS if enough else (share_of_few(errors),)
    best = learned
    narrowest = float("inf")
    for share in shares:
        parts = [
            [(e, u, share**2 * v) for e, u, v in (log[j] for log in errors)]
            for j in range(len(learned.joints))
        ]
        factors = [conformal_factor(logs, SMALLEST_FACTOR, LARGEST_FACTOR) for logs in parts]
        sizes = [
            np.sqrt(c**2 * u + v).mean()
            for c, logs in zip(factors, parts)
            for _, u, v in logs
            if len(u)
        ]
        width = float(np.mean(sizes))
        if width < WEIGHT * narrowest:
            best = inflate_band(learned.model_copy(update={"own": share}), factors)
            narrowest = width
    return best


def share_of_few(errors: Sequence[Sequence[Errors]]) -> float:
    """Return the share of the filter's own std that the worst log and joint of few left out needs,
    at most 1.
    """
    ratios = [
        np.abs(e) / np.sqrt(np.maximum(v, 1e-30)) for log in errors for e, _, v in log if len(e)
    ]
    return float(
        min(1.0, max((np.quantile(ratio, COVERED) for ratio in ratios), default=BAND) / BAND)
    )


def inflate_band(learned: LearnedMap, factors: Sequence[float]) -> LearnedMap:
    """Return a map with a wider or narrower band, by `factors` on each joint's standard
    deviation.
    """
    return learned.model_copy(
        update={"band": tuple(float(c * f) for c, f in zip(learned.band, factors))}
    )


def widened_between(learned: LearnedMap, wider: float) -> LearnedMap:
    """Return a map whose coefficients differ more from log to log: their standard deviation is
    `wider` times as large.
    """
    covariances = [
        rows_of_groups(wider**2 * np.asarray(joint.covariance)) for joint in learned.joints
    ]
    joints = [
        joint.model_copy(update={"covariance": c}) for joint, c in zip(learned.joints, covariances)
    ]
    return learned.model_copy(update={"joints": tuple(joints)})
