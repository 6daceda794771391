"""How likely a log's innovations are, and their derivatives by the coordinates: pure functions of
arrays.

Where a rig lacks physics, its innovations are larger than the filter expects, and keep one sign for
seconds. The weight of each channel is therefore estimated from the innovations
(docs/explanation/learning.md): their variance is taken as c S, with c the mean of ν²/S, and a value
counts by the ratio of their plain to their long-run variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distal.arrays import Floats

FEWEST_SHARE = 0.05
"""Least share of a channel's values that counts as compared, so that one value stands for at most
20: a channel that is hardly compared tells hardly anything. Source: judgement.
"""

CORRELATED = 2.0
"""Time after which innovations are taken as independent [s], since a sensor's systematic errors
last for a stroke. Source: judgement.
"""

NORMAL_MEDIAN = 0.4549
"""Median of ν²/S where ν is normal with variance S. Source: definition (median of the χ²
distribution with one degree of freedom).
"""

UNBOUNDED = 1e100
"""Size of innovations, variances or slopes above which the filter has left all bounds. Source:
rounding (squares that overflow).
"""


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """How a search for the least −ln p goes, and when it ends; `benchmarks.searches` compares.

    Args:
        settled: predicted gain of −ln p in the next step, below which the search ends: that of a
            tenth of a standard error.
        enough: gain of −ln p, below which two steps in a row end the search: the kinks of a
            filter's −ln p have the default's size.
        iterations: largest number of iterations.
        first_iterations: number after which the weights of the channels' values are found again.
        first_damping: damping of the first iteration, the share of the information's diagonal that
            is added to it.
        least_damping: least such damping.
        dampings: factors on the damping of the last step: steps with these dampings are tried side
            by side, beside the undamped one.
        first_width: width of the differences that give the first slopes, as a share of a value, or
            of its scale where it may be zero.
        slope_width: width of the later ones, as a share of the std that a parameter would have if
            all others were known: over less, kinks of friction look like information
            (docs/explanation/learning.md).
        smallest_width: least width, as a share of a parameter's value.
        smallest_noise_width: the same for the size of a noise, which also changes where a joint
            slips.
        wider: factor on the width after a step that gained too little.
    """

    settled: float = 5e-3
    enough: float = 0.3
    iterations: int = 30
    first_iterations: int = 3
    first_damping: float = 1e-2
    least_damping: float = 1e-6
    dampings: tuple[float, float] = (1 / 8, 8.0)
    first_width: float = 1e-2
    slope_width: float = 0.3
    smallest_width: float = 1e-3
    smallest_noise_width: float = 0.05
    wider: float = 4.0


@dataclass(frozen=True)
class Innovations:
    """The innovations ν of a run of the filter over a log, NaN where nothing is compared, and their
    variances S, (k, m) each.
    """

    values: Floats
    variances: Floats

    @property
    def bounded(self) -> bool:
        """Whether the filter stayed within all bounds."""
        compared = np.isfinite(self.values)
        spread = self.variances[compared]
        sizes = np.abs(self.values[compared])
        return bool(
            np.all(spread < UNBOUNDED) and np.all(spread > 0.0) and np.all(sizes < UNBOUNDED)
        )


@dataclass(frozen=True)
class Weighing:
    """How the values of each channel of a log are weighed.

    Args:
        tolerance: the ν²/(c S) above which an innovation is an outlier, (m,).
        share: weight of one value, (m,).
        times: stamps of the samples [s], (k,).
        counts: number of values of each channel that those compared stand for, (m,). Which values
            are compared depends on the parameters (a drive's force near its stop is not), and fewer
            values must not make a log look likelier or less likely.
        scale: c, the factor by which the innovations' variances are larger than the filter expects,
            (m,).
    """

    tolerance: Floats
    share: Floats
    times: Floats
    counts: Floats
    scale: Floats | float = 1.0


@dataclass(frozen=True)
class Derivatives:
    """−ln p, less constants, and its derivatives at a point.

    Args:
        cost: −ln p.
        gradient: its gradient by the coordinates, (n,).
        information: Fisher information of the logs, (n, n).
        meat: long-run covariance of the scores, (n, n): equal to the information where the model is
            right.
        spans: number of spans of time that `meat` is summed over.
        of_logs: for a sum over logs, the derivatives of each log alone, without the prior.
    """

    cost: float
    gradient: Floats
    information: Floats
    meat: Floats
    spans: int
    of_logs: tuple[Derivatives, ...] = ()


def scales_of(runs: Sequence[Innovations], tolerance: Floats) -> Floats:
    """Return c of each channel over some logs, (m,): the mean of ν²/S, at least 1, where an outlier
    counts as if it were at its `tolerance`.

    This c makes the innovations most likely, −ln p = ½ Σ (ν²/(c S) + ln c S).
    """
    scales = np.ones(len(tolerance))
    for k, limit in enumerate(tolerance):
        compared = [np.isfinite(run.values[:, k]) for run in runs]
        ratios = [
            run.values[mask, k] ** 2 / run.variances[mask, k] for run, mask in zip(runs, compared)
        ]
        pooled = np.concatenate(ratios) if ratios else np.zeros(0)
        if len(pooled):
            plain = max(1.0, float(np.median(pooled)) / NORMAL_MEDIAN)
            scales[k] = max(1.0, float(np.mean(np.minimum(pooled, limit * plain))))
    return scales


def shares_of(runs: Sequence[Innovations], times: Sequence[Floats]) -> Floats:
    """Return the weight of one value of each channel, (m,): Σ ν²/S over Σ (Σ_span ν/√S)², at most
    1, the ratio of the plain to the long-run variance.

    Values that keep one sign for seconds tell less than their number says (Newey and West,
    Econometrica 55, 1987; of wrong models Müller, Econometrica 81, 2013). A span lasts `CORRELATED`
    s by `times`, the stamps of each run's samples [s], (k,).
    """
    m = runs[0].values.shape[1]
    plain = np.zeros(m)
    together = np.zeros(m)
    for run, stamps in zip(runs, times):
        spans = np.floor((stamps - stamps[0]) / CORRELATED).astype(int)
        for k in range(m):
            compared = np.isfinite(run.values[:, k])
            normalized = run.values[compared, k] / np.sqrt(run.variances[compared, k])
            plain[k] += np.sum(normalized**2)
            together[k] += np.sum(np.bincount(spans[compared], normalized) ** 2)
    return 1.0 / np.maximum(1.0, together / np.maximum(plain, 1e-300))


def cost_of(run: Innovations, weighing: Weighing) -> float:
    """Return ½ Σ w (ν²/S' + ln S') over the values that were compared; it is infinite where the
    filter left all bounds.

    S' is c S, enlarged to ν²/tolerance for an outlier, as in the filter.
    """
    if not run.bounded:
        return float("inf")
    compared = np.isfinite(run.values)
    shape = run.values.shape
    nu = run.values[compared]
    spread = (run.variances * weighing.scale)[compared]
    ratio = nu * nu / spread
    inflation = np.maximum(1.0, ratio / np.broadcast_to(weighing.tolerance, shape)[compared])
    weight = np.broadcast_to(weighing.share * evened(run, weighing), shape)[compared]
    return 0.5 * float(np.sum(weight * (ratio / inflation + np.log(spread * inflation))))


def evened(run: Innovations, weighing: Weighing) -> Floats:
    """Return the factor on the weights of each channel, (m,), with which the number of values
    compared in this run does not matter.
    """
    compared = np.maximum(np.isfinite(run.values).sum(axis=0), FEWEST_SHARE * weighing.counts)
    shares: Floats = np.where(weighing.counts > 0, weighing.counts / np.maximum(compared, 1.0), 1.0)
    return shares


def derivatives_of(
    base: Innovations,
    ends: Sequence[Innovations],
    widths: Floats,
    weighing: Weighing,
) -> Derivatives:
    """Return −ln p of a log and its derivatives at a point, by differences between runs.

    The score of a sample is ν ν'/S + ½ (ln S)' (1 − ν²/S), for an outlier ν'/ν; Fisher's
    information is Σ ν' ν'ᵀ/S + ½ (ln S)' (ln S)'ᵀ (Gupta and Mehra, IEEE TAC 19, 1974), here with c
    S in place of S. The scale c is held, which gives the right gradient because c minimises −ln p.

    Args:
        base: the run at the point.
        ends: for each coordinate the run at the end of a step.
        widths: the steps, (n,); 0 for a coordinate that is not varied.
        weighing: weights of the log's values.
    """
    compared = np.isfinite(base.values)
    shape = base.values.shape
    nu = base.values[compared]
    spread = (base.variances * weighing.scale)[compared]
    slopes = np.zeros((len(ends), len(nu)))
    log_slopes = np.zeros((len(ends), len(nu)))
    for k, end in enumerate(ends):
        if widths[k] != 0.0:
            with np.errstate(all="ignore"):  # an end may have left all bounds
                slopes[k] = (end.values - base.values)[compared] / widths[k]
                log_slopes[k] = np.log(end.variances / base.variances)[compared] / widths[k]
    # what is compared may change at the ends (a slider at a stop): such a sample has no slope
    slopes[~(np.abs(slopes) < UNBOUNDED)] = 0.0
    log_slopes[~(np.abs(log_slopes) < UNBOUNDED)] = 0.0
    ratio = nu * nu / spread
    inflation = np.maximum(1.0, ratio / np.broadcast_to(weighing.tolerance, shape)[compared])
    inlier = inflation <= 1.0
    weight = np.broadcast_to(weighing.share * evened(base, weighing), shape)[compared]
    influence = np.where(inlier, nu / spread, 1.0 / np.where(nu == 0.0, 1.0, nu))
    scores = weight * (slopes * influence + 0.5 * log_slopes * np.where(inlier, 1.0 - ratio, 0.0))
    root = slopes * np.sqrt(weight / (spread * inflation))
    spreads = np.sqrt(0.5 * weight) * log_slopes * inlier
    meat, spans = long_run_covariance(
        scores, np.broadcast_to(weighing.times[:, None], shape)[compared]
    )
    information = root @ root.T + spreads @ spreads.T
    return Derivatives(cost_of(base, weighing), scores.sum(axis=1), information, meat, spans)


def long_run_covariance(scores: Floats, times: Floats) -> tuple[Floats, int]:
    """Return Σ s sᵀ, (n, n), where s is the sum of `scores`, (n, k), over a span of `CORRELATED` s,
    and the number of spans.

    The stamps `times` [s], (k,), give the spans. Where the model is wrong, innovations are
    correlated and Fisher's information is too large; this matrix is the covariance that the scores
    really have (White, Econometrica 50, 1982; Newey and West, Econometrica 55, 1987).
    """
    if not len(times):
        return np.zeros((len(scores), len(scores))), 0
    spans = np.floor((times - times.min()) / CORRELATED).astype(int)
    count = int(spans.max()) + 1
    sums = np.array([np.bincount(spans, score, minlength=count) for score in scores]).reshape(
        -1, count
    )
    return sums @ sums.T, count
