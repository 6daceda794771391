"""The size of a band by the errors on logs left out (split conformal prediction by log; Lei et al., JASA 113, 2018)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

NORMAL = 1.959963984540054
"""The 97.5 % quantile of the normal distribution."""

COVERED = 0.95
"""Share of the errors that a band is to hold."""

Errors = tuple[Floats, Floats, Floats]
"""On a log: errors e, variances u that are scaled, and variances v that are not."""


def student(freedom: float) -> float:
    """Return by what a 95 % band is wider that knows its std from so many degrees of freedom: t_{0.975}/1.96.

    Args:
        freedom: degrees of freedom.
    """
    from scipy.special import stdtrit  # loaded late: it takes as long as all of distal

    return float(stdtrit(max(freedom, 1.0), 0.975)) / NORMAL


def conformal_factor(logs: Sequence[Errors], least: float, largest: float) -> float:
    """Return the least factor c for which, over all logs alike, 95 % of errors have e² ≤ 1.96² (c² u + v).

    Args:
        logs: the errors on each left-out log.
        least: smallest factor.
        largest: largest factor.
    """
    needed, weights = [], []
    for error, scaled, fixed in logs:
        if len(error):
            wanted = np.maximum(error**2 / NORMAL**2 - fixed, 0.0)
            needed.append(np.sqrt(wanted / np.maximum(scaled, 1e-30)))
            weights.append(np.full(len(error), 1.0 / len(error)))
    if not needed:
        return float(np.clip(1.0, least, largest))
    factors, share = np.concatenate(needed), np.concatenate(weights)
    order = np.argsort(factors)
    reached = np.cumsum(share[order]) / share.sum()
    at = min(int(np.searchsorted(reached, COVERED)), len(order) - 1)
    return float(np.clip(factors[order][at], least, largest))


def rms_beyond_noise(errors: Sequence[Sequence[Errors]], noise: float = 0.0) -> float:
    """Return the mean of RMS errors, of each log and joint alone, less the reference's own noise; NaN where there are none.

    Args:
        errors: of each log and joint.
        noise: std of the reference's random error, which no map can explain: its variance is taken off.
    """
    each = [
        np.sqrt(max(float(np.mean(error**2)) - noise**2, 0.0)) for log in errors for error, _, _ in log if len(error)
    ]
    return float(np.mean(each)) if each else float("nan")
