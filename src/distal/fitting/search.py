"""Fisher scoring within bounds: the search for the most likely parameters, which can be interrupted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from distal.fitting.likelihood import Derivatives, Likelihood

Floats = NDArray[np.float64]

MOST_ITERATIONS = 40

ENOUGH = 1e-2
"""The search ends where the next step is predicted to gain less than this of −ln p: a tenth of a standard error."""

SMALLEST_DAMPING, LARGEST_DAMPING = 1e-6, 1e8


@dataclass(frozen=True)
class Found:
    """Where a search ended.

    Args:
        z: coordinates, (n,).
        cost: −ln p there, less constants.
        iterations: accepted and refused steps.
        converged: whether it ended by itself.
        interrupted: whether the user stopped it.
    """

    z: Floats
    cost: float
    iterations: int
    converged: bool
    interrupted: bool = False


Progress = Callable[[int, float], None]


def search(
    likelihood: Likelihood, start: Floats, progress: Progress | None = None, most: int = MOST_ITERATIONS
) -> Found:
    """Return the local minimum of −ln p that damped Fisher scoring leads to from a start.

    Each step solves (H + λ diag H) d = −g within the bounds (a bounded linear least squares), with Fisher's information
    H and the exact gradient g (Levenberg 1944, Marquardt 1963; Gupta and Mehra, IEEE TAC 19, 1974). A step that does not
    lower −ln p is shortened. An interruption (Ctrl-C) ends it with the best so far.

    Args:
        likelihood: what to minimise.
        start: coordinates, (n,).
        progress: called with the iteration and the cost after each step.
        most: iterations.
    """
    bounds = np.array([part.bounds for part, _ in likelihood.parts()]).reshape(-1, 2)
    best = Found(np.clip(start, bounds[:, 0], bounds[:, 1]), np.inf, 0, False)
    try:
        derivatives = likelihood.derivatives(best.z)
        best = replace(best, cost=derivatives.cost)
        damping = 1e-2
        for iteration in range(1, most + 1):
            step, predicted = _step(derivatives, best.z, bounds, damping)
            best = replace(best, iterations=iteration)
            if predicted < ENOUGH:
                return replace(best, converged=True)
            cost = likelihood.cost(best.z + step)
            if progress is not None:
                progress(iteration, min(cost, best.cost))
            if cost < best.cost:
                decrease = best.cost - cost
                best = replace(best, z=best.z + step, cost=cost)
                damping = max(damping * (0.2 if decrease > 0.5 * predicted else 1.0), SMALLEST_DAMPING)
                if decrease < ENOUGH:
                    return replace(best, converged=True)
                derivatives = likelihood.derivatives(best.z)
            else:
                damping *= 10.0
                if damping > LARGEST_DAMPING:
                    # no way down: a kink of friction, finer than the steps of the differences
                    return replace(best, converged=True)
    except KeyboardInterrupt:
        return replace(best, interrupted=True)
    return best


def _step(derivatives: Derivatives, z: Floats, bounds: Floats, damping: float) -> tuple[Floats, float]:
    """Return the damped step within the bounds, and by how much the quadratic model lowers the cost."""
    from scipy.optimize import lsq_linear

    hessian = derivatives.information + derivatives.prior
    scale = np.sqrt(np.maximum(np.diag(hessian), 1e-12))
    scaled = hessian / np.outer(scale, scale) + (damping + 1e-9) * np.eye(len(z))
    factor = np.linalg.cholesky((scaled + scaled.T) / 2)
    target = -np.linalg.solve(factor, derivatives.gradient / scale)
    low, high = (bounds[:, 0] - z) * scale, (bounds[:, 1] - z) * scale
    # a coordinate at its bound still needs room for the solver
    low, high = np.minimum(low, -1e-12), np.maximum(high, 1e-12)
    step = lsq_linear(factor.T, target, (low, high), method="bvls" if len(z) <= 60 else "trf").x / scale
    step = np.clip(z + step, bounds[:, 0], bounds[:, 1]) - z
    predicted = -float(derivatives.gradient @ step + 0.5 * step @ hessian @ step)
    return step, predicted
