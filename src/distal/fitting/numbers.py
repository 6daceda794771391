"""The numbers of a rig as logs tell them: the search, with the reference or without, and what stays at its prior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from distal.errors import FitError, RigError
from distal.fitting.angle_errors import surprise_of
from distal.fitting.doubts import NOT_CONVERGED, SURPRISED, contradictions, doubts_of, nis_of, noise_growth
from distal.fitting.fitted import FittedNumber
from distal.fitting.free import Free
from distal.fitting.options import Options
from distal.fitting.problem import FitFilter, Problem, steps_of
from distal.fitting.progress import Progress, staged
from distal.fitting.search import (
    COARSE_ITERATIONS,
    COARSE_LEAST,
    COARSE_SHARE,
    MOST_ITERATIONS,
    Found,
    hessian,
    most_likely,
    search,
)
from distal.fitting.selection import choose
from distal.fitting.uncertainty import CONFOUNDED, TOLD, Uncertainty, uncertainty_at
from distal.homing import added_reference, with_references
from distal.logs import Log, true_angles
from distal.rig import Rig, Sensor, number

Floats = NDArray[np.float64]

UNAIDED = 3.0
"""Mean ν²/S of the angle without its reference from which on the rig lacks physics that the logs have."""

HAUSMAN = 4.0
"""The rig's numbers may move by so many variances each, in the mean, where the reference becomes one more sensor."""

TRIAL_ITERATIONS = 3
"""The search with the reference is given up after a few iterations where they lead astray."""


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
    left: NDArray[np.bool_]
    held: NDArray[np.bool_]
    doubts: tuple[str, ...]
    nis: tuple[tuple[float, ...], tuple[float, ...]]
    begun: float


def numbers_of(logs: Sequence[Log], rig: Rig, options: Options, known: bool, progress: Progress | None) -> Numbers:
    """Return the numbers of a rig as logs tell them.

    Args:
        logs: of the fit.
        rig: the description as it came.
        options: what is asked of the fit.
        known: whether some log has a truth.
        progress: called with what is done.

    Raises:
        FitError: the filter leaves all bounds on the logs.
    """
    problem = problem_of(logs, rig, options)
    start = np.zeros(problem.size)
    begun = float(problem.costs([start])[0])
    if not np.isfinite(begun):
        raise FitError(
            f"{rig.name}: the filter leaves all bounds on these logs; check the units of logs and rig (distal estimate)"
        )
    begin = None if options.start is None else _coordinates_of(problem, options.start)
    found = most_likely(problem, options.seed, staged(progress, "searching"), begin)
    doubts = list[str]()
    if known and options.homing is None and not found.interrupted:
        if surprise_of(problem, found.z) > UNAIDED:
            doubts.append(SURPRISED)
        else:
            problem, found = _with_reference(problem, found, progress)
    found, uncertainty, left, held = _as_told(problem, found, progress)
    before, after = nis_of(problem, start), nis_of(problem, found.z)
    if not found.interrupted:
        doubts += doubts_of(problem, found.z, after)
        doubts += contradictions(problem, found) if len(logs) > 1 else []
        doubts += [] if found.converged else [NOT_CONVERGED]
    fitted = tuple(fitted_numbers(problem, found, uncertainty, left, held))
    begun = float(problem.costs([start])[0])  # with or without the reference, as the search ended
    return Numbers(problem, found, uncertainty, fitted, left, held, tuple(doubts), (before, after), begun)


def problem_of(logs: Sequence[Log], rig: Rig, options: Options) -> Problem:
    """Return what is minimised over some logs: what is free, and the filter with it as inputs.

    Args:
        logs: of the fit.
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
    return Problem(made, free, data, options.homing, False, options.workers)


@lru_cache(maxsize=2)
def _filter(rig: Rig, references: tuple[Sensor, ...], free: tuple[Free, ...], steps: int, compiled: bool) -> FitFilter:
    """Return the filter of a fit; folds of one fit have the same, which is compiled once."""
    return FitFilter(rig, references, free, steps, compiled)


def _with_reference(problem: Problem, found: Found, progress: Progress | None) -> tuple[Problem, Found]:
    """Return problem and search with the reference as one more sensor, or without it where the two contradict each other.

    With it the logs tell more where the model is right; where the model is wrong it hides what the angle errs by. The two
    are compared as Hausman does (Econometrica 46, 1978): the rig's numbers may not move by more than the angle without its
    reference leaves them unsure. The beginnings of the logs are asked first.

    Args:
        problem: without the reference.
        found: the end of its search.
        progress: called with what is done.
    """
    with_it, tried = replace(problem, aided=True), found
    own = np.flatnonzero([not part.noise for part, _ in problem.parts])
    known = uncertainty_at(problem, found.derivatives, found.z).covariance[np.ix_(own, own)]
    for share, most in ((COARSE_SHARE, TRIAL_ITERATIONS), (COARSE_SHARE, COARSE_ITERATIONS), (1.0, MOST_ITERATIONS)):
        some = with_it.beginning(share, COARSE_LEAST)
        tried = search(some, tried.z, staged(progress, "the angle as one more sensor"), most=most)
        if tried.interrupted:
            return problem, replace(found, interrupted=True)
        moved = (tried.z - found.z)[own]
        # the beginnings alone tell less than the whole logs
        if not moved @ np.linalg.solve(known, moved) < HAUSMAN * len(own) / share:
            return problem, found
    return with_it, tried


def _as_told(
    problem: Problem, found: Found, progress: Progress | None
) -> tuple[Found, Uncertainty, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the search with what the logs do not tell at its prior, its uncertainty, what stays, and what is held.

    What the logs tell only together with others is held one by one until the rest is told.
    """
    uncertainty = uncertainty_at(problem, found.derivatives, found.z)
    may_stay = np.array([not part.noise and log is None and part.has_prior for part, log in problem.parts])
    left, held = np.zeros(problem.size, dtype=bool), np.zeros(problem.size, dtype=bool)
    while not found.interrupted:
        at = _next_held(problem, uncertainty, left, may_stay)
        if at is None:
            break
        left[at], held[at] = True, bool(uncertainty.together[at])
    if not left.any() or left.all():
        return found, uncertainty, left, held
    # what the others become when these are moved, by the information of all
    whole, moved = hessian(problem, found.derivatives), np.where(left, -found.z, 0.0)
    moved[~left] = -np.linalg.solve(whole[np.ix_(~left, ~left)], (whole @ moved)[~left])
    again = search(
        problem, found.z + moved, staged(progress, "what the logs tell"), fixed=left, first=found.derivatives
    )
    return replace(again, iterations=found.iterations + again.iterations), uncertainty, left, held


def _next_held(
    problem: Problem, uncertainty: Uncertainty, left: NDArray[np.bool_], may_stay: NDArray[np.bool_]
) -> int | None:
    """Return the coordinate that the logs tell least, those that stay already being known; None where all are told."""
    errors, limit = uncertainty.errors_holding(left), problem.prior_stds
    share = np.where(may_stay & ~left & ~uncertainty.told, errors / limit, 0.0)
    at = int(np.argmax(share))
    return at if share[at] >= (CONFOUNDED if uncertainty.together[at] else TOLD) else None


def fitted_numbers(
    problem: Problem, found: Found, uncertainty: Uncertainty, left: NDArray[np.bool_], held: NDArray[np.bool_]
) -> list[FittedNumber]:
    """Return what a search found of every free number, in its own unit.

    Args:
        problem: that was minimised.
        found: where its search ended; without convergence no standard error is told.
        uncertainty: there.
        left: which coordinates stay at their prior, (n,).
        held: which of them filters are to take as they are, (n,).
    """
    coordinates = [problem.columns(j) for j in range(len(problem.data))]
    given_held, known = uncertainty.errors_holding(held), found.converged and not found.interrupted
    grown = noise_growth(problem, found.z)
    numbers = []

    def limit_of(part: Free) -> float:
        return part.std if part.has_prior and not part.noise else float("inf")

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
                min(grown * spread(uncertainty.errors), limit_of(part)) if known else float("nan"),
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
