"""Statistics of the innovations of each channel: how large and how correlated they are, since when
they are too large, and how often the channel is compared.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from distal.arrays import Floats
from distal.diagnosis import finding_texts as texts
from distal.diagnosis.finding import Finding
from distal.results.estimate import Estimate
from distal.results.thresholds import SMALL

LARGE_RATIO = 1.7
"""Mean of ν²/S of a channel from which on its innovations are larger than expected [1]. Source:
judgement.
"""

CHANNEL_WINDOW = 1.0
"""Length of the windows in which a channel is judged [s]. Source: judgement."""

SELDOM = 0.5
"""Share of a channel's samples that are compared, below which a finding says so [1]. Source:
judgement.
"""

NEVER_COMPARED = 0.1
"""Share of a channel's samples that are compared, below which the channel tests nothing [1].
Source: judgement.
"""

MOST_WINDOWS = 0.5
"""Least share of windows with too large innovations, from some time to the end, where a channel
disagrees since that time [1]. Source: judgement.
"""

WHITE = 0.5
"""Correlation of neighbouring innovations, if all channels have it, from which on something acts
that is not in the rig [1]. Source: judgement.
"""

COLOURED = 0.3
"""Correlation of a channel's neighbouring innovations from which on the rig or the sensor is
doubted [1].

On right rigs it is below 0.13 where ν²/S is above `WHOLE`; a moment arm that is 20 % wrong on one
side of two gives 0.3 to 0.7. Source: judgement.
"""

WHOLE = 0.5
"""Mean of ν²/S above which a channel's innovations are mostly noise [1].

Below it, S is mostly the uncertainty of the rig's parameters. Their errors last, so that
correlation is expected. Source: judgement.
"""


@dataclass(frozen=True)
class ChannelStatistics:
    """Statistics of the innovations of each channel, all in the order of `names`.

    Args:
        names: of the channels.
        ratios: means of ν²/S, NaN where nothing was compared.
        correlations: of neighbouring normalised innovations.
        since: time from which on a channel disagrees to the end [s], or NaN.
        shares: of the samples that were compared.
    """

    names: tuple[str, ...]
    ratios: tuple[float, ...]
    correlations: tuple[float, ...]
    since: tuple[float, ...]
    shares: tuple[float, ...]

    @property
    def tested(self) -> tuple[str, ...]:
        """Names of the channels that could have disagreed."""
        statistics = zip(self.names, self.ratios, self.shares)
        return tuple(
            name for name, ratio, share in statistics if ratio >= SMALL and share >= NEVER_COMPARED
        )

    def findings(self) -> list[Finding]:
        """Return the findings on channels that disagree, and on channels that test nothing."""
        return self._disagreeing() + self._untested()

    def _disagreeing(self) -> list[Finding]:
        names = self.names
        ratios = self.ratios
        large = [i for i, ratio in enumerate(ratios) if ratio > LARGE_RATIO]
        drifting = [
            names[i] for i, rho in enumerate(self.correlations) if rho > WHITE and ratios[i] > WHOLE
        ]
        if drifting and len(drifting) == len(names) and not large:
            return [texts.all_drift(drifting)]
        late = [i for i, start in enumerate(self.since) if np.isfinite(start)]
        if len(late) == 1:
            i = late[0]
            elsewhere = [ratio for j, ratio in enumerate(ratios) if j != i and np.isfinite(ratio)]
            if len(large) <= 1 or ratios[i] > 4 * max(elsewhere, default=0.0):
                return [texts.disagrees_since(names[i], self.since[i])]
        if len(large) == 1 and len(names) > 1:
            return [texts.one_too_large(names[large[0]], ratios[large[0]])]
        if large:
            return [
                texts.several_too_large(
                    [names[i] for i in large], float(np.mean([ratios[i] for i in large]))
                )
            ]
        coloured = [
            i for i, rho in enumerate(self.correlations) if rho > COLOURED and ratios[i] > WHOLE
        ]
        if coloured:
            largest = max(self.correlations[i] for i in coloured)
            return [texts.some_drift([names[i] for i in coloured], largest)]
        return []

    def _untested(self) -> list[Finding]:
        findings = []
        for name, ratio, share in zip(self.names, self.ratios, self.shares):
            if share < SELDOM:
                findings.append(texts.hardly_compared(name, share))
            if share >= NEVER_COMPARED and ratio < SMALL:
                findings.append(texts.not_tested(name, ratio))
        return findings


def channel_statistics_of(estimate: Estimate) -> ChannelStatistics:
    """Return the statistics of the innovations of an estimate."""
    # relative to what a fit found usual of this rig in free motion
    usual = np.array(estimate.usual or [(1.0, 0.0)] * len(estimate.measured)).reshape(-1, 2)
    scaled = estimate.innovations / np.sqrt(estimate.innovation_variances * usual[:, 0])
    # in the first moments the filter still finds the parameters
    settled = estimate.time >= estimate.time[0] + min(0.5, 0.1 * float(np.ptp(estimate.time)))
    columns = scaled[settled].T
    return ChannelStatistics(
        estimate.measured,
        tuple(_mean(column**2) for column in columns),
        tuple(_neighbours(column) * (1.0 - rho) for column, rho in zip(columns, usual[:, 1])),
        tuple(_since(estimate.time, column) for column in scaled.T),
        tuple(float(np.mean(np.isfinite(column))) for column in scaled.T),
    )


def _mean(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(np.mean(finite)) if len(finite) else float("nan")


def _neighbours(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    if len(finite) < 20 or float(np.std(finite)) == 0.0:
        return 0.0
    return float(np.clip(np.mean(finite[1:] * finite[:-1]) / np.mean(finite**2), -1, 1))


def _since(time: Floats, scaled: Floats) -> float:
    """Return the time from which on a channel is too large to the end: in the last window, and in
    most windows since then.
    """
    edges = np.arange(time[0], time[-1] + CHANNEL_WINDOW, CHANNEL_WINDOW)
    starts = []
    large = []
    rows = np.searchsorted(time, edges).tolist()
    for start, (begin, end) in zip(edges, itertools.pairwise(rows)):
        inside = scaled[begin:end]
        inside = inside[np.isfinite(inside)]
        if len(inside) >= 5:
            starts.append(float(start))
            large.append(
                bool(np.median(np.abs(inside)) > 1.35)
            )  # twice the median of a normal distribution
    if not large or not large[-1]:
        return float("nan")
    first = next(
        start for k, start in enumerate(starts) if large[k] and np.mean(large[k:]) >= MOST_WINDOWS
    )
    if first == time[0]:
        return float("nan")
    outliers = np.flatnonzero((time >= first - CHANNEL_WINDOW) & (np.abs(scaled) > 3.0))
    return float(time[outliers[0]]) if len(outliers) else first
