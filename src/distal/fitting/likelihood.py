"""How likely a log's innovations are, and what they tell of coordinates: pure functions of arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FEWEST_SHARE = 0.05
"""A value counts for at most 20: a channel that is hardly compared tells hardly anything."""

CORRELATED = 2.0
"""Scores that are this far apart in time are taken as independent [s]: sensors' curves last for a stroke."""


UNBOUNDED = 1e100
"""Innovations, variances and slopes beyond this are of a filter that left all bounds; below it squares are finite."""


@dataclass(frozen=True)
class Innovations:
    """What a run of the filter over a log expected wrongly.

    Args:
        values: ν, NaN where nothing was compared, (k, m).
        variances: S, (k, m).
    """

    values: Floats
    variances: Floats


@dataclass(frozen=True)
class Weighing:
    """How the values of each channel count.

    Args:
        tolerance: ν²/S beyond which an innovation is an outlier, (m,).
        share: how much a value counts, (m,).
        times: stamps of the samples [s], (k,).
        counts: how many values of each channel stand for all that are compared, (m,): which are (a drive's force near its
            stop is not) depends on the numbers, and fewer of them would make a log look likelier or less likely.
    """

    tolerance: Floats
    share: Floats
    times: Floats
    counts: Floats


@dataclass(frozen=True)
class Derivatives:
    """−ln p and its derivatives at a point.

    Args:
        cost: −ln p, less constants.
        gradient: of it, (n,).
        information: Fisher information of the logs, (n, n).
        meat: long-run covariance of the scores, (n, n): equal to the information where the model is right.
        spans: how many spans of time it is the sum of.
        of_logs: of a sum over logs those of each log alone, without the prior.
    """

    cost: float
    gradient: Floats
    information: Floats
    meat: Floats
    spans: int
    of_logs: tuple[Derivatives, ...] = ()


def cost_of(run: Innovations, weighing: Weighing) -> float:
    """Return ½ Σ w (ν²/S' + ln S') over what was compared; infinite where the filter left all bounds.

    S' is S, grown to ν²/tolerance for an outlier, as in the filter.

    Args:
        run: of the filter.
        weighing: of the channels.
    """
    there = np.isfinite(run.values)
    nu, spread = run.values[there], run.variances[there]
    if not np.all(spread < UNBOUNDED) or np.any(spread <= 0.0) or np.any(np.abs(nu) > UNBOUNDED):
        return float("inf")
    ratio = nu * nu / spread
    inflation = np.maximum(1.0, ratio / np.broadcast_to(weighing.tolerance, run.values.shape)[there])
    weight = np.broadcast_to(weighing.share * evened(run, weighing), run.values.shape)[there]
    return 0.5 * float(np.sum(weight * (ratio / inflation + np.log(spread * inflation))))


def evened(run: Innovations, weighing: Weighing) -> Floats:
    """Return by what the values of each channel count more or less, so that their number does not matter, (m,).

    Args:
        run: of the filter.
        weighing: with the numbers that they stand for.
    """
    compared = np.maximum(np.isfinite(run.values).sum(axis=0), FEWEST_SHARE * weighing.counts)
    shares: Floats = np.where(weighing.counts > 0, weighing.counts / np.maximum(compared, 1.0), 1.0)
    return shares


def derivatives_of(
    base: Innovations, ends: Sequence[tuple[Innovations, Innovations]], widths: Floats, weighing: Weighing
) -> Derivatives:
    """Return −ln p of a log and its derivatives, from runs at a point and at both ends of a step of each coordinate.

    The score of a sample is ν ν'/S + ½ (ln S)' (1 − ν²/S), for an outlier ν'/ν; Fisher's information is
    Σ ν' ν'ᵀ/S + ½ (ln S)' (ln S)'ᵀ (Gupta and Mehra, IEEE TAC 19, 1974).

    Args:
        base: run at the point.
        ends: run at the upper and at the lower end of each coordinate's step, (n,).
        widths: upper less lower end, (n,); 0 for a coordinate that is not varied.
        weighing: of the channels.
    """
    there, shape = np.isfinite(base.values), base.values.shape
    nu, spread = base.values[there], base.variances[there]
    slopes, log_slopes = np.zeros((len(ends), len(nu))), np.zeros((len(ends), len(nu)))
    for k, (up, down) in enumerate(ends):
        if widths[k] != 0.0:
            with np.errstate(all="ignore"):  # an end may have left all bounds
                slopes[k] = (up.values[there] - down.values[there]) / widths[k]
                log_slopes[k] = np.log(up.variances[there] / down.variances[there]) / widths[k]
    # what is compared may change at the ends (a slider at a stop): such a sample has no slope
    slopes[~(np.abs(slopes) < UNBOUNDED)] = 0.0
    log_slopes[~(np.abs(log_slopes) < UNBOUNDED)] = 0.0
    ratio = nu * nu / spread
    inflation = np.maximum(1.0, ratio / np.broadcast_to(weighing.tolerance, shape)[there])
    inlier = inflation <= 1.0
    weight = np.broadcast_to(weighing.share, shape)[there]
    influence = np.where(inlier, nu / spread, 1.0 / np.where(nu == 0.0, 1.0, nu))
    even = np.broadcast_to(evened(base, weighing), shape)[there]
    scores = even * weight * (slopes * influence + 0.5 * log_slopes * np.where(inlier, 1.0 - ratio, 0.0))
    root = slopes * np.sqrt(weight / (spread * inflation))
    spreads = np.sqrt(0.5 * weight) * log_slopes * inlier
    meat, spans = long_run_covariance(scores, np.broadcast_to(weighing.times[:, None], shape)[there])
    return Derivatives(cost_of(base, weighing), scores.sum(axis=1), root @ root.T + spreads @ spreads.T, meat, spans)


def long_run_covariance(scores: Floats, times: Floats) -> tuple[Floats, int]:
    """Return Σ s sᵀ of scores summed over spans of `CORRELATED` s, and the number of spans.

    Where the model is wrong, innovations are correlated and Fisher's information is too large; what the scores really
    do is in this matrix (White, Econometrica 50, 1982; Newey and West, Econometrica 55, 1987).

    Args:
        scores: of each sample, (n, k).
        times: of the samples [s], (k,).
    """
    if not len(times):
        return np.zeros((len(scores), len(scores))), 0
    spans = np.floor((times - times.min()) / CORRELATED).astype(int)
    sums = np.zeros((scores.shape[0], int(spans.max()) + 1))
    for k in range(scores.shape[0]):
        sums[k] = np.bincount(spans, scores[k], minlength=sums.shape[1])
    return sums @ sums.T, sums.shape[1]
