"""Least squares by columns of one size, and how well each coefficient is told."""

from __future__ import annotations

import numpy as np

from distal.arrays import Floats

INDEPENDENT = 10.0
"""So many samples, whose errors are alike, count as one. Source: judgement."""

CLEAR = 4.0
"""Inertia, damping and friction count that are so many standard errors above zero [1]. Source:
benchmark (`benchmarks.from_logs rigs`, seeds 7301 to 7304: 4 to 27 with inertia in the plant, else
below 2.5).
"""


def scaled_solution(matrix: Floats, target: Floats) -> tuple[Floats, float]:
    """Return the solution of least squares, (n,), by columns that are scaled to one size, and the
    RMS of what it leaves.

    Args:
        matrix: columns, (n_samples, n).
        target: (n_samples,).
    """
    size = np.maximum(np.sqrt(np.mean(matrix**2, axis=0)), 1e-300)
    solution = np.linalg.lstsq(matrix / size, target, rcond=1e-9)[0] / size
    return solution, float(np.sqrt(np.mean((target - matrix @ solution) ** 2)))


def relative_errors(matrix: Floats) -> Floats:
    """Return the standard errors of the coefficients, (n,), per RMS of what is left, where
    `INDEPENDENT` samples count as one.
    """
    size = np.maximum(np.sqrt(np.mean(matrix**2, axis=0)), 1e-300)
    scaled = matrix / size
    covariance = np.linalg.pinv(scaled.T @ scaled / INDEPENDENT)
    return np.asarray(np.sqrt(np.diag(covariance)) / size)
