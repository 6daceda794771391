"""Rao's score test of possible causes: whether a change of one of them would make what was observed
likelier, by more than chance and by more than the rig's own stds allow.

With residuals r of unit variance under the rig and their derivatives D by the causes x, each cause
has the score s = −Dᵀ r and the information I = Dᵀ D (Rao, Proc. Camb. Phil. Soc. 44, 1948). Where
what a cause leaves of a channel has a larger variance, both are divided by that.
Residuals are correlated: a value of a channel counts by the ratio of its plain to its long-run
variance, that of sums over spans of time (Newey and West, Econometrica 55, 1987). The rig's own std
σ of a cause adds (I σ)² to the variance of its score.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from statistics import NormalDist

import numpy as np
from scipy.special import stdtrit

from distal.arrays import Bools, Floats

LEVEL = 1e-3
"""Chance with which anything is said against a right rig, for each log and each kind of test [1].
Source: judgement.
"""

SPAN = 2.0
"""Length of the spans of time whose sums count as independent [s], as in a fit. Source: judgement.
"""

UNBOUNDED = 1e50
"""Size of a derivative beyond which a run has left all bounds [1]. Source: rounding (squares of
squares that overflow).
"""


def quantile(tests: int) -> float:
    """Return the number of standard deviations beyond which one of several tests is significant at
    `LEVEL` together (Bonferroni), on either side.
    """
    return -NormalDist().inv_cdf(0.5 * LEVEL / max(tests, 1))


def span_sums(values: Floats, time: Floats) -> Floats:
    """Return the sums of values over spans of `SPAN`, (spans, n); NaN counts as zero.

    Args:
        values: (k, n).
        time: stamps [s], (k,).
    """
    starts = np.searchsorted(time, np.arange(time[0], time[-1] + 1e-9, SPAN))
    sums: Floats = np.add.reduceat(np.nan_to_num(values), np.unique(starts), axis=0)
    return sums


def independent(residuals: Floats, time: Floats) -> Floats:
    """Return how many independent values each column of residuals is worth, (n,): its number of
    values times Σ r² over Σ (sum over a span)², at most that number.

    Args:
        residuals: (k, n), NaN where there is none.
        time: stamps [s], (k,).
    """
    plain = np.nansum(residuals**2, axis=0)
    together = np.sum(span_sums(residuals, time) ** 2, axis=0)
    counts = np.isfinite(residuals).sum(axis=0)
    values: Floats = counts * np.minimum(1.0, plain / np.maximum(together, 1e-300))
    return values


@dataclass(frozen=True)
class ScoreTest:
    """Scores and information of causes.

    Args:
        residuals: r of unit variance, (k, m), NaN where nothing is compared.
        slopes: derivatives of r by each cause, (n, k, m).
        time: stamps [s], (k,).
        stds: the rig's own std of each cause, (n,).
    """

    residuals: Floats
    slopes: Floats
    time: Floats
    stds: Floats

    @cached_property
    def _sums(self) -> Floats:
        """Score, information and least-squares estimate of each cause, (n, 3).

        The weight of a channel's values is that of what a cause leaves of them, so that what it
        explains does not count as noise.
        """
        residuals = np.nan_to_num(self.residuals)
        counts = np.maximum(np.isfinite(self.residuals).sum(axis=0), 1)
        inverse = 1.0 / np.maximum(np.sum(residuals**2, axis=0) / counts, 1.0)
        sums = np.zeros((len(self.slopes), 3))
        for k, by_cause in enumerate(self.slopes):
            usable = np.isfinite(self.residuals) & (np.abs(by_cause) < UNBOUNDED)
            slopes = np.where(usable, by_cause, 0.0)
            square = float(np.sum(inverse * slopes**2))
            if square > 0.0:
                x = -float(np.sum(inverse * slopes * residuals)) / square
                left = np.where(np.isfinite(self.residuals), residuals + slopes * x, np.nan)
                variances = np.maximum(np.nansum(left**2, axis=0) / counts, 1.0)
                weights = independent(left, self.time) / counts / variances
                score = -float(np.sum(weights * slopes * residuals))
                information = float(np.sum(weights * slopes**2))
                sums[k] = score, information, x
        return sums

    @property
    def estimates(self) -> Floats:
        """Change of each cause alone that makes the residuals least, (n,); zero where nothing
        depends on it.
        """
        estimates: Floats = self._sums[:, 2]
        return estimates

    @property
    def standard_errors(self) -> Floats:
        """Standard error of the estimates, 1/√I, (n,); infinite where nothing depends on it."""
        with np.errstate(divide="ignore"):
            errors: Floats = 1.0 / np.sqrt(self._sums[:, 1])
        return errors

    @property
    def statistics(self) -> Floats:
        """Rao's statistic of each cause, s²/(I + (I σ)²), (n,): χ² with one degree of freedom where
        the cause is as the rig says.
        """
        score, information, _ = self._sums.T
        variances = information + (information * self.stds) ** 2
        return np.where(
            information > 0.0, score**2 / np.where(variances > 0.0, variances, 1.0), 0.0
        )

    @property
    def limit(self) -> float:
        """Number of standard errors beyond which a cause is significant among all: Student's t, of
        as many degrees of freedom as spans less one (Ibragimov and Müller, J. Business and Economic
        Statistics 28, 2010).
        """
        spans = len(span_sums(self.time[:, None], self.time))
        return float(stdtrit(max(spans - 1, 1), 1.0 - 0.5 * LEVEL / len(self.stds)))

    @property
    def significant(self) -> Bools:
        """Whether each cause is significant among all, (n,)."""
        return self.statistics > self.limit**2
