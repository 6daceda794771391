"""The search for the most likely parameters: Fisher scoring in a trust region, several steps tried
side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distal.arrays import Bools, Floats
from distal.fitting.likelihood import Derivatives
from distal.fitting.problem import Problem

SETTLED = 5e-3
"""The search ends where the next step is predicted to gain less than this of −ln p: a tenth of a
standard error.
"""

ENOUGH = 0.3
ENOUGH_OF_EQUATIONS = 0.02
"""It ends too where two steps after each other gain less than this: a filter's −ln p has kinks of
this size.
"""

MOST_ITERATIONS = 30
MOST_OF_EQUATIONS = 50
"""So many iterations at most: one with a filter takes as long as a hundred with a rig's equations.
"""

WIDER = 4.0
"""Where a step gains too little, the next goes by slopes over so many times the distance."""

DAMPINGS = (1 / 8, 1.0, 8.0, 64.0)
"""Steps of so many times the damping of the last one are tried, side by side, beside the undamped
one.
"""

FIRST_DAMPING = 1e-2
LEAST_DAMPING = 1e-6
MOST_DAMPING = 100.0
"""Damping of the first iteration, and the range of all: shares of the information's diagonal that
are added to it.
"""

STRIDE = 0.5
"""So many times the undamped step is tried too: across a kink it is too long."""

STRAIGHT = 1.0
"""Where the undamped step gains so much less of −ln p than predicted, the valley is bent."""

MOST_BENT = 0.75
"""A step is bent by at most this share of its own length (Transtrum and Sethna 2012)."""

FIRST_WIDTH = 1e-2
"""The first slopes are taken over this share of a value, or of its scale where it may be zero."""

SLOPE_WIDTH = 0.3
"""Later ones over this share of what a number would be known to if all others were: over less,
kinks of friction look like information (docs/explanation/learning.md).
"""

SMALLEST_WIDTH = 1e-3
SMALLEST_NOISE_WIDTH = 0.05
"""Least such shares: of a number, and of a noise, which changes where a joint slips and so what it
seems to tell.
"""

COARSE_SHARE = 0.25
COARSE_LEAST = 400
COARSE_ITERATIONS = 8
"""The start is searched with the first quarter of each log, at least so many samples, in so many
iterations.
"""

STARTS = 16
"""Points drawn from the priors that are tried as starts beside the priors' mean."""

UNKNOWN_SPREAD = 2.0
"""Spread of those points where there is no prior, in units of the coordinate (a tenth of the
value).
"""

FIRST_ITERATIONS = 3
"""What the channels' values are worth is found again after so many iterations."""

Progress = Callable[[int, float], None]


@dataclass(frozen=True)
class Optimum:
    """Where a search ended: coordinates z, (n,), and −ln p there less constants, after so many
    iterations.

    It converged where it ended by itself, and was interrupted where the user stopped it.
    """

    z: Floats
    cost: float
    derivatives: Derivatives
    iterations: int = 0
    converged: bool = False
    interrupted: bool = False


def coarse_start(
    problem: Problem, seed: int, begin: Floats, progress: Progress | None = None
) -> Optimum:
    """Return where to begin: the end of a search with the beginnings of the logs.

    It begins at coordinates `begin`, (n,), or, where these are the priors' mean, at the likeliest
    of some points drawn from the priors.
    """
    zero = _inside(problem, begin)
    coarse = problem.beginning(COARSE_SHARE, COARSE_LEAST).assessed(zero)
    noise = np.array([part.noise for part, _ in problem.parts])
    spreads = np.where(
        noise, 0.0, np.where(np.isfinite(problem.prior_stds), problem.prior_stds, UNKNOWN_SPREAD)
    )
    rng = np.random.default_rng(seed)
    drawn = (
        []
        if begin.any()
        else [_inside(problem, spreads * rng.normal(size=problem.size)) for _ in range(STARTS)]
    )
    points = [zero, *drawn]
    likeliest = points[int(np.argmin(coarse.costs(points)))]
    return search(coarse.assessed(likeliest), likeliest, progress, most=COARSE_ITERATIONS)


def most_likely(
    problem: Problem, start: Floats, progress: Progress | None = None
) -> tuple[Problem, Optimum]:
    """Return the problem as its channels are worth at the end, and the most likely coordinates; see
    `search`.

    The search begins at `start`, (n,).
    """
    problem = problem.assessed(start)
    begun = search(problem, start, progress, most=FIRST_ITERATIONS)
    if begun.interrupted:
        return problem, begun
    problem = problem.assessed(begun.z)
    optimum = search(problem, begun.z, progress, near=begun.derivatives)
    return problem, replace(optimum, iterations=begun.iterations + optimum.iterations)


def search(
    problem: Problem,
    start: Floats,
    progress: Progress | None = None,
    *,
    most: int | None = None,
    fixed: Bools | None = None,
    near: Derivatives | None = None,
    at_start: Derivatives | None = None,
) -> Optimum:
    """Return the local minimum of −ln p that Fisher scoring leads to from a start.

    Each step solves (H + λ diag H) d = −g within the bounds, with Fisher's information H and the
    gradient g (Levenberg 1944, Marquardt 1963; Gupta and Mehra, IEEE TAC 19, 1974). Steps of
    several λ are tried at once, and the best is taken; the next iteration tries λ around its. Where
    the undamped step gains far less than predicted, −ln p is a bent valley, and steps are tried too
    that follow the bend, d + a/2 with (H + λ diag H) a = −Jᵀ r'' (Transtrum and Sethna,
    arXiv:1201.5885, 2012). Slopes are taken over what a number is known to, so that they are those
    of −ln p and not of its kinks. An interruption (Ctrl-C) ends it with the best so far.

    Args:
        start: coordinates, (n,).
        progress: called with the iteration and −ln p after each step.
        most: iterations; default those of a filter's search, or of equations'.
        fixed: coordinates that stay as they are, (n,).
        near: derivatives near the start, by which the widths of the slopes are chosen.
        at_start: derivatives at the start, where they are known already.
    """
    free = np.ones(problem.size, dtype=bool) if fixed is None else ~fixed
    z = _inside(problem, start)
    near_by = near if at_start is None else at_start
    widths = first_widths(problem) if near_by is None else widths_at(problem, z, near_by)
    n = problem.size  # an interruption may come before anything is known
    optimum = Optimum(
        z, np.inf, Derivatives(np.inf, np.zeros(n), np.zeros((n, n)), np.zeros((n, n)), 0)
    )
    wider = 1.0
    damping = FIRST_DAMPING
    bent = False
    try:
        derivatives = (
            problem.derivatives(z, np.where(free, widths, 0.0)) if at_start is None else at_start
        )
        # what logs are worth may be told apart from others there: the cost is this problem's own
        cost = derivatives.cost if at_start is None else float(problem.costs([z])[0])
        optimum = Optimum(z, cost, derivatives)
        equations = problem.asks_equations
        last = (MOST_OF_EQUATIONS if equations else MOST_ITERATIONS) if most is None else most
        enough = ENOUGH_OF_EQUATIONS if equations else ENOUGH
        for iteration in range(1, last + 1):
            dampings = [0.0, *(damping * times for times in DAMPINGS)]
            steps = [
                damped_step(problem, optimum.z, derivatives, free, share) for share in dampings
            ]
            optimum = replace(optimum, iterations=iteration)
            predicted = steps[0][1]
            if predicted < SETTLED:
                return replace(optimum, converged=True)
            tried = [
                (0.0, STRIDE * steps[0][0]),
                *((share, step) for share, (step, _) in zip(dampings, steps)),
            ]
            if bent:
                tried += _bent(problem, optimum.z, derivatives, free, tried[2:])
            points = [_inside(problem, optimum.z + step) for _, step in tried]
            costs = problem.costs(points)
            best = int(np.argmin(costs))
            gained = optimum.cost - float(costs[best])
            if progress is not None:
                progress(iteration, min(float(costs[best]), optimum.cost))
            if gained > 0.0:
                optimum = replace(optimum, z=points[best], cost=float(costs[best]))
            if gained < enough and wider > 1.0:
                return replace(optimum, converged=True)
            wider = WIDER if gained < enough else 1.0
            bent = predicted > gained + STRAIGHT
            following = (
                max(tried[best][0], damping * DAMPINGS[0])
                if gained > 0.0
                else damping * DAMPINGS[-1]
            )
            damping = min(max(following, LEAST_DAMPING), MOST_DAMPING)
            if iteration < last:
                widths = wider * widths_at(problem, optimum.z, derivatives)
                derivatives = problem.derivatives(optimum.z, np.where(free, widths, 0.0))
                optimum = replace(optimum, derivatives=derivatives)
    except KeyboardInterrupt:
        return replace(optimum, interrupted=True)
    return optimum


def _bent(
    problem: Problem,
    z: Floats,
    derivatives: Derivatives,
    free: Bools,
    tried: Sequence[tuple[float, Floats]],
) -> list[tuple[float, Floats]]:
    """Return each tried damped step, (n,), with its bend, and its damping."""
    scale = np.sqrt(np.maximum(np.diag(hessian(problem, derivatives)), 1e-12))
    bent_steps = []
    bends = problem.bends(z, derivatives.of_logs, [step for _, step in tried])
    for (damping, step), bend in zip(tried, bends):
        correction = damped_step(
            problem, z + step, replace(derivatives, gradient=bend), free, damping
        )[0]
        length = float(np.linalg.norm(correction * scale))
        along = float(np.linalg.norm(step * scale))
        bent_steps.append(
            (damping, step + 0.5 * min(1.0, MOST_BENT * along / max(length, 1e-300)) * correction)
        )
    return bent_steps


def hessian(problem: Problem, derivatives: Derivatives) -> Floats:
    """Return the information of logs and prior together, (n, n)."""
    n = problem.size
    # a very wide prior keeps what neither logs nor priors know from dividing by zero
    information: Floats = (
        derivatives.information + np.diag(1.0 / problem.prior_stds**2) + 1e-12 * np.eye(n)
    )
    return information


def first_widths(problem: Problem) -> Floats:
    """Return the distance over which the first slopes are taken, (n,)."""
    return np.array([FIRST_WIDTH * part.unit(0.0) for part, _ in problem.parts])


def widths_at(problem: Problem, z: Floats, derivatives: Derivatives) -> Floats:
    """Return the distance over which slopes are taken at z, (n,): `SLOPE_WIDTH` of what each number
    alone is known to.

    As a share of the value it is a power of two, so that two numbers that show only as a product
    meet the same kinks.
    """
    units = np.array([part.unit(float(at)) for (part, _), at in zip(problem.parts, z)])
    alone = 1.0 / np.sqrt(np.maximum(np.diag(hessian(problem, derivatives)), 1e-300))
    least = np.where(
        [part.noise for part, _ in problem.parts], SMALLEST_NOISE_WIDTH, SMALLEST_WIDTH
    )
    share = np.clip(SLOPE_WIDTH * alone / units, least, FIRST_WIDTH * 8)
    widths: Floats = units * 2.0 ** np.round(np.log2(share))
    return widths


def _inside(problem: Problem, z: Floats) -> Floats:
    return np.clip(z, *problem.bounds.T)


def damped_step(
    problem: Problem, z: Floats, derivatives: Derivatives, free: Bools, damping: float = 0.0
) -> tuple[Floats, float]:
    """Return the step of Fisher scoring within the bounds, and by how much the quadratic model
    lowers −ln p.

    It leads from z, (n,), along the `free` coordinates, (n,), with `damping` λ.
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
