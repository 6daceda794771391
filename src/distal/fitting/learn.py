"""`learn`: everything that logs teach of a rig. A fold of `leave_out` is this call with fewer logs, and nothing else."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from distal.errors import FitError, RigError
from distal.estimators import affine_of, affine_samples
from distal.fitting.angle_errors import surprise_of
from distal.fitting.checks import unknown_joints
from distal.fitting.curves import curves
from distal.fitting.doubts import NOT_CONVERGED, SURPRISED, contradictions, doubts_of, nis_of
from distal.fitting.fitted import FittedNumber, assignments
from distal.fitting.free import Free
from distal.fitting.groups import groups_of
from distal.fitting.map_samples import discrepancy_of, filtered, mean_rms
from distal.fitting.maps import MapFit, learn_contact, map_of
from distal.fitting.options import Options
from distal.fitting.problem import FitFilter, Problem, steps_of
from distal.fitting.reference_error import with_reference_error
from distal.fitting.search import COARSE_LEAST, COARSE_SHARE, Found, hessian, most_likely, search
from distal.fitting.selection import choose
from distal.fitting.uncertainty import TOLD, Uncertainty, uncertainty_at
from distal.homing import added_reference, with_references
from distal.logs import Log, true_angles, true_torques
from distal.regression import Kind, Samples
from distal.rig import Rig, Sensor, number

Floats = NDArray[np.float64]
Progress = Callable[[str, int, float], None]

UNAIDED = 3.0
"""Mean ν²/S of the angle without its reference from which on the rig lacks physics that the logs have."""

HAUSMAN = 4.0
"""The rig's numbers may move by so many variances each, in the mean, where the reference becomes one more sensor."""

FEW_ITERATIONS, AIDED_ITERATIONS = 3, 15
"""The search with the reference is given up after a few iterations where they lead astray."""

SURER = 0.85
"""Narrower stds are taken where the angle's error is below this share."""

TOLD_OR_HELD: tuple[float | None, ...] = (None, 0.0)
"""Stds that are tried after a fit: as the logs tell them, or none, so that no log teaches the numbers anew."""

IN_DOUBT: tuple[float | None, ...] = (1.0, 0.3, 0.1, 0.0)
"""Shares of the priors' stds that are tried, widest first, where a fit is in doubt; 0 holds the numbers."""

Problems = Callable[[bool], Problem]


@dataclass(frozen=True)
class Numbers:
    """The numbers of a rig as logs tell them.

    Args:
        problem: that was minimised.
        found: where its search ended.
        uncertainty: there.
        fitted: every free number.
        doubts: what speaks against them.
        nis: mean ν²/S per channel at the start, and at the end.
        begun: −ln p where the search began.
    """

    problem: Problem
    found: Found
    uncertainty: Uncertainty
    fitted: tuple[FittedNumber, ...]
    doubts: tuple[str, ...]
    nis: tuple[tuple[float, ...], tuple[float, ...]]
    begun: float


@dataclass(frozen=True)
class Learned:
    """All that logs teach of a rig.

    Args:
        rig: the description with all of it.
        numbers: the rig's numbers.
        prior_share: share of the priors' stds that the file keeps; None where the stds are as the logs tell.
        curves: path → value of the position sensors' systematic errors.
        maps: what was learned beside the numbers, by the name of its table: ``affine``, ``discrepancy``, ``contact``.
        doubts: plain sentences on what speaks against the fit.
    """

    rig: Rig
    numbers: Numbers
    prior_share: float | None
    curves: Mapping[str, object]
    maps: Mapping[str, MapFit]
    doubts: tuple[str, ...]


def learn(logs: Sequence[Log], rig: Rig, options: Options, progress: Progress | None = None) -> Learned:
    """Return all that logs teach of a rig: its numbers, their stds, and what the model leaves.

    Everything that is chosen with logs is chosen here, from the rig as it came on.

    Args:
        logs: as read and checked.
        rig: the description, whose values and stds are the priors.
        options: what is asked of the fit.
        progress: called with the stage, the iteration and −ln p.

    Raises:
        FitError: the logs cannot be fitted.
    """
    known = [log for log in logs if true_angles(log, _names(rig)) is not None]
    numbers = numbers_of(logs, rig, options, bool(known), progress)
    learned_curves = curves(numbers.problem, numbers.found.z) if options.curves else {}

    def written(prior_share: float | None) -> Rig:
        values = {**assignments(numbers.fitted, numbers.problem.filter.rig, prior_share), **learned_curves}
        return described(rig, values)

    doubts = list(numbers.doubts)
    unknown = unknown_joints(known, rig) if known else []
    if unknown:
        doubts.append(
            f"the angle of {', '.join(unknown)} is known in no log: numbers of the rig are fitted, but no straight line "
            "(affine) and no correction (discrepancy), which are of all joints"
        )
    unsure = numbers.found.interrupted or bool(doubts)
    shares = IN_DOUBT if unsure else TOLD_OR_HELD
    share, learned = shares[0], written(shares[0])
    maps = list[MapFit]()
    if known and not unknown:
        data, refused = filtered(known, learned, options.homing, False)
        for other in shares[1:] if data and not numbers.found.interrupted else ():
            surer = written(other)
            as_sure, _ = filtered(known, surer, options.homing, False)
            if len(as_sure) == len(data) and mean_rms(as_sure) < SURER * mean_rms(data):
                learned, data, share = surer, as_sure, other
        doubts += refused
        maps += _angle_maps(known, data, rig, learned, options)
    maps += _contact_map(logs, learned, options)
    whole = learned.with_values({one.table: one.learned.model_dump() for one in maps}) if maps else learned
    return Learned(whole, numbers, share, learned_curves, {one.table: one for one in maps}, tuple(doubts))


def _angle_maps(
    known: Sequence[Log], data: Sequence[Samples], rig: Rig, learned: Rig, options: Options
) -> list[MapFit]:
    """Return the map of `affine`, and of what the filter's angles lack, from logs with a truth."""
    straight = [affine_samples(log, learned) for log in known]
    straight = [one.part(np.asarray(np.isfinite(one.targets).any(axis=1))) for one in straight]
    kinds: list[tuple[Kind, Sequence[Samples]]] = [(affine_of(learned), straight)]
    if data:
        kinds.append((discrepancy_of(learned, data), data))
    maps = []
    for kind, samples in kinds:
        groups = _groups([one.source for one in samples], options)
        one = map_of(samples, kind, learned, options.homing, groups, scored=False)
        if options.homing is None:
            one = one.with_map(with_reference_error(one.learned, rig, known))
        maps.append(one)
    return maps


def _contact_map(logs: Sequence[Log], learned: Rig, options: Options) -> list[MapFit]:
    """Return the map of the torque from outside, where logs have it and the rig says that it can occur."""
    felt = [log for log in logs if true_torques(log, _names(learned)) is not None]
    if not felt or any(joint.external_torque.std == 0.0 for joint in learned.joints):
        return []
    groups = _groups([log.source for log in felt], options)
    return [learn_contact(felt, learned, options.homing, groups, scored=False)]


def _groups(sources: Sequence[str], options: Options) -> list[str]:
    """Return which logs are left out together: those of one unit, else each alone."""
    return [str(i) for i in range(len(sources))] if options.units is None else groups_of(sources, options.units, 1)


def numbers_of(logs: Sequence[Log], rig: Rig, options: Options, known: bool, progress: Progress | None) -> Numbers:
    """Return the numbers of a rig as logs tell them.

    Args:
        logs: of the fit.
        rig: the description as it came.
        options: what is asked of the fit.
        known: whether some log has a truth.
        progress: called with the stage, the iteration and −ln p.

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
    fitted = tuple(_fitted(problem, found, uncertainty, left, held))
    return Numbers(problem, found, uncertainty, fitted, tuple(doubts), (before, after), begun)


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
        progress: called with the stage, the iteration and −ln p.
    """
    with_it, tried = replace(problem, aided=True), found
    own = np.flatnonzero([not part.noise for part, _ in problem.parts])
    known = uncertainty_at(problem, found.derivatives, found.z).covariance[np.ix_(own, own)]
    for share, most in ((COARSE_SHARE, FEW_ITERATIONS), (COARSE_SHARE, AIDED_ITERATIONS), (1.0, AIDED_ITERATIONS)):
        tried = search(
            with_it.beginning(share, COARSE_LEAST), tried.z, staged(progress, "the angle as one more sensor"), most
        )
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
    return at if share[at] >= TOLD else None


def _fitted(
    problem: Problem, found: Found, uncertainty: Uncertainty, left: NDArray[np.bool_], held: NDArray[np.bool_]
) -> list[FittedNumber]:
    coordinates = [problem.columns(j) for j in range(len(problem.data))]
    given_held, known = uncertainty.errors_holding(held), found.converged and not found.interrupted
    numbers = []
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
                spread(uncertainty.errors) if known else float("nan"),
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


def described(rig: Rig, values: Mapping[str, object]) -> Rig:
    """Return a rig with what was fitted of its own numbers; a reference that only the fit had is left out.

    Args:
        rig: the description as it came.
        values: path → value.
    """
    own = {
        path: value
        for path, value in values.items()
        if not path.startswith("sensors.") or int(path.split(".")[1]) < len(rig.sensors)
    }
    return rig.with_values(own) if own else rig


def staged(progress: Progress | None, stage: str) -> Callable[[int, float], None] | None:
    """Return what a search tells of its progress, with the stage's name.

    Args:
        progress: called with the stage, the iteration and −ln p; None for nothing.
        stage: its name.
    """
    return None if progress is None else lambda iteration, cost: progress(stage, iteration, cost)


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
            value = number(rig, part.paths[0]).value
        except RigError:
            continue  # the reference is a sensor of the fit only
        if not part.logarithmic:
            z[k] = (value - part.start) / part.scale
        elif value > 0.0:
            z[k] = np.log(value / part.start)
    return np.clip(z, *problem.bounds.T)
