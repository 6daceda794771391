"""The belief of an estimator at a time, and the innovation of a sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from distal.arrays import Floats
from distal.estimators.report import NOTHING_REPORTED, Report
from distal.kernels import covariance_of, mean_of
from distal.logs import frozen


@dataclass(frozen=True)
class Belief:
    """The mean and covariance that an estimator believes at a time; immutable.

    Args:
        time: stamp of the last sample [s].
        kernel_state: mean (n,), covariance (n, n) row by row, and what the estimator remembers of
            its inputs.
        size: number of states n.
        samples: number of samples taken in; the first one may have the belief's own stamp.
        output: output y of the kernel at the last step, from which `report` takes values of some
            states; None before the first.
        report: the states that a learned map corrects or replaces, and where in y their values
            stand.
    """

    time: float
    kernel_state: Floats
    size: int
    samples: int = 0
    output: Floats | None = None
    report: Report = NOTHING_REPORTED

    @property
    def mean(self) -> Floats:
        """The reported estimate of the states, (n,)."""
        mean: Floats = mean_of(self.kernel_state, self.size)
        if self.output is None:
            return mean
        return frozen(self.report.means(mean[None], self.output[None])[0])

    @property
    def covariance(self) -> Floats:
        """The reported covariance of the estimate's error, (n, n)."""
        covariance: Floats = covariance_of(self.kernel_state, self.size)
        if self.output is None:
            return covariance
        return frozen(self.report.covariances(covariance[None], self.output[None])[0])


@dataclass(frozen=True)
class Innovation:
    """The innovations of one sample: one value and one variance per compared channel, (m,), NaN
    where the value is missing, and ln p(sample | past).

    Each value is measured minus predicted, the prediction having already used the channels before
    it: so the values are independent.
    """

    values: Floats
    variances: Floats
    log_likelihood: float

    @property
    def nis(self) -> float:
        """Normalised innovation squared, Σ ν²/S; χ² distributed, with one degree of freedom for
        each value that is present.
        """
        return float(np.nansum(self.values**2 / self.variances))


def innovation(values: Floats, variances: Floats) -> Innovation:
    """Return the innovation with its log-likelihood, −½ Σ (ν²/S + ln 2πS), summed over the finite
    ones of the `values` ν, (m,); their `variances` are S, (m,).
    """
    read = np.isfinite(values)
    terms = values[read] ** 2 / variances[read] + np.log(2 * np.pi * variances[read])
    return Innovation(values, variances, float(-0.5 * terms.sum()))
