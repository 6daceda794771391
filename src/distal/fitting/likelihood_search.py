"""The search for the most likely parameters: Fisher scoring in a trust region, with several steps
tried side by side.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from distal.arrays import Bools, Floats
from distal.fitting.likelihood import Derivatives
from distal.fitting.objective import Problem

Progress = Callable[[int, float], None]
"""A function that is called with the iteration and −ln p after each step."""


@dataclass(frozen=True)
class Optimum:
    """The end of a search.

    Args:
        z: the coordinates, (n,).
        cost: −ln p there, less constants.
        derivatives: derivatives of −ln p at the end or one step before it.
        converged: whether the search ended by itself.
        interrupted: whether the user interrupted it.
    """

    z: Floats
    cost: float
    derivatives: Derivatives
    converged: bool = False
    interrupted: bool = False


def most_likely(
    problem: Problem, start: Floats, progress: Progress | None = None
) -> tuple[Problem, Optimum]:
    """Return the problem, with the weights of its channels as found near the end, and the most
    likely coordinates; see `search`.

    The search begins at `start`, (n,).
    """
    problem = problem.assessed(start)
    begun = search(problem, start, progress, most=problem.settings.first_iterations)
    if begun.interrupted:
        return problem, begun
    problem = problem.assessed(begun.z)
    return problem, search(problem, begun.z, progress, near=begun.derivatives)


def search(
    problem: Problem,
    start: Floats,
    progress: Progress | None = None,
    *,
    most: int | None = None,
    fixed: Bools | None = None,
    near: Derivatives | None = None,
) -> Optimum:
    """Return the local minimum of −ln p that Fisher scoring leads to from a start.

    Each step solves (H + λ diag H) d = −g within the bounds, with Fisher's information H and the
    gradient g (Levenberg 1944, Marquardt 1963; Gupta and Mehra, IEEE TAC 19, 1974). Steps with
    several λ are tried at once, and the best is taken; the next iteration tries λ around its λ.
    Slopes are differences over a share of each parameter's std, wider than the kinks of −ln p. An
    interruption (Ctrl-C) ends the search with the best point so far.

    Args:
        problem: what is minimised.
        start: coordinates, (n,).
        progress: called with the iteration and −ln p after each step.
        most: largest number of iterations; default `SearchSettings.iterations`.
        fixed: which coordinates stay as they are, (n,).
        near: derivatives near the start, which give the widths of the first differences.
    """
    settings = problem.settings
    free = np.ones(problem.size, dtype=bool) if fixed is None else ~fixed
    z = _inside(problem, start)
    widths = first_widths(problem) if near is None else widths_at(problem, z, near)
    n = problem.size  # an interruption may come before the first derivatives
    optimum = Optimum(
        z, np.inf, Derivatives(np.inf, np.zeros(n), np.zeros((n, n)), np.zeros((n, n)), 0)
    )
    wider = 1.0
    damping = settings.first_damping
    try:
        derivatives = problem.derivatives(z, np.where(free, widths, 0.0))
        optimum = Optimum(z, derivatives.cost, derivatives)
        last = settings.iterations if most is None else most
        for iteration in range(1, last + 1):
            dampings = [0.0, *(damping * times for times in settings.dampings)]
            steps = [
                damped_step(problem, optimum.z, derivatives, free, share) for share in dampings
            ]
            predicted = steps[0][1]
            if predicted < settings.settled:
                return replace(optimum, converged=True)
            points = [_inside(problem, optimum.z + step) for step, _ in steps]
            costs = problem.costs(points)
            best = int(np.argmin(costs))
            gained = optimum.cost - float(costs[best])
            if progress is not None:
                progress(iteration, min(float(costs[best]), optimum.cost))
            if gained > 0.0:
                optimum = replace(optimum, z=points[best], cost=float(costs[best]))
            if gained < settings.enough and wider > 1.0:
                return replace(optimum, converged=True)
            wider = settings.wider if gained < settings.enough else 1.0
            following = (
                max(dampings[best], damping * settings.dampings[0])
                if gained > 0.0
                else damping * settings.dampings[-1]
            )
            damping = max(following, settings.least_damping)
            if iteration < last:
                widths = wider * widths_at(problem, optimum.z, derivatives)
                derivatives = problem.derivatives(optimum.z, np.where(free, widths, 0.0))
                optimum = replace(optimum, derivatives=derivatives)
    except KeyboardInterrupt:
        return replace(optimum, interrupted=True)
    return optimum


def hessian(problem: Problem, derivatives: Derivatives) -> Floats:
    """Return the information of logs and priors together, (n, n)."""
    n = problem.size
    # a very wide prior, so that no unknown direction leads to a division by zero
    information: Floats = derivatives.information + problem.prior_information + 1e-12 * np.eye(n)
    return information


def first_widths(problem: Problem) -> Floats:
    """Return the width of the differences that give the first slopes, (n,)."""
    return np.array([problem.settings.first_width * part.unit(0.0) for part, _ in problem.parts])


def widths_at(problem: Problem, z: Floats, derivatives: Derivatives) -> Floats:
    """Return the width of the differences that give the slopes at z, (n,): the settings'
    `slope_width` of each parameter's std if all others were known.

    As a share of the value it is rounded to a power of two, so that two parameters that show only
    as a product meet the same kinks.
    """
    settings = problem.settings
    units = np.array([part.unit(float(at)) for (part, _), at in zip(problem.parts, z)])
    alone = 1.0 / np.sqrt(np.maximum(np.diag(hessian(problem, derivatives)), 1e-300))
    least = np.where(
        [part.noise for part, _ in problem.parts],
        settings.smallest_noise_width,
        settings.smallest_width,
    )
    share = np.clip(settings.slope_width * alone / units, least, settings.first_width * 8)
    widths: Floats = units * 2.0 ** np.round(np.log2(share))
    return widths


def _inside(problem: Problem, z: Floats) -> Floats:
    return np.clip(z, *problem.bounds.T)


def damped_step(
    problem: Problem, z: Floats, derivatives: Derivatives, free: Bools, damping: float = 0.0
) -> tuple[Floats, float]:
    """Return a step of Fisher scoring within the bounds, (n,), and by how much the quadratic model
    predicts that it lowers −ln p.

    The step starts at z, (n,), goes along the `free` coordinates, (n,), and has the `damping` λ.
    """
    information = hessian(problem, derivatives)[np.ix_(free, free)]
    gradient = derivatives.gradient[free]
    scale = np.sqrt(np.maximum(np.diag(information), 1e-12))
    scaled = information / np.outer(scale, scale) + (damping + 1e-9) * np.eye(len(scale))
    factor = np.linalg.cholesky((scaled + scaled.T) / 2)
    target = -np.linalg.solve(factor, gradient / scale)
    scaled_step = np.linalg.solve(factor.T, target)
    low, high = ((edge - z)[free] * scale for edge in problem.bounds.T)
    if np.any(scaled_step < low) or np.any(scaled_step > high):
        from scipy.optimize import lsq_linear  # not needed before

        # a coordinate at its bound still needs room for the solver
        room = np.minimum(low, -1e-12), np.maximum(high, 1e-12)
        scaled_step = lsq_linear(
            factor.T, target, room, method="bvls" if len(scale) <= 60 else "trf"
        ).x
    step = np.zeros(len(z))
    step[free] = scaled_step / scale
    step = _inside(problem, z + step) - z
    predicted = -float(gradient @ step[free] + 0.5 * step[free] @ information @ step[free])
    return step, predicted
