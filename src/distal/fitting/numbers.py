"""The numbers of a rig as logs tell them: by its equations where they can be asked, by its filter, and what stays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from distal.arrays import Bools, Floats
from distal.errors import FitError, RigError
from distal.fitting.doubts import NOT_CONVERGED, contradictions, doubts_of, nis_of
from distal.fitting.filter import FitFilter, steps_of
from distal.fitting.fitted import FittedNumber
from distal.fitting.free import Free
from distal.fitting.inverse import SMOOTHED, Equations, inverse_problem
from distal.fitting.options import Options
from distal.fitting.problem import Problem
from distal.fitting.progress import Progress, searching
from distal.fitting.search import Found, coarse_start, hessian, most_likely, search
from distal.fitting.selection import choose
from distal.fitting.uncertainty import CONFOUNDED, TOLD, Uncertainty, uncertainty_at
from distal.homing import added_reference, with_references
from distal.logs import Log, true_angles
from distal.model import joint_frequency
from distal.rig import Rig, Sensor, number

FOLLOWS = 10.0
"""Joints with so many radians of their own oscillation in the time of smoothing follow the drives (`python -m
benchmarks.strangers.drawn`: 6 to 8 with inertia, above 15 without)."""


DIVERGED = "{}: the filter leaves all bounds on these logs; check the units of logs and rig (distal estimate)"

EXPLAINED = 2.0
"""The reference becomes one more sensor where no channel's ν²/S is larger than this in the mean."""

HAUSMAN = 4.0
"""The rig's numbers may move by so many variances each, in the mean, where the reference becomes one more sensor."""


@dataclass(frozen=True)
class Numbers:
    """The numbers of a rig as logs tell them.

    Args:
        problem: that was minimised.
        found: where its search ended.
        uncertainty: there.
        fitted: every free number.
        left: which coordinates stay at their prior, (n,).
        held: which of them filters are to take as they are, (n,).
        doubts: what speaks against them.
        nis: mean ν²/S per channel at the start, and at the end.
        begun: −ln p where the search began.
    """

    problem: Problem
    found: Found
    uncertainty: Uncertainty
    fitted: tuple[FittedNumber, ...]
    left: Bools
    held: Bools
    doubts: tuple[str, ...]
    nis: tuple[tuple[float, ...], tuple[float, ...]]
    begun: float

    @property
    def by_equations(self) -> bool:
        """Whether they are those of the rig's equations; else of its filter."""
        return self.problem.asks_equations


def numbers_of(problem: Problem, options: Options, progress: Progress | None) -> list[Numbers]:
    """Return the numbers of a rig as logs tell them: those of its equations, and of its filter where it is asked.

    The filter is asked where the equations cannot be, and where joints are so slow that accelerations count, which an
    encoder hardly tells.

    Args:
        problem: of the filter on the logs.
        options: what is asked of the fit.
        progress: called with what is done.

    Raises:
        FitError: the filter leaves all bounds on the logs.
    """
    equations = by_equations(problem, options, progress)
    slow = joint_frequency(problem.filter.runner.states.context.mechanism) * SMOOTHED < FOLLOWS
    if equations is not None and (not slow or equations.found.interrupted):
        return [equations]
    return [*([] if equations is None else [equations]), by_filter(problem, options, equations, progress)]


def by_equations(
    problem: Problem, options: Options, progress: Progress | None, begin: Numbers | None = None
) -> Numbers | None:
    """Return the numbers with which a rig's equations lack least, None where they cannot be asked; see `Equations`.

    Args:
        problem: of the filter on the same logs.
        options: what is asked of the fit.
        progress: called with what is done.
        begin: numbers of other equations on the same logs, where the search begins.
    """
    equations = inverse_problem(problem, options.compiled) if options.homing is None else None
    if equations is None:
        return None
    start = _translated(problem, _start(problem, options), equations)
    if begin is not None:
        start = _translated(begin.problem, begin.found.z, equations)
    return _told(equations, start, searching(progress, "by its equations"))


def by_filter(problem: Problem, options: Options, begin: Numbers | None, progress: Progress | None) -> Numbers:
    """Return the numbers with which a rig's filter predicts what is read best.

    Args:
        options: what is asked of the fit.
        begin: numbers of its equations, where the search begins; None for the rig's own, and a search of the start.
        progress: called with what is done.

    Raises:
        FitError: the filter leaves all bounds on the logs.
    """
    start = _start(problem, options) if begin is None else _translated(begin.problem, begin.found.z, problem)
    costs = problem.costs([np.zeros(problem.size), start])
    if not np.isfinite(costs).any():
        raise FitError(DIVERGED.format(problem.filter.rig.name))
    if begin is None or not np.isfinite(costs[1]):
        start = coarse_start(problem, options.seed, start, searching(progress, "searching")).z
    return _told(problem, start, searching(progress, "by its filter"))


def _start(problem: Problem, options: Options) -> Floats:
    return np.zeros(problem.size) if options.start is None else _coordinates_of(problem, options.start)


def among_models(numbers: Numbers, models: Sequence[Numbers]) -> Numbers:
    """Return numbers of equations with errors that know of other models: what these make of the same logs is as likely.

    The covariance grows by that of the ends of all models' searches (Draper, J. Royal Statistical Society B 57, 1995). The
    stated errors of one model hold where it is right; numbers that a part more or less would move are known less well.

    Args:
        models: numbers of the same rig with parts more or less, and of the rig itself.
    """
    if not numbers.by_equations or len(models) < 2:
        return numbers
    problem, found, known = numbers.problem, numbers.found, numbers.uncertainty
    ends = np.array([_translated(one.problem, one.found.z, problem, found.z) for one in models])
    spread = np.atleast_2d(np.cov(ends, rowvar=False, bias=True))
    wider = replace(known, covariance=known.covariance + spread)
    fitted = tuple(fitted_numbers(problem, found, wider, numbers.left, numbers.held))
    return replace(numbers, uncertainty=wider, fitted=fitted)


def _translated(problem: Problem, z: Floats, other: Problem, otherwise: Floats | None = None) -> Floats:
    """Return coordinates of one problem as those of another, and for what only that one varies others, or 0."""
    known = {(part.name, log): value for (part, log), value in zip(problem.parts, z)}
    missing = np.zeros(other.size) if otherwise is None else otherwise
    return np.array([known.get((part.name, log), at) for (part, log), at in zip(other.parts, missing)])


def _told(problem: Problem, start: Floats, progress: Callable[[int, float], None] | None) -> Numbers:
    """Return the most likely numbers: what the logs do not tell stays at its prior.

    What the logs tell only together with others is held one by one until the rest is told.
    """
    problem, found = most_likely(problem, start, progress)
    if not problem.asks_equations and not found.interrupted:
        problem, found = _with_reference(problem, found, progress)
    uncertainty = uncertainty_at(problem, found.derivatives, found.z)
    may_stay = np.array([not part.noise and log is None and part.has_prior for part, log in problem.parts])
    left, held = np.zeros(problem.size, dtype=bool), np.zeros(problem.size, dtype=bool)
    while not found.interrupted:
        at = _next_held(problem, uncertainty, left, may_stay)
        if at is None:
            break
        left[at], held[at] = True, bool(uncertainty.together[at])
    if left.any() and not left.all():
        # what the others become when these are moved, by the information of all
        whole, moved = hessian(problem, found.derivatives), np.where(left, -found.z, 0.0)
        moved[~left] = -np.linalg.solve(whole[np.ix_(~left, ~left)], (whole @ moved)[~left])
        again = search(problem, found.z + moved, progress, fixed=left, near=found.derivatives)
        found = replace(again, iterations=found.iterations + again.iterations)
    zero = np.zeros(problem.size)
    before, after = nis_of(problem, zero), nis_of(problem, found.z)
    doubts = list[str]()
    if not found.interrupted:
        doubts += doubts_of(problem, found.z, after)
        doubts += [] if found.converged else [NOT_CONVERGED]
        try:
            doubts += contradictions(problem, found) if len(problem.data) > 1 else []
        except KeyboardInterrupt:
            found = replace(found, interrupted=True)
    fitted = tuple(fitted_numbers(problem, found, uncertainty, left, held))
    begun = float(problem.costs([zero])[0])
    return Numbers(problem, found, uncertainty, fitted, left, held, tuple(doubts), (before, after), begun)


def problem_of(logs: Sequence[Log], rig: Rig, options: Options) -> Problem:
    """Return what is minimised over some logs: what is free, and the filter with it as inputs.

    Args:
        rig: the description as it came.
        options: what is asked of the fit.
    """
    known = [log for log in logs if true_angles(log, _names(rig)) is not None]
    if known:
        with_reference, references = with_references(rig, known[0])
    else:  # the filter of a fit always has a reference; here it has no value in any log
        with_reference, added = added_reference(rig, logs[0].rate)
        references = (added,)
    free = choose(
        with_reference,
        references,
        options.free,
        options.per_log,
        noise=options.noise,
        homing=options.homing is not None,
        several=len(logs) > 1,
    )
    if not known:
        free = tuple(part for part in free if not _of_references(with_reference, references, part))
    made = _filter(with_reference, references, free, steps_of(rig, logs), options.compiled)
    data = tuple(made.data_of(log) for log in logs)
    problem = Problem(made, free, data, options.homing, False, options.workers)
    if not Equations.apply_to(made) and not np.isfinite(problem.costs([np.zeros(problem.size)])[0]):
        raise FitError(DIVERGED.format(rig.name))
    return problem


@lru_cache(maxsize=2)
def _filter(rig: Rig, references: tuple[Sensor, ...], free: tuple[Free, ...], steps: int, compiled: bool) -> FitFilter:
    """Return the filter of a fit; folds of one fit have the same, which is compiled once."""
    return FitFilter(rig, references, free, steps, compiled)


def _with_reference(
    problem: Problem, found: Found, progress: Callable[[int, float], None] | None
) -> tuple[Problem, Found]:
    """Return problem and search with the reference as one more sensor, or without it where the two contradict each other.

    With it the logs tell more where the model is right; where the model is wrong it hides what the angle errs by. So it is
    used where nothing surprises the filter, and the two are compared as Hausman does (Econometrica 46, 1978): the rig's
    numbers may not move by more than the angle without its reference leaves them unsure.

    Args:
        problem: without the reference.
        found: the end of its search.
        progress: called after each iteration.
    """
    if problem.homing is not None or float(np.max(problem.scales(problem.at(found.z)))) > EXPLAINED:
        return problem, found
    own = np.flatnonzero([not part.noise for part, _ in problem.parts])
    known = uncertainty_at(problem, found.derivatives, found.z).covariance[np.ix_(own, own)]
    with_it, tried = most_likely(replace(problem, aided=True), found.z, progress)
    moved = (tried.z - found.z)[own]
    if tried.interrupted or not moved @ np.linalg.solve(known, moved) < HAUSMAN * len(own):
        return problem, replace(found, interrupted=tried.interrupted)
    return with_it, replace(tried, iterations=found.iterations + tried.iterations)


def _next_held(problem: Problem, uncertainty: Uncertainty, left: Bools, may_stay: Bools) -> int | None:
    """Return the coordinate that the logs tell least, those that stay already being known; None where all are told."""
    errors, limit = uncertainty.errors_holding(left), problem.prior_stds
    share = np.where(may_stay & ~left & ~uncertainty.told, errors / limit, 0.0)
    at = int(np.argmax(share))
    return at if share[at] >= (CONFOUNDED if uncertainty.together[at] else TOLD) else None


def fitted_numbers(
    problem: Problem, found: Found, uncertainty: Uncertainty, left: Bools, held: Bools
) -> list[FittedNumber]:
    """Return what a search found of every free number, in its own unit.

    Args:
        found: where its search ended; without convergence no standard error is told.
        left: which coordinates stay at their prior, (n,).
        held: which of them filters are to take as they are, (n,).
    """
    coordinates = [problem.columns(j) for j in range(len(problem.data))]
    given_held, known = uncertainty.errors_holding(held), found.converged and not found.interrupted
    numbers = []

    def limit_of(part: Free) -> float:
        return part.std if part.has_prior and not part.noise else float("inf")

    numbers += [_by_scale(problem, found.z, part) for part in problem.noises]
    for k, part in enumerate(problem.free):
        places = sorted({columns[k] for columns in coordinates})
        each = np.array([part.value(found.z[place]) for place in places])
        slopes = np.array([part.slope(found.z[place]) for place in places])
        mean = float(each.mean())

        def spread(errors: Floats, each: Floats = each, slopes: Floats = slopes, places: list[int] = places) -> float:
            own = errors[places] * slopes
            return float(np.sqrt(each.var(ddof=1) + np.mean(own**2))) if len(each) > 1 else float(own[0])

        starts = part.starts
        values = tuple(mean if len(set(starts)) == 1 else mean * start / part.start for start in starts)
        told = bool(part.noise or part.per_log or not part.has_prior or not left[places[0]])
        names = [data.log.source for data in problem.data]
        numbers.append(
            FittedNumber(
                part.name,
                part.paths,
                part.si,
                part.start,
                part.std,
                mean if told else part.start,
                min(spread(uncertainty.errors), limit_of(part)) if known else float("nan"),
                told,
                part.noise,
                values if told else starts,
                held_error=spread(given_held) if known else float("nan"),
                held=bool(held[places[0]]),
                per_log=dict(zip(names, map(float, each))) if part.per_log else {},
                kept=part.kept_by_file,
            )
        )
    return numbers


def _names(rig: Rig) -> list[str]:
    return [joint.name for joint in rig.joints]


def _of_references(rig: Rig, references: Sequence[Sensor], part: Free) -> bool:
    names = [sensor.name for sensor in rig.sensors]
    own = tuple(f"sensors.{names.index(reference.name)}." for reference in references)
    return all(path.startswith(own) for path in part.paths)


def _coordinates_of(problem: Problem, rig: Rig) -> Floats:
    """Return the coordinates at which the numbers are those of a rig; 0 for what it has no number of."""
    z = np.zeros(problem.size)
    for k, (part, _) in enumerate(problem.parts):
        try:
            z[k] = part.coordinate(number(rig, part.paths[0]).value)
        except RigError:
            continue  # the reference is a sensor of the fit only
    return np.clip(z, *problem.bounds.T)


def _by_scale(problem: Problem, z: Floats, part: Free) -> FittedNumber:
    """Return a noise that the equations do not vary: larger by the root of what its sensors' residuals are larger by."""
    sensors = [
        problem.filter.rig.sensors[int(path.split(".")[1])].name for path in part.paths if path.startswith("sensors.")
    ]
    scales = problem.scales(problem.at(z))
    grown = [float(np.sqrt(scales[problem.measured.index(name)])) for name in sensors if name in problem.measured]
    factor = min(max(grown, default=1.0), part.high / part.start)
    values = tuple(factor * start for start in part.starts)
    return FittedNumber(
        part.name,
        part.paths,
        part.si,
        part.start,
        part.std,
        values[0],
        float("nan"),
        bool(grown),
        True,
        values,
        kept=part.kept_by_file,
    )
