"""The search for the most likely numbers: Fisher scoring in a trust region, several steps tried side by side."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from distal.fitting.likelihood import Derivatives
from distal.fitting.problem import Problem

Floats = NDArray[np.float64]

MOST_ITERATIONS = 60

SMALLEST_GAIN = 3e-2
"""The search ends where the next step is predicted to gain less than this of −ln p: a quarter of a standard error."""

COARSEST = 16.0
"""Where no step leads down, slopes are taken over up to so many times the distance before the search ends."""

DAMPINGS = (1e-4, 1e-2, 1.0, 100.0)
"""Shares of the information's diagonal that are added to it: a step of each is tried, side by side."""

STRIDES = (1.0, 4.0, 16.0)
"""So many times the last step is tried too, from where it ended: in a bent valley every step is short."""

FIRST_WIDTH = 1e-2
"""The first slopes are taken over this share of a value on either side, or of its scale where it may be zero."""

SLOPE_WIDTH = 0.3
"""Later ones over this share of what a number would be known to if all others were: over less, kinks of friction look like
information (docs/explanation/learning.md)."""

SMALLEST_WIDTH, SMALLEST_NOISE_WIDTH = 1e-3, 0.05
"""Least such shares: of a number, and of a noise, which changes where a joint slips and so what it seems to tell."""

COARSE_SHARE, COARSE_LEAST, COARSE_ITERATIONS = 0.25, 400, 20
"""The start is searched with the first quarter of each log, at least so many samples, in so many iterations."""

STARTS = 16
"""Points drawn from the priors that are tried as starts beside the priors' mean."""

UNKNOWN_SPREAD = 2.0
"""Spread of those points where there is no prior, in units of the coordinate (a tenth of the value)."""

PROBES, PROBE_SIZE, PROBE_ROUNDS = 7, 0.5, 3
"""After the search so many points are tried, so many standard errors away, and it goes on from a lower one."""

LOUDER = (1.0, 2.0, 3.0)
"""Coarse searches begin with noise larger by this, in logarithms; the next only where the one before is not accepted."""

ACCEPTED = 1.5
"""Mean ν²/S of every channel below which the end of the first coarse search is accepted, and no other start is tried."""

NEAR_GAIN = 1.0
"""Slopes are taken on both sides where the next step is predicted to gain less than this of −ln p."""


Progress = Callable[[int, float], None]


@dataclass(frozen=True)
class Found:
    """Where a search ended.

    Args:
        z: coordinates, (n,).
        cost: −ln p there, less constants.
        derivatives: there.
        iterations: accepted and refused ones.
        converged: whether it ended by itself.
        interrupted: whether the user stopped it.
    """

    z: Floats
    cost: float
    derivatives: Derivatives
    iterations: int = 0
    converged: bool = False
    interrupted: bool = False


def most_likely(problem: Problem, seed: int, progress: Progress | None = None, begin: Floats | None = None) -> Found:
    """Return the most likely coordinates: a coarse search from several starts, then a fine one from the best end.

    Args:
        problem: what is minimised.
        seed: of the starts.
        progress: called with the iteration and −ln p after each step.
        begin: coordinates to begin with instead of the priors' mean, (n,).
    """
    rng = np.random.default_rng(seed)
    coarse = problem.beginning(COARSE_SHARE, COARSE_LEAST)
    noise = np.array([part.noise for part, _ in problem.parts])
    zero = np.zeros(problem.size) if begin is None else np.asarray(begin, dtype=np.float64)
    # with more noise than there is −ln p has fewer valleys
    begins = [_inside(problem, np.where(noise, zero + louder, zero)) for louder in LOUDER]
    spreads = np.where(noise, 0.0, np.where(np.isfinite(problem.prior_stds), problem.prior_stds, UNKNOWN_SPREAD))
    drawn = [_inside(problem, begins[0] + spreads * rng.normal(size=problem.size)) for _ in range(STARTS)]
    ends = list[Found]()
    for k in range(len(begins) + 1 if begin is None else 1):
        start = begins[k] if k < len(begins) else drawn[int(np.argmin(coarse.costs(drawn)))]
        ends.append(search(coarse, start, progress, most=COARSE_ITERATIONS, central=False))
        if ends[-1].interrupted or _accepted(coarse, ends[-1]):
            break
    points = [zero, *(end.z for end in ends)]
    costs = problem.costs(points)
    best = int(np.argmin(costs))
    if ends[-1].interrupted:
        return replace(ends[-1], z=points[best], cost=float(costs[best]))
    found = search(problem, points[best], progress)
    return polished(problem, found, rng, progress)


def _accepted(problem: Problem, found: Found) -> bool:
    """Return whether a search ended where every channel is as the filter expects it: no other valley is looked for."""
    runs = problem.at(found.z)
    values, variances = (np.vstack([getattr(run, name) for run in runs]) for name in ("values", "variances"))
    known = np.isfinite(values).any(axis=0)
    ratios = np.nanmean(values[:, known] ** 2 / variances[:, known], axis=0)
    return bool(found.converged and np.all(ratios < ACCEPTED))


def polished(problem: Problem, found: Found, rng: np.random.Generator, progress: Progress | None = None) -> Found:
    """Return the end of a search that goes on while a point near by, drawn from its standard errors, is lower.

    Args:
        problem: what is minimised.
        found: where the search ended.
        rng: draws the points.
        progress: see `most_likely`.
    """
    try:
        for _ in range(PROBE_ROUNDS):
            if found.interrupted or not found.converged:
                break
            step = np.linalg.cholesky(np.linalg.inv(hessian(problem, found.derivatives)))
            near = [
                _inside(problem, found.z + PROBE_SIZE * step @ rng.normal(size=problem.size)) for _ in range(PROBES)
            ]
            costs = problem.costs(near)
            best = int(np.argmin(costs))
            if not costs[best] < found.cost - SMALLEST_GAIN:
                break
            again = search(problem, near[best], progress, first=found.derivatives)
            found = replace(again, iterations=found.iterations + again.iterations)
    except KeyboardInterrupt:
        return replace(found, interrupted=True)
    return found


def search(
    problem: Problem,
    start: Floats,
    progress: Progress | None = None,
    *,
    most: int = MOST_ITERATIONS,
    fixed: NDArray[np.bool_] | None = None,
    first: Derivatives | None = None,
    known: Derivatives | None = None,
    central: bool = True,
) -> Found:
    """Return the local minimum of −ln p that Fisher scoring leads to from a start.

    Each step solves (H + λ diag H) d = −g within the bounds, with Fisher's information H and the gradient g (Levenberg
    1944, Marquardt 1963; Gupta and Mehra, IEEE TAC 19, 1974). Steps of all `DAMPINGS` λ are tried at once, and the best is
    taken. Slopes are taken over what a number is known to, so that they are those of −ln p and not of its kinks. An
    interruption (Ctrl-C) ends it with the best so far.

    Args:
        problem: what is minimised.
        start: coordinates, (n,).
        progress: called with the iteration and −ln p after each step.
        most: iterations.
        fixed: coordinates that stay as they are, (n,).
        first: derivatives near the start, by which the widths of the slopes are chosen.
        known: those at the start, where they are known already.
        central: take slopes on both sides near the end; else on one side only.
    """
    free = np.ones(problem.size, dtype=bool) if fixed is None else ~fixed
    z = _inside(problem, start)
    near_by = first if known is None else known
    widths = first_widths(problem) if near_by is None else widths_at(problem, z, near_by)
    nothing = np.zeros((problem.size, problem.size))  # an interruption may come before anything is known
    found = Found(z, np.inf, Derivatives(np.inf, np.zeros(problem.size), nothing, nothing, 0))
    coarser, near, last = 1.0, False, np.zeros(problem.size)
    try:
        derivatives = problem.derivatives(z, np.where(free, widths, 0.0), False) if known is None else known
        found = Found(z, derivatives.cost, derivatives)
        for iteration in range(1, most + 1):
            steps = [damped_step(problem, found.z, derivatives, free, damping) for damping in DAMPINGS]
            found, predicted = replace(found, iterations=iteration), steps[0][1]
            ahead = [_inside(problem, found.z + share * last) for share in STRIDES if last.any()]
            points = [*(found.z + step for step, _ in steps), *ahead]
            costs = problem.costs(points) if predicted >= SMALLEST_GAIN else np.full(1, np.inf)
            best = int(np.argmin(costs))
            if progress is not None:
                progress(iteration, min(float(costs[best]), found.cost))
            gained = found.cost - float(costs[best])
            if gained >= SMALLEST_GAIN:
                last = points[best] - found.z
                found = replace(found, z=points[best], cost=float(costs[best]))
                near = central and (near or predicted < NEAR_GAIN)
            elif central and not near:
                near = True
            elif predicted >= SMALLEST_GAIN and coarser < COARSEST:
                coarser *= 4.0  # no way down by these slopes: they may be those of a kink
            else:
                return replace(found, converged=True)
            widths = coarser * widths_at(problem, found.z, derivatives)
            derivatives = problem.derivatives(found.z, np.where(free, widths, 0.0), near)
            found = replace(found, derivatives=derivatives)
    except KeyboardInterrupt:
        return replace(found, interrupted=True)
    return found


def hessian(problem: Problem, derivatives: Derivatives) -> Floats:
    """Return the information of logs and prior together, (n, n).

    Args:
        problem: with the prior.
        derivatives: at a point.
    """
    n = problem.size
    # a very wide prior keeps what neither logs nor priors know from dividing by zero
    whole: Floats = derivatives.information + np.diag(1.0 / problem.prior_stds**2) + 1e-12 * np.eye(n)
    return whole


def first_widths(problem: Problem) -> Floats:
    """Return half of the distance over which the first slopes are taken, (n,).

    Args:
        problem: with its coordinates.
    """
    return np.array([FIRST_WIDTH * part.unit(0.0) for part, _ in problem.parts])


def widths_at(problem: Problem, z: Floats, derivatives: Derivatives) -> Floats:
    """Return half of the distance over which slopes are taken, (n,): `SLOPE_WIDTH` of what each number alone is known to.

    As a share of the value it is a power of two, so that two numbers that show only as a product meet the same kinks.

    Args:
        problem: with its coordinates.
        z: the point, (n,).
        derivatives: there or near by.
    """
    units = np.array([part.unit(float(at)) for (part, _), at in zip(problem.parts, z)])
    alone = 1.0 / np.sqrt(np.maximum(np.diag(hessian(problem, derivatives)), 1e-300))
    least = np.where([part.noise for part, _ in problem.parts], SMALLEST_NOISE_WIDTH, SMALLEST_WIDTH)
    share = np.clip(SLOPE_WIDTH * alone / units, least, FIRST_WIDTH * 8)
    widths: Floats = units * 2.0 ** np.round(np.log2(share))
    return widths


def _inside(problem: Problem, z: Floats) -> Floats:
    return np.clip(z, *problem.bounds.T)


def damped_step(
    problem: Problem, z: Floats, derivatives: Derivatives, free: NDArray[np.bool_], damping: float = 0.0
) -> tuple[Floats, float]:
    """Return the step of Fisher scoring within the bounds, and by how much the quadratic model lowers −ln p.

    Args:
        problem: what is minimised.
        z: the point, (n,).
        derivatives: there.
        free: which coordinates move, (n,).
        damping: λ.
    """
    whole, gradient = hessian(problem, derivatives)[np.ix_(free, free)], derivatives.gradient[free]
    scale = np.sqrt(np.maximum(np.diag(whole), 1e-12))
    scaled = whole / np.outer(scale, scale) + (damping + 1e-9) * np.eye(len(scale))
    factor = np.linalg.cholesky((scaled + scaled.T) / 2)
    target = -np.linalg.solve(factor, gradient / scale)
    own = np.linalg.solve(factor.T, target)
    low, high = ((edge - z)[free] * scale for edge in problem.bounds.T)
    if np.any(own < low) or np.any(own > high):
        from scipy.optimize import lsq_linear  # not needed before

        # a coordinate at its bound still needs room for the solver
        room = np.minimum(low, -1e-12), np.maximum(high, 1e-12)
        own = lsq_linear(factor.T, target, room, method="bvls" if len(scale) <= 60 else "trf").x
    step = np.zeros(len(z))
    step[free] = own / scale
    step = _inside(problem, z + step) - z
    predicted = -float(gradient @ step[free] + 0.5 * step[free] @ whole @ step[free])
    return step, predicted
