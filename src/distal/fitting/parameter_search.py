"""The estimation of a rig's parameters, by its equations where these can be asked, and by its
filter: a search for the most likely ones (Fisher scoring in a trust region, with several steps
tried side by side), standard errors, and the reasons not to trust them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distal.arrays import Bools, Floats
from distal.errors import FitError
from distal.fitting.inverse_dynamics import SMOOTHED, Equations, inverse_problem
from distal.fitting.likelihood import Derivatives, FitFilter, Problem
from distal.fitting.parameters_and_priors import (
    FittedParameter,
    Free,
    Options,
    Progress,
    assignments,
    choose,
)
from distal.homing import added_reference, with_references
from distal.logs import Log, true_angles
from distal.model import joint_frequency
from distal.rig import Rig, part_at

OnStep = Callable[[int, float], None]
"""A function that is called with the iteration and −ln p after each step."""


SETTLED = 5e-3
"""Predicted gain of −ln p in the next step, below which a search ends: that of a tenth of a
standard error. Source: benchmark (python -m benchmarks.searches).
"""

ENOUGH = 0.3
"""Gain of −ln p, below which two steps in a row end a search: the kinks of a filter's −ln p.
Source: benchmark (python -m benchmarks.searches).
"""

ITERATIONS = 30
"""Largest number of iterations. Source: benchmark (python -m benchmarks.searches)."""

FIRST_ITERATIONS = 3
"""Number of iterations after which the weights of the channels' values are found again. Source:
benchmark (python -m benchmarks.searches).
"""

FIRST_DAMPING = 1e-2
"""Damping of the first iteration, the share of the information's diagonal that is added to it.
Source: benchmark (python -m benchmarks.searches).
"""

LEAST_DAMPING = 1e-6
"""Least such damping. Source: benchmark (python -m benchmarks.searches)."""

DAMPINGS = (1 / 8, 8.0)
"""Factors on the damping of the last step: steps with these dampings are tried side by side, beside
the undamped one. Source: benchmark (python -m benchmarks.searches).
"""

FIRST_WIDTH = 1e-2
"""Width of the differences that give the first slopes, as a share of a value, or of its scale where
it may be zero. Source: benchmark (python -m benchmarks.searches).
"""

SLOPE_WIDTH = 0.3
"""Width of the later ones, as a share of the std that a parameter would have if all others were
known: over less, kinks of friction look like information (docs/explanation/learning.md). Source:
benchmark (python -m benchmarks.searches).
"""

SMALLEST_WIDTH = 1e-3
"""Least width, as a share of a parameter's value. Source: benchmark (python -m
benchmarks.searches).
"""

SMALLEST_NOISE_WIDTH = 0.05
"""The same for the size of a noise, which also changes where a joint slips. Source: benchmark
(python -m benchmarks.searches).
"""

WIDER = 4.0
"""Factor on the width after a step that gained too little. Source: benchmark (python -m
benchmarks.searches).
"""


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
    problem: Problem, start: Floats, progress: OnStep | None = None
) -> tuple[Problem, Optimum]:
    """Return the problem, with the weights of its channels as found near the end, and the most
    likely coordinates; see `search`.

    The search begins at `start`, (n,).
    """
    problem = problem.assessed(start)
    begun = search(problem, start, progress, most=FIRST_ITERATIONS)
    if begun.interrupted:
        return problem, begun
    problem = problem.assessed(begun.z)
    return problem, search(problem, begun.z, progress, near=begun.derivatives)


def search(
    problem: Problem,
    start: Floats,
    progress: OnStep | None = None,
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
        most: largest number of iterations; default `ITERATIONS`.
        fixed: which coordinates stay as they are, (n,).
        near: derivatives near the start, which give the widths of the first differences.
    """
    free = np.ones(problem.size, dtype=bool) if fixed is None else ~fixed
    z = _inside(problem, start)
    widths = first_widths(problem) if near is None else widths_at(problem, z, near)
    n = problem.size  # an interruption may come before the first derivatives
    optimum = Optimum(z, np.inf, Derivatives(np.inf, np.zeros(n), np.zeros((n, n))))
    wider = 1.0
    damping = FIRST_DAMPING
    try:
        derivatives = problem.derivatives(z, np.where(free, widths, 0.0))
        optimum = Optimum(z, derivatives.cost, derivatives)
        last = ITERATIONS if most is None else most
        for iteration in range(1, last + 1):
            dampings = [0.0, *(damping * times for times in DAMPINGS)]
            steps = [
                damped_step(problem, optimum.z, derivatives, free, share) for share in dampings
            ]
            predicted = steps[0][1]
            if predicted < SETTLED:
                return replace(optimum, converged=True)
            points = [_inside(problem, optimum.z + step) for step, _ in steps]
            costs = problem.costs(points)
            best = int(np.argmin(costs))
            gained = optimum.cost - float(costs[best])
            if progress is not None:
                progress(iteration, min(float(costs[best]), optimum.cost))
            if gained > 0.0:
                optimum = replace(optimum, z=points[best], cost=float(costs[best]))
            if gained < ENOUGH and wider > 1.0:
                return replace(optimum, converged=True)
            wider = WIDER if gained < ENOUGH else 1.0
            following = max(dampings[best], dampings[1]) if gained > 0.0 else dampings[-1]
            damping = max(following, LEAST_DAMPING)
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
    return np.array([FIRST_WIDTH * part.unit(0.0) for part, _ in problem.parts])


def widths_at(problem: Problem, z: Floats, derivatives: Derivatives) -> Floats:
    """Return the width of the differences that give the slopes at z, (n,): `SLOPE_WIDTH` of each
    parameter's std if all others were known.

    As a share of the value it is rounded to a power of two, so that two parameters that show only
    as a product meet the same kinks.
    """
    units = np.array([part.unit(float(at)) for (part, _), at in zip(problem.parts, z)])
    alone = 1.0 / np.sqrt(np.maximum(np.diag(hessian(problem, derivatives)), 1e-300))
    least = np.where(
        [part.noise for part, _ in problem.parts],
        SMALLEST_NOISE_WIDTH,
        SMALLEST_WIDTH,
    )
    share = np.clip(SLOPE_WIDTH * alone / units, least, FIRST_WIDTH * 8)
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


def covariance_at(problem: Problem, derivatives: Derivatives) -> Floats:
    """Return the covariance of the coordinates at the end of a search, (n, n): the inverse of the
    information of logs and priors.
    """
    return np.asarray(np.linalg.pinv(hessian(problem, derivatives), hermitian=True))


LARGEST_NIS = 5.0
"""Mean ν²/S of a channel of the filter, above which the logs do not look like the rig. Source:
judgement.
"""

LARGEST_NOISE_GROWTH = 4.0
"""Factor by which the fit enlarges a sensor's noise, above which the sensor is not the cause.
Source: judgement.
"""

FAR_FROM_PRIOR = 4.0
"""Distance of a value from its prior, in the prior's standard deviations, above which it is
reported. Source: judgement.
"""

FAR_FROM_FACTOR = 2.0
"""The same distance for a parameter that is known within a factor, where a change by the square of
that factor is improbable. Source: judgement.
"""

ADVICE = (
    "the rig lacks physics that these logs have, or a column, unit or sign of a sensor is wrong "
    "(distal estimate says "
    "which disagrees)"
)

NOT_CONVERGED = (
    "the search stopped before it converged, so that no standard error is known; start closer, or "
    "fix what the logs cannot tell (hold = true)"
)


def nis_of(problem: Problem, z: Floats) -> tuple[float, ...]:
    """Return the mean of ν²/S per channel over all logs at coordinates z, (n,)."""
    ratios = np.vstack([run.values**2 / run.variances for run in problem.at(z)])
    return tuple(
        float(np.nanmean(column)) if np.isfinite(column).any() else float("nan")
        for column in ratios.T
    )


def doubts_of(problem: Problem, z: Floats, nis: Sequence[float]) -> list[str]:
    """Return sentences on where logs still do not agree with the rig at the end z of a fit, (n,).

    `nis` is the mean ν²/S there, see `nis_of`; that of the equations says nothing of the angle,
    which logs left out judge.
    """
    references = {sensor.name for sensor in problem.filter.references}
    doubts = [
        f"the logs do not look like this rig: innovations of '{name}' are {np.sqrt(ratio):.3g} "
        "times larger than expected "
        f"even after the fit; {ADVICE}"
        for name, ratio in zip(problem.measured, nis)
        if ratio > LARGEST_NIS and name not in references and not problem.asks_equations
    ]
    for (part, _), at in zip(problem.parts, z):
        if not (part.noise and part.has_prior):
            continue
        growth = part.value(float(at)) / part.start
        unmodelled = part.paths[0].endswith(".unmodelled")
        if growth > LARGEST_NOISE_GROWTH and (unmodelled or part.paths[0].startswith("sensors.")):
            hardly = ", so that the joint hardly follows the model" if unmodelled else ""
            doubts.append(
                f"the logs do not look like this rig: {part.name} had to become {growth:.1f} times "
                f"what the rig says{hardly}; {ADVICE}"
            )
    return doubts


def far_from_priors(parameters: Sequence[FittedParameter], problem: Problem) -> list[str]:
    """Return warnings on fitted parameters that are far from their priors, or at a bound."""
    free_by_name = {part.name: part for part in problem.free}
    lines = []
    for part in parameters:
        if part.noise:
            continue
        free = free_by_name[part.name]
        away = abs(free.coordinate(part.value)) / free.spread if part.prior_std > 0.0 else 0.0
        if away > (FAR_FROM_FACTOR if free.logarithmic else FAR_FROM_PRIOR):
            lines.append(
                f"{part.name} = {part.value:.4g} {part.si} is {away:.1f} standard deviations from "
                "what the rig file "
                f"expected ({part.start:.4g} ± {part.prior_std:.2g}); is a unit or a radius "
                "wrong, or the std too small?"
            )
        elif part.value <= free.low or part.value >= free.high:
            lines.append(
                f"{part.name} = {part.value:.4g} {part.si} is at its bound; another number of the "
                "rig may be wrong"
            )
    return lines


FOLLOWS_DRIVES = 10.0
"""Angle of a joint's own oscillation in the time of smoothing [rad], above which the joint follows
the drives (6 to 8 with inertia, above 15 without). Source: benchmark (benchmarks/strangers/drawn).
"""


DIVERGED = (
    "{}: the filter leaves all bounds on these logs; check the units of logs and rig "
    "(distal estimate)"
)


@dataclass(frozen=True)
class ParameterEstimates:
    """The parameters of a rig as logs tell them.

    Args:
        problem: what was minimised.
        optimum: where the search ended.
        covariance: of the coordinates' errors, (n, n).
        fitted: every free parameter after the fit.
        doubts: sentences with the reasons not to trust the fit.
        nis: mean ν²/S per channel at the end; 1 is expected.
    """

    problem: Problem
    optimum: Optimum
    covariance: Floats
    fitted: tuple[FittedParameter, ...]
    doubts: tuple[str, ...]
    nis: tuple[float, ...]

    @property
    def by_equations(self) -> bool:
        """Whether they are estimated by the rig's equations, not by its filter."""
        return self.problem.asks_equations

    def put_into(self, rig: Rig, hold: bool = False) -> Rig:
        """Return a rig with these parameters; with `hold` filters take them as exactly known."""
        values = assignments(self.fitted, self.problem.filter.rig, hold)
        # a reference sensor that only the fit has is no part of the rig
        return rig.with_values(
            {
                path: value
                for path, value in values.items()
                if part_at(rig, ".".join(path.split(".")[:2])) is not None
            }
        )


def parameters_of(
    problem: Problem, options: Options, progress: Progress | None
) -> list[ParameterEstimates]:
    """Return the estimates of a rig's parameters: by its equations, and by its filter where that is
    asked.

    The filter is asked where the equations cannot be, and where joints are so slow that their
    accelerations count, which an encoder hardly shows.

    Raises:
        FitError: the filter leaves all bounds on the logs.
    """
    equations = by_equations(problem, options, progress)
    slow = joint_frequency(problem.filter.states.context.mechanism) * SMOOTHED < FOLLOWS_DRIVES
    if equations is not None and (not slow or equations.optimum.interrupted):
        return [equations]
    return [
        *([] if equations is None else [equations]),
        by_filter(problem, equations, progress),
    ]


def by_equations(
    problem: Problem,
    options: Options,
    progress: Progress | None,
    begin: ParameterEstimates | None = None,
) -> ParameterEstimates | None:
    """Return the parameters with the least residuals of a rig's equations; None where the equations
    cannot be asked, see `Equations`.

    The search begins at `begin`, estimates by other equations on the same logs; None begins it at
    the priors' mean.
    """
    equations = inverse_problem(problem, options.compiled) if options.homing is None else None
    if equations is None:
        return None
    start = (
        np.zeros(equations.size)
        if begin is None
        else _translated(begin.problem, begin.optimum.z, equations)
    )
    return searched(equations, start, progress)


def by_filter(
    problem: Problem, begin: ParameterEstimates | None, progress: Progress | None
) -> ParameterEstimates:
    """Return the parameters with which a rig's filter predicts the readings best.

    The search begins at `begin`, estimates by the rig's equations, or where the filter diverges
    there, at the priors' mean; None stands for that mean too.

    Raises:
        FitError: the filter leaves all bounds on the logs.
    """
    starts = [np.zeros(problem.size)]
    if begin is not None:
        starts.insert(0, _translated(begin.problem, begin.optimum.z, problem))
    for start, cost in zip(starts, problem.costs(starts)):
        if np.isfinite(cost):
            return searched(problem, start, progress)
    raise FitError(DIVERGED.format(problem.filter.rig.name))


def _translated(problem: Problem, z: Floats, target: Problem) -> Floats:
    """Return the coordinates z of one problem as those of another, `target`; those that only this
    one has are 0.
    """
    coordinates = {
        (part.name, log): coordinate for (part, log), coordinate in zip(problem.parts, z)
    }
    return np.array([coordinates.get((part.name, log), 0.0) for part, log in target.parts])


def searched(
    problem: Problem,
    start: Floats,
    progress: Progress | None = None,
) -> ParameterEstimates:
    """Return the estimates from the most likely parameters of a problem, by a search from the
    coordinates `start`, (n,), that tells its `progress`.
    """
    stage = "by its equations" if problem.asks_equations else "by its filter"

    def said(iteration: int, _: float) -> None:
        if progress is not None:
            progress(f"{stage}, step {iteration}")

    problem, optimum = most_likely(problem, start, said)
    covariance = covariance_at(problem, optimum.derivatives)
    nis = nis_of(problem, optimum.z)
    doubts = list[str]()
    if not optimum.interrupted:
        doubts += doubts_of(problem, optimum.z, nis)
        doubts += [] if optimum.converged else [NOT_CONVERGED]
    fitted = tuple(fitted_parameters(problem, optimum, covariance))
    return ParameterEstimates(problem, optimum, covariance, fitted, tuple(doubts), nis)


def without(parameters: ParameterEstimates, logs: Sequence[Log]) -> ParameterEstimates:
    """Return the parameters that all logs but some tell, `logs`: a search from those of all logs,
    whose stds they have.

    What each log has anew is in a log that is left out as in the others in the mean.

    Raises:
        KeyboardInterrupt: the user interrupted the search.
    """
    problem = parameters.problem
    out = frozenset(
        j for j, data in enumerate(problem.data) if any(data.log is log for log in logs)
    )
    of_others = replace(problem, out=problem.out | out)
    optimum = search(
        of_others,
        parameters.optimum.z,
        most=FIRST_ITERATIONS,
        fixed=np.array([log in out for _, log in problem.parts]),
        near=parameters.optimum.derivatives,
    )
    if optimum.interrupted:
        raise KeyboardInterrupt
    z = optimum.z.copy()
    for k, (part, log) in enumerate(problem.parts):
        if log in out:
            z[k] = np.mean(
                [z[i] for i, (p, j) in enumerate(problem.parts) if p is part and j not in out]
            )
    moved = replace(parameters.optimum, z=z)
    fitted = fitted_parameters(problem, moved, parameters.covariance)
    return replace(parameters, optimum=moved, fitted=tuple(fitted))


def problem_of(logs: Sequence[Log], rig: Rig, options: Options) -> Problem:
    """Return the problem of some logs: the free parameters, and the filter that has them as inputs.

    Raises:
        FitError: nothing is free, or the filter leaves all bounds on the logs.
    """
    joints = rig.joint_names
    known = next((log for log in logs if true_angles(log, joints) is not None), None)
    if known is not None:
        with_reference, references = with_references(rig, known)
    else:  # the filter of a fit always has a reference; here it has no value in any log
        with_reference, added = added_reference(rig, logs[0].rate)
        references = (added,)
    free = choose(with_reference, references, options, several=len(logs) > 1)
    if known is None:
        of_reference = f"sensors.{len(with_reference.sensors) - 1}."
        free = tuple(part for part in free if not part.paths[0].startswith(of_reference))
    fit_filter = FitFilter(with_reference, references, free, options.compiled)
    data = tuple(fit_filter.data_of(log) for log in logs)
    problem = Problem(fit_filter, free, data, homing=options.homing, workers=options.workers)
    if not Equations.apply_to(fit_filter) and not np.isfinite(
        problem.costs([np.zeros(problem.size)])[0]
    ):
        raise FitError(DIVERGED.format(rig.name))
    return problem


def fitted_parameters(
    problem: Problem, optimum: Optimum, covariance: Floats
) -> list[FittedParameter]:
    """Return every free parameter as a search found it, in its own unit, with the `covariance` of
    the coordinates, (n, n); without convergence it has no standard error.
    """
    coordinates = [problem.columns(j) for j in range(len(problem.data))]
    errors = np.sqrt(np.diag(covariance))
    has_errors = optimum.converged and not optimum.interrupted
    parameters = [_by_scale(problem, optimum.z, part) for part in problem.noises]
    for k, part in enumerate(problem.free):
        positions = sorted({columns[k] for columns in coordinates})
        by_log = np.array([part.value(optimum.z[position]) for position in positions])
        error = float("nan")
        if has_errors:
            slopes = [part.slope(optimum.z[position]) for position in positions]
            squares = (errors[positions] * slopes) ** 2
            # of what each log has anew, its scatter counts too
            scatter = by_log.var(ddof=1) if len(by_log) > 1 else 0.0
            limit = part.std if part.has_prior and not part.noise else np.inf
            error = min(float(np.sqrt(scatter + np.mean(squares))), limit)
        per_log = tuple(by_log.tolist()) if part.per_log else ()
        parameters.append(part.fitted(float(by_log.mean()), error, per_log))
    return parameters


def _by_scale(problem: Problem, z: Floats, part: Free) -> FittedParameter:
    """Return a noise that the equations do not vary, enlarged by the square root of the scale c of
    its sensors' residuals.
    """
    indices = [int(path.split(".")[1]) for path in part.paths if path.startswith("sensors.")]
    sensors = [problem.filter.rig.sensors[i].name for i in indices]
    scales = problem.scales(problem.at(z))
    grown = [
        float(np.sqrt(scales[problem.measured.index(name)]))
        for name in sensors
        if name in problem.measured
    ]
    return part.fitted(min(max(grown, default=1.0) * part.start, part.high))
