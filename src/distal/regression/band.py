"""The width of the band of a learned map, by its errors on held-out logs (split conformal
prediction by log; Lei et al., JASA 113, 2018).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND, COVERED
from distal.regression.random_effects import rows_of_groups
from distal.rig import LearnedMap

SMALLEST_FACTOR = 0.5
"""Least factor by which the errors on held-out logs change the map's standard deviation. Source:
judgement.
"""

LARGEST_FACTOR = 30.0
"""Largest such factor. Source: judgement."""

OWNS = (1.0, 0.5, 0.25)
"""Shares of the filter's own std that are tried beside the map's: the error that the map corrects
would otherwise be counted twice. Source: judgement.
"""

BETWEEN = (1.0, 0.5)
"""Shares of the coefficients' stds that are tried: from few logs the scatter of many coefficients
is guessed too large. Source: benchmark (docs/results/from-logs.md).
"""

WEIGHT = 0.9
"""Ratio of two widths: a smaller share of `OWNS` or `BETWEEN` is used where its band is narrower
than this share of the band before it. Source: judgement.
"""

BELOW_NOISE = 0.3
"""Least RMS error beyond the reference's noise that is told apart, as a share of that noise: below
it all maps count as equal. Source: judgement.
"""

Errors = tuple[Floats, Floats, Floats]
"""The errors e of one joint on a log, the variances u of the map, which the factor c scales, and
the variances v of the filter, which it does not, (k,) each.
"""


def student(freedom: float) -> float:
    """Return the factor by which a 95 % band is wider if its std was estimated with `freedom`
    degrees of freedom, at least 1: t_{0.975}/1.96.
    """
    from scipy.special import stdtrit  # loaded late: it takes as long as all of distal

    return float(stdtrit(max(freedom, 1.0), (1 + COVERED) / 2)) / BAND


def conformal_factor(logs: Sequence[Errors], least: float, largest: float) -> float:
    """Return the smallest factor c for which 95 % of the errors of some logs have e² ≤ 1.96² (c² u
    + v).

    All logs weigh alike, however long. The factor is between `least` and `largest`; it is 1 where
    there are no errors.
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
    """Return the mean of the RMS errors of all logs and joints, each less the reference's noise:
    √(mean e² − noise²).

    The `noise` is the std of the reference's random error, which no map can explain. A root below
    `BELOW_NOISE` of it counts as that. The result is NaN where there are no errors.
    """
    squares = [float(np.mean(error**2)) for log in errors for error, _, _ in log if len(error)]
    rms = [np.sqrt(max(square - noise**2, (BELOW_NOISE * noise) ** 2)) for square in squares]
    return float(np.mean(rms)) if rms else float("nan")


def sized(
    learned: LearnedMap, errors: Sequence[Sequence[Errors]], enough: bool
) -> tuple[LearnedMap, float]:
    """Return a map whose band has the width that its `errors` on held-out logs need, and the mean
    std of that band.

    With `enough` logs, the share of the filter's own std is chosen from `OWNS` by the narrowest
    band; with fewer it is `share_of_few`.
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
    return best, narrowest


def share_of_few(errors: Sequence[Sequence[Errors]]) -> float:
    """Return the share of the filter's own std with which its band alone holds 95 % of the errors
    on each held-out log and joint, at most 1.
    """
    ratios = [
        np.abs(e) / np.sqrt(np.maximum(v, 1e-30)) for log in errors for e, _, v in log if len(e)
    ]
    return float(
        min(1.0, max((np.quantile(ratio, COVERED) for ratio in ratios), default=BAND) / BAND)
    )


def inflate_band(learned: LearnedMap, factors: Sequence[float]) -> LearnedMap:
    """Return a map with the standard deviation of each joint's band multiplied by its factor in
    `factors`.
    """
    return learned.model_copy(
        update={"band": tuple(float(c * f) for c, f in zip(learned.band, factors))}
    )


def widened_between(learned: LearnedMap, wider: float) -> LearnedMap:
    """Return a map with the standard deviation of its coefficients between logs multiplied by
    `wider`.
    """
    covariances = [
        rows_of_groups(wider**2 * np.asarray(joint.covariance)) for joint in learned.joints
    ]
    joints = [
        joint.model_copy(update={"covariance": c}) for joint, c in zip(learned.joints, covariances)
    ]
    return learned.model_copy(update={"joints": tuple(joints)})
