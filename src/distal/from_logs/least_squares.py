"""Least squares by columns of one size, and from when on a term counts."""

from __future__ import annotations

import numpy as np

from distal.arrays import Floats

SHOWN = 0.7
"""Share of the residual that damping and inertia must leave at most, so that the logs show them
[1]. Source: benchmark (benchmarks/from_logs: rigs with inertia leave 0.25 to 0.5, others 0.8 or
more).
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
