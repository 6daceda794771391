"""Everything that is learned from logs: `judge` makes all candidates and scores them on logs left
out; `Fit.of` is what is written of one.

A filter has parameters that the other logs tell (`jackknife`), a map weights of the other logs, and
least squares are solved without the log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND
from distal.estimators import channels_of, parts_of, samples_of_angles
from distal.fitting.candidates import (
    AS_GIVEN,
    BY_EQUATIONS,
    BY_FILTER,
    Candidate,
    Training,
    Tried,
    filter_candidate,
    tried_parts,
)
from distal.fitting.choice_of_parameters import Options, Progress
from distal.fitting.learned_maps import (
    MapFit,
    map_of,
    with_its_reference_error,
)
from distal.fitting.map_samples import counted_from
from distal.fitting.map_search import HeldOut
from distal.fitting.parameter_estimates import (
    ParameterEstimates,
    parameters_of,
    problem_of,
)
from distal.logs import Log, shown
from distal.regression import YARDSTICKS, Samples, yardstick_error
from distal.rig import Rig


@dataclass(frozen=True)
class Score:
    """The RMS error of an estimator on a log [rad], the share of samples inside its 95 % band, and
    the band's mean half-width [rad].

    `joint_halves` has the half-width of each joint [rad]; it is empty where there is no band.
    """

    rms: float
    inside: float
    half: float
    joint_halves: tuple[float, ...] = ()

    @classmethod
    def of(cls, joints: Sequence[HeldOut], begin: float) -> Score:
        """Return the score of each joint's errors, which count from the time `begin` on [s]."""
        parts = [(joint, joint.time >= begin) for joint in joints]
        pairs = [(joint.errors[late], np.sqrt(joint.variances[late])) for joint, late in parts]
        errors, stds = (np.concatenate(columns) for columns in zip(*pairs))
        return cls(
            _mean(errors**2) ** 0.5,
            _mean(np.abs(errors) <= BAND * stds),
            BAND * _mean(stds),
            tuple(BAND * _mean(of_joint) for _, of_joint in pairs),
        )


def _mean(values: Floats) -> float:
    """Return the mean of some values; NaN where there are none."""
    return float(np.mean(values)) if len(values) else float("nan")


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
        scores: dict[str, Score | None] = {WRITTEN: None if "filter" in maps else alone}
        judged = of_readings[0].time
        if "filter" in maps and i in candidates[0].data:
            of_map = maps["filter"].held_out(list(candidates[0].data).index(i))
            scores[WRITTEN] = Score.of(of_map, begin)
            judged = of_map[0].time
        for candidate in candidates:
            scores[candidate.name] = _of_filter(candidate.data.get(i), judged, begin)
        scores[REGRESSION] = alone
        if homing is None:
            groups = zip(training.groups, every)
            remaining = [samples for group, samples in groups if group != training.groups[i]]
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
        models: the `solutions`, and the parameter estimates of all models whose equations were
            tried.
        chosen: the candidate that errs least on held-out logs.
        candidates: all candidates that were judged.
        interrupted: whether the user interrupted it; what was judged until then stands.
    """

    logs: Sequence[Log]
    training: Training
    line: MapFit | None
    solutions: Sequence[ParameterEstimates]
    models: Sequence[ParameterEstimates]
    chosen: Candidate
    candidates: Sequence[Candidate]
    interrupted: bool


def judge(
    logs: Sequence[Log],
    rig: Rig,
    options: Options,
    progress: Progress | None = None,
) -> Judged:
    """Return the candidates for a description of some logs, each judged on held-out logs.

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
    stopped = solutions[-1].optimum.interrupted
    models = list(solutions)
    candidates = list[Candidate]()
    if line is None:
        chosen = _alone(solutions[-1], rig)
        return Judged(logs, training, line, solutions, models, chosen, candidates, stopped)
    say = progress or (lambda _: None)
    try:
        for name, way, parameters in _ways(training, solutions):
            say(f"judging {name}")
            candidates.append(filter_candidate(name, way, parameters))
        tried = Tried() if stopped else tried_parts(logs, rig, options, solutions[0])
        models += tried.parameters
        for part, parameters in tried.named:
            name = f"{BY_EQUATIONS}, with {part.name}"
            say(f"judging {name}")
            way = replace(training, rig=rig.with_values(part.values), part=part)
            candidates.append(filter_candidate(name, way, parameters))
    except KeyboardInterrupt:
        stopped = True
    # judged without a map: within the logs a map hides what the filter lacks beyond them
    best = min(candidates, key=lambda candidate: candidate.error, default=None)
    chosen = best or _alone(solutions[-1], rig)
    return Judged(logs, training, line, solutions, models, chosen, candidates, stopped)


def _ways(
    training: Training, solutions: Sequence[ParameterEstimates]
) -> list[tuple[str, Training, ParameterEstimates | None]]:
    """Return name, logs and parameters of the candidates that every fit has."""
    of_rig = [
        (BY_EQUATIONS if parameters.by_equations else BY_FILTER, training, parameters)
        for parameters in reversed(solutions)
    ]
    return [*of_rig, (AS_GIVEN, training, None)]


def _alone(parameters: ParameterEstimates, rig: Rig) -> Candidate:
    """Return the candidate of parameter estimates alone, which nothing judges because some joint's
    angle is known in no log.
    """
    return Candidate("numbers", parameters.put_into(rig), parameters, False, float("nan"), {})


def readings_map(training: Training) -> MapFit:
    """Return the map of the angles by readings alone."""
    data = [samples_of_angles(log, training.rig) for log in training.logs]
    homing = training.options.homing
    parts = parts_of(training.rig, channels_of(training.rig, "regression"))
    map_fit = map_of(data, training.rig, "readings", parts, training.folds, homing)
    return map_fit if homing is not None else with_its_reference_error(map_fit, training.logs)
