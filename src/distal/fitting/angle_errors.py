"""What the angle errs by without its reference: how surprising that is to the filter, and how much it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from distal.fitting.problem import Problem

Floats = NDArray[np.float64]


def surprise_of(problem: Problem, z: Floats) -> float:
    """Return the mean of ν²/S of the references beyond their offsets, the largest of all; infinite where the filter left
    all bounds.

    An offset that is hardly known hides what the angle errs by beside it: each log's mean is taken off ν, and its variance
    off S.

    Args:
        problem: of a fit in which references are compared and not used.
        z: coordinates, (n,).
    """
    worst, measured = 0.0, problem.measured
    innovations = problem.at(z)
    for sensor in problem.filter.references:
        k, ratios = measured.index(sensor.name), list[float]()
        for run in innovations:
            values, variances = run.values, run.variances
            away = values[:, k] - np.nanmean(values[:, k]) if np.isfinite(values[:, k]).any() else values[:, k]
            own = np.maximum(variances[:, k] - sensor.bias.filter_std**2, 0.1 * variances[:, k])
            ratios += list((away**2 / own)[np.isfinite(away)])
        if ratios:
            worst = max(worst, float(np.mean(ratios)))
    return worst
