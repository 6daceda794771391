"""What an estimator believes at a time, and what a sample told it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from distal.arrays import Floats
from distal.estimators.report import NOTHING_REPORTED, Report
from distal.kernels import covariance_of, mean_of


@dataclass(frozen=True)
class Belief:
    """What an estimator believes at a time; immutable.

    Args:
        time: of the last sample [s].
        kernel_state: mean (n,), covariance (n, n) row by row, and what the estimator remembers
            of its inputs.
        size: number of states n.
        samples: how many samples it has taken in; the first one may have the belief's own stamp.
        output: of the last step's kernel, by which some states may be reported otherwise.
        report: which, and how.
    """

    time: float
    kernel_state: Floats
    size: int
    samples: int = 0
    output: Floats | None = None
    report: Report = NOTHING_REPORTED

    @property
    def mean(self) -> Floats:
        """State estimate as it is reported, (n,)."""
        mean: Floats = mean_of(self.kernel_state, self.size)
        return mean if self.output is None else self.report.means(mean[None], self.output[None])[0]

    @property
    def covariance(self) -> Floats:
        """Covariance of its error, (n, n)."""
        covariance: Floats = covariance_of(self.kernel_state, self.size)
        return (
            covariance
            if self.output is None
            else self.report.covariances(covariance[None], self.output[None])[0]
        )


@dataclass(frozen=True)
class Innovation:
    """What a sample told beyond the prediction: ln p(sample | past), and one value per measured
    channel, NaN where missing.

    It is measured minus predicted after the ones before it have been taken into account, so that
    they are independent, and has a predicted variance.
    """

    values: Floats
    variances: Floats
    log_likelihood: float

    @property
    def nis(self) -> float:
        """Normalised innovation squared, Σ ν²/S; χ² distributed with one degree per value that is
        there.
        """
        return float(np.nansum(self.values**2 / self.variances))


def innovation(values: Floats, variances: Floats) -> Innovation:
    """Return the innovation with its log-likelihood, −½ Σ (ν²/S + ln 2πS) over `values` ν that are
    there, `variances` S.
    """
    read = np.isfinite(values)
    terms = values[read] ** 2 / variances[read] + np.log(2 * np.pi * variances[read])
    return Innovation(values, variances, float(-0.5 * terms.sum()))
