"""Candidates: the ways to describe what logs show, each judged on the same held-out logs; `judge`
makes and scores them, and `Fit.of` is what is written of one.

On logs that its parameters were fitted to, a filter errs less than on others, so each log is
filtered with the parameters that the other logs tell (`without`), a map has weights of the other
logs, and least squares are solved without the log (level-one data of stacking; Wolpert, Neural
Networks 5, 1992). Candidates may have terms of the physics that the rig lacks, which are tried
where the residuals of its equations are much larger than its sensors' noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from distal.arrays import Floats
from distal.errors import DistalError
from distal.estimators import samples_of_angles
from distal.fitting.learned_maps import (
    HeldOut,
    MapFit,
    Score,
    answering,
    counted_from,
    filtered,
    map_of,
    mean_rms,
    pooled,
    with_its_reference_error,
)
from distal.fitting.parameter_search import (
    ParameterEstimates,
    by_equations,
    parameters_of,
    problem_of,
    without,
)
from distal.fitting.parameters_and_priors import Options, Progress
from distal.fitting.usable_logs import unknown_joints
from distal.logs import Log, shown, true_angles
from distal.regression import (
    YARDSTICKS,
    Samples,
    folds_of,
    groups_of,
    line_errors,
    splits,
    yardstick_error,
)
from distal.rig import Pulley, Rig

UNEXPLAINED = 16.0
"""Mean ν²/S of some row of the equations, from which on terms are tried. Source: judgement."""

NAMED = 0.85
"""Ratio of the residuals with a term to those without, in the geometric mean of all rows, or of the
errors of two filters, below which the term is named, or the other filter taken. Source: judgement.
"""

MOST_NAMED = 2
"""Largest number of terms of which each alone makes a candidate. Source: judgement."""

NODES = 2
"""Number of points of friction along a cable. Source: benchmark (benchmarks/sheaths)."""

PLAY = {"slider": 2e-4, "capstan": 0.02}
"""Kind of a drive → width of the backlash that is tried first [m, rad]; its std is as large.
Source: judgement.
"""


@dataclass(frozen=True)
class MissingTerm:
    """A term that a description may lack: its name, and path → value of what is put into the
    description wherever the term can be added.
    """

    name: str
    values: Mapping[str, object]


def terms_of(rig: Rig) -> Iterator[MissingTerm]:
    """Yield the terms that may be added to a rig: friction along cables, creep, backlash of drives,
    changing moment arms.
    """
    sheaths: dict[str, object] = {}
    for tendon in rig.tendons:
        if tendon.path is None:
            way = {"friction": {"value": 0.1, "std": 0.1}, "wrap": np.pi / 2, "nodes": NODES}
            sheaths[f"tendons.{tendon.name}.path"] = way
        elif tendon.path.nodes == 0:
            sheaths[f"tendons.{tendon.name}.path.nodes"] = NODES
    creep = {"share": {"value": 0.1, "std": 0.1}, "time": {"value": 10.0, "std": 10.0}}
    plays = {
        f"drives.{drive.name}.backlash.width": {"value": PLAY[drive.kind], "std": PLAY[drive.kind]}
        for drive in rig.drives
        if drive.backlash is None
    }
    unknown = {"value": 0.0, "std": 0.2}
    arms = {
        f"tendons.{tendon.name}.{meeting.path}": {
            **meeting.shape.model_dump(exclude_none=True),
            "kind": "linkage",
            "slope": unknown,
            # with several joints a log shows too little of each of the tendon's moment arms
            **({"curvature": unknown} if len(tendon.meetings) == 1 else {}),
        }
        for tendon in rig.tendons
        for meeting in tendon.meetings
        if isinstance(meeting.shape, Pulley)
    }
    yield MissingTerm("friction along the cable", sheaths)
    yield MissingTerm(
        "creep of the tendons",
        {f"tendons.{t.name}.creep": creep for t in rig.tendons if t.creep is None},
    )
    yield MissingTerm("play between drives and tendons", plays)
    yield MissingTerm("moment arms that change with the angle", arms)


Named: TypeAlias = tuple[MissingTerm, ParameterEstimates]
"""A term with the parameter estimates of the rig with it."""


def tried_parts(
    logs: Sequence[Log], rig: Rig, options: Options, parameters: ParameterEstimates
) -> list[Named]:
    """Return the terms that lower the residuals of a rig's equations clearly, the best first, then
    the best one together with another, tried where the residuals are much larger than the sensors'
    noise.

    Nothing is tried where the parameters are not estimated by equations, or the user chose which
    are free.
    """
    if not parameters.by_equations or options.free:
        return []
    alone = _tried(logs, rig, options, parameters)[:MOST_NAMED]
    pairs = list[Named]()
    for first, first_parameters in alone[:1]:
        with_first = rig.with_values(first.values)
        pairs += [
            (
                MissingTerm(f"{first.name} and {second.name}", {**first.values, **second.values}),
                pair_parameters,
            )
            for second, pair_parameters in _tried(logs, with_first, options, first_parameters)[:1]
        ]
    return [*alone, *pairs]


def _tried(
    logs: Sequence[Log], rig: Rig, options: Options, parameters: ParameterEstimates
) -> list[Named]:
    """Return the terms that leave clearly smaller residuals, the smallest first."""
    if max(parameters.nis, default=0.0) < UNEXPLAINED:
        return []
    limit = NAMED * _residual(parameters)
    fits = with_parts(terms_of(rig), logs, rig, options, parameters)
    named = (fit for fit in fits if _residual(fit[1]) < limit)
    return sorted(named, key=lambda fit: _residual(fit[1]))


def with_parts(
    parts: Iterable[MissingTerm],
    logs: Sequence[Log],
    rig: Rig,
    options: Options,
    begin: ParameterEstimates,
) -> list[Named]:
    """Return those of the terms that the rig can have, each with the parameter estimates of the
    rig's equations with it.

    The searches begin at the estimates `begin`, without the term.
    """
    fits = []
    for part in parts:
        if not part.values:
            continue
        try:
            problem = problem_of(logs, rig.with_values(part.values), options)
            parameters = by_equations(problem, options, None, begin)
        except DistalError:
            continue
        if parameters is not None:
            if parameters.optimum.interrupted:
                # the caller has the estimates without the term
                raise KeyboardInterrupt
            fits.append((part, parameters))
    return fits


def _residual(parameters: ParameterEstimates) -> float:
    """Return the geometric mean over all rows of √(mean ν²/S), where a mean below 1 counts as 1."""
    ratios = np.maximum([ratio for ratio in parameters.nis if np.isfinite(ratio)], 1.0)
    return float(np.exp(np.mean(0.5 * np.log(ratios))))


def parameters_without(
    parameters: ParameterEstimates, logs: Sequence[Log], folds: Sequence[int]
) -> list[ParameterEstimates]:
    """Return for each fold the parameters that the logs of the other folds tell; with one fold,
    those of all logs.

    The `folds` are those of `logs`, the logs of known angle.
    """
    if len(set(folds)) < 2 or parameters.optimum.interrupted:
        return [parameters] * len(set(folds))
    return [without(parameters, [logs[i] for i in out]) for out, _ in splits(folds)]


AS_GIVEN = "the rig as given"
"""Name of the candidate that is the original rig.

Filters are candidates without a map; what is written has one.
"""

BY_EQUATIONS = "parameters by its equations"
"""Name of the candidate whose parameters are estimated by the rig's equations."""

BY_FILTER = "parameters by its filter"
"""Name of the candidate whose parameters are estimated by the rig's filter."""


def groups_among(logs: Sequence[Log], pattern: str | None) -> tuple[str, ...]:
    """Return the group of each log, whose logs are held out together: what a `pattern` finds in its
    name, else a group of its own.
    """
    names = [log.source for log in logs]
    if pattern is None or not names:
        return tuple(str(i) for i in range(len(names)))
    return tuple(groups_of(names, pattern, 1))


@dataclass(frozen=True)
class Training:
    """What candidates learn from.

    Args:
        logs: the logs of known angle.
        groups: the group of each log, whose logs are held out together.
        rig: the original description, or with a `part` more.
        options: options of the fit.
        unknown: names of the joints whose angle is known in no log.
        part: the term of the physics that was added to the original description, if any.
    """

    logs: tuple[Log, ...]
    groups: tuple[str, ...]
    rig: Rig
    options: Options
    unknown: tuple[str, ...] = ()
    part: MissingTerm | None = None

    @classmethod
    def of(cls, logs: Sequence[Log], rig: Rig, options: Options) -> Training:
        """Return what candidates learn from some logs with the original rig."""
        joints = rig.joint_names
        with_truth = tuple(log for log in logs if true_angles(log, joints) is not None)
        unknown = tuple(unknown_joints(with_truth, rig)) if with_truth else ()
        return cls(with_truth, groups_among(with_truth, options.groups), rig, options, unknown)

    @property
    def judges(self) -> bool:
        """Whether candidates can be judged: every joint's angle is known in some log."""
        return bool(self.logs) and not self.unknown

    @property
    def line_error(self) -> float:
        """Mean over logs of the RMS error of a straight line of the readings by the other logs
        [rad]; infinite without other logs, NaN where some joint's angle is known in too few.
        """
        if len(set(self.folds)) < 2:
            return np.inf
        samples = [samples_of_angles(log, self.rig) for log in self.logs]
        return float(np.mean(line_errors(samples, self.folds)))

    @property
    def folds(self) -> list[int]:
        """The fold of each log."""
        return folds_of(self.groups)


@dataclass(frozen=True)
class Candidate:
    """One way to describe what logs show.

    Args:
        name: name in words.
        rig: the description, with its parameters.
        parameters: the parameter estimates in it; None where it has the original values.
        hold: whether filters take the parameters as exactly known.
        error: RMS error of the angle on held-out logs [rad]; infinite where it cannot run.
        data: the filter's estimates along the logs, with parameters that have not seen them, by the
            index of the log.
        refused: sentences on logs that its filter could not follow.
        part: the term of the physics that was added to the original description, if any.
    """

    name: str
    rig: Rig
    parameters: ParameterEstimates | None
    hold: bool
    error: float
    data: Mapping[int, Samples]
    refused: tuple[str, ...] = ()
    part: MissingTerm | None = None


def filter_candidate(
    name: str, training: Training, parameters: ParameterEstimates | None
) -> Candidate:
    """Return the candidate of a rig's filter with the given parameter estimates; None stands for
    the original values.

    It takes the parameters as exactly known where it then errs far less.
    """
    if parameters is None:
        return _filtered(name, training, None, (), False)
    of_folds = parameters_without(parameters, training.logs, training.folds)
    plain = _filtered(name, training, parameters, of_folds, False)
    if training.options.homing is not None:
        return plain
    surer = _filtered(name, training, parameters, of_folds, True)
    better = mean_rms(surer.data, None) < NAMED * mean_rms(plain.data, None)
    return surer if better and len(surer.data) == len(plain.data) else plain


def _filtered(
    name: str,
    training: Training,
    parameters: ParameterEstimates | None,
    of_folds: Sequence[ParameterEstimates],
    hold: bool,
) -> Candidate:
    rig = training.rig
    rigs = (training.rig,) * len(training.folds)
    if parameters is not None:
        fold_rigs = [of_fold.put_into(rig, hold) for of_fold in of_folds]
        rig = parameters.put_into(rig, hold)
        rigs = tuple(fold_rigs[fold] for fold in training.folds)
    homing = training.options.homing
    data, refused = filtered(
        training.logs, rigs, homing, "quick" if training.options.compiled else False
    )
    # what a log teaches cannot be judged on it
    judged = bool(data) and len(set(training.folds)) > 1
    error = mean_rms(data, homing) if judged else np.inf
    return Candidate(name, rig, parameters, hold, error, data, tuple(refused), training.part)


def answer_maps(candidate: Candidate, training: Training, line: MapFit) -> tuple[MapFit, ...]:
    """Return the maps by which a candidate's angles are known: that on readings alone, `line`, and
    that of what the angles of its filter lack, on logs that its parameters have not seen.

    Where no filter ran, readings alone answer. One log alone teaches no correction of a filter,
    since nothing could judge it.
    """
    if not candidate.data:
        return (answering(line, {}),)
    folds = folds_of([training.groups[i] for i in candidate.data])
    homing = training.options.homing
    if homing is None and len(set(folds)) < 2:
        return (line,)
    data = list(candidate.data.values())
    beside = map_of(data, candidate.rig, "filter", folds, homing)
    if homing is not None:
        return line, beside
    beside = with_its_reference_error(beside, training.logs)
    return pooled(beside, line, candidate.data, training.logs)


WRITTEN = "as written"
"""Name of the score of what the fit writes."""

REGRESSION = "readings alone, without the filter"
"""Name of the score of the estimator `regression`."""


@dataclass(frozen=True)
class Compared:
    """A log left out, and the scores on it of all that the other logs teach, by name.

    A score is None where an estimator cannot run.

    Args:
        index: of the log among those of known angle; two logs may have one name.
        log: its name.
        scores: name of what was learned → its score.
    """

    index: int
    log: str
    scores: Mapping[str, Score | None]


def comparisons(
    training: Training, candidates: Sequence[Candidate], maps: Mapping[str, MapFit]
) -> tuple[Compared, ...]:
    """Return the scores on each log of known angle, but those whose angle is known at the beginning
    alone, which does not count.

    Args:
        training: the logs.
        candidates: what was judged; the first is written, with a map where `maps` has one.
        maps: the maps by their kinds.
    """
    if len(set(training.folds)) < 2:
        return ()
    homing = training.options.homing
    every = [samples_of_angles(log, training.rig) for log in training.logs]
    compared = []
    for i, log in enumerate(training.logs):
        begin = counted_from(log, homing)
        if not np.isfinite(every[i].targets[every[i].time >= begin]).any():
            continue
        of_readings = maps["readings"].held_out(i)
        alone = Score.of(of_readings, begin)
        written: Score | None = alone
        judged = of_readings[0].time
        if "filter" in maps:
            written = None
            if i in candidates[0].data:
                of_map = maps["filter"].held_out(list(candidates[0].data).index(i))
                written = Score.of(of_map, begin)
                judged = of_map[0].time
        scores: dict[str, Score | None] = {WRITTEN: written}
        for candidate in candidates:
            scores[candidate.name] = _of_filter(candidate.data.get(i), judged, begin)
        scores[REGRESSION] = alone
        if homing is None:
            groups = training.groups
            remaining = [own for group, own in zip(groups, every) if group != groups[i]]
            early = (every[i].time < begin)[:, None]
            late = replace(every[i], targets=np.where(early, np.nan, every[i].targets))
            for name in YARDSTICKS:
                rms = yardstick_error(name, remaining, late)
                scores[name] = Score(rms, float("nan"), float("nan"))
        compared.append(Compared(i, shown(log.source), scores))
    return tuple(compared)


def _of_filter(samples: Samples | None, judged: Floats, begin: float) -> Score | None:
    """Return the score of a filter at the times at which maps are `judged` [s], (k,), from the time
    `begin` on [s]; None where it cannot run.
    """
    if samples is None:
        return None
    masks = (np.isfinite(samples.targets) & np.isin(samples.time, judged)[:, None]).T
    errors = [
        HeldOut(samples.time[mask], of_joint[mask], variances[mask])
        for mask, of_joint, variances in zip(masks, samples.targets.T, samples.variances.T)
    ]
    return Score.of(errors, begin)


@dataclass(frozen=True)
class Judged:
    """The candidates for a description of some logs, and what each of them is written from.

    Args:
        logs: all logs.
        training: the logs of known angle, from which candidates learn.
        line: the map on readings alone; None where some joint's angle is known in no log.
        solutions: the parameter estimates by the rig's equations and by its filter, where each was
            asked.
        candidates: all candidates that were judged.
        interrupted: whether the user interrupted it; what was judged until then stands.
    """

    logs: Sequence[Log]
    training: Training
    line: MapFit | None
    solutions: Sequence[ParameterEstimates]
    candidates: Sequence[Candidate]
    interrupted: bool

    @property
    def chosen(self) -> Candidate:
        """The candidate that errs least on held-out logs, without a map: within the logs a map
        hides what the filter lacks beyond them. Where none was judged, the parameters alone.
        """
        parameters = self.solutions[-1]
        alone = Candidate(
            "numbers", parameters.put_into(self.training.rig), parameters, False, np.nan, {}
        )
        return min(self.candidates, key=lambda candidate: candidate.error, default=alone)

    @property
    def error(self) -> float:
        """RMS error on logs left out of the chosen filter, or of readings alone [rad]."""
        if self.line is None:
            return self.chosen.error
        of_readings = [rms for learned in self.line.maps for rms in learned.rms]
        alone = float(np.sqrt(np.mean(np.square(of_readings))))
        return min(self.chosen.error, alone)


def judge(
    logs: Sequence[Log],
    rig: Rig,
    options: Options,
    progress: Progress | None = None,
) -> Judged:
    """Return the candidates for a description of some logs that has no term more than the rig, each
    judged on held-out logs.

    Args:
        logs: the logs.
        rig: the original rig, whose values and stds are the priors.
        options: those of `fit`.
        progress: called with what the fit is doing.

    Raises:
        FitError: the logs cannot be fitted.
    """
    training = Training.of(logs, rig, options)
    line = readings_map(training) if training.judges else None
    problem = problem_of(logs, rig, options)
    solutions = parameters_of(problem, options, progress)
    judged = Judged(logs, training, line, solutions, (), solutions[-1].optimum.interrupted)
    return judged if line is None else _judging(judged, _ways(training, solutions), progress)


def with_terms(judged: Judged, progress: Progress | None = None) -> Judged:
    """Return the candidates with those of the rig with terms that it may lack, see `tried_parts`;
    without known angles there are none.
    """
    if judged.line is None or judged.interrupted:
        return judged
    return _judging(judged, _ways_with_terms(judged), progress)


def _ways_with_terms(judged: Judged) -> Iterator[Way]:
    training = judged.training
    rig = training.rig
    for part, parameters in tried_parts(judged.logs, rig, training.options, judged.solutions[0]):
        with_part = replace(training, rig=rig.with_values(part.values), part=part)
        yield f"{BY_EQUATIONS}, with {part.name}", with_part, parameters


def _judging(judged: Judged, ways: Iterable[Way], progress: Progress | None) -> Judged:
    """Return the candidates with further ones, each judged on held-out logs; after an interruption
    with those that were judged until then.
    """
    say = progress or (lambda _: None)
    candidates = list(judged.candidates)
    stopped = judged.interrupted
    try:
        for name, training, parameters in ways:
            say(f"judging {name}")
            candidates.append(filter_candidate(name, training, parameters))
    except KeyboardInterrupt:
        stopped = True
    return replace(judged, candidates=candidates, interrupted=stopped)


Way: TypeAlias = tuple[str, Training, ParameterEstimates | None]
"""Name, logs and parameters of a candidate."""


def _ways(training: Training, solutions: Sequence[ParameterEstimates]) -> list[Way]:
    """Return the candidates that every fit has."""
    of_rig = [
        (BY_EQUATIONS if parameters.by_equations else BY_FILTER, training, parameters)
        for parameters in reversed(solutions)
    ]
    return [*of_rig, (AS_GIVEN, training, None)]


def readings_map(training: Training) -> MapFit:
    """Return the map of the angles by readings alone."""
    data = [samples_of_angles(log, training.rig) for log in training.logs]
    homing = training.options.homing
    map_fit = map_of(data, training.rig, "readings", training.folds, homing)
    return map_fit if homing is not None else with_its_reference_error(map_fit, training.logs)
