"""Everything that is learned from logs: `judge` makes all candidates and judges them on logs left
out, `learned_by` is what is written of one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distal.estimators import samples_of_angles
from distal.fitting.candidates import (
    AS_GIVEN,
    BY_EQUATIONS,
    BY_FILTER,
    Candidate,
    Training,
    answer_maps,
    filter_candidate,
    groups_among,
)
from distal.fitting.fit_options import Options, Progress, judging
from distal.fitting.free_parameter import FittedParameter, assignments, described
from distal.fitting.learned_maps import (
    MapFit,
    learn_map,
    map_of,
    parts_read,
    with_its_reference_error,
    with_shares,
)
from distal.fitting.missing_terms import MissingTerm, Tried, tried_parts
from distal.fitting.parameter_estimates import (
    ParameterEstimates,
    among_models,
    parameters_of,
    problem_of,
)
from distal.fitting.scores import Compared, comparisons
from distal.logs import Log, true_torques
from distal.rig import Rig

JUDGED = 5
"""Number of candidates of a fit at most, for the bar alone. Source: layout."""


@dataclass(frozen=True)
class Learned:
    """All that is learned from logs.

    Args:
        rig: the description with all results in it.
        parameters: the estimates of the rig's parameters.
        kept: whether `rig` has these estimates; else it has the original values.
        hold: whether filters take the parameters as exactly known.
        maps: the learned maps by their kinds, see `LearnedMaps`.
        part: the term of the physics that the rig lacked and `rig` now has, if any.
        candidates: the candidates that were judged, the chosen one first.
        compared: the scores on each log left out.
        interrupted: whether the user interrupted what was done.
        doubts: sentences with the reasons not to trust the fit.
    """

    rig: Rig
    parameters: ParameterEstimates
    kept: bool
    hold: bool
    maps: Mapping[str, MapFit]
    part: MissingTerm | None
    candidates: tuple[Candidate, ...]
    compared: tuple[Compared, ...]
    interrupted: bool
    doubts: tuple[str, ...]

    @property
    def fitted(self) -> tuple[FittedParameter, ...]:
        """Every free parameter with its value in `rig`."""
        return (
            self.parameters.fitted
            if self.kept
            else tuple(part.as_it_came for part in self.parameters.fitted)
        )


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
    early: Callable[[MapFit], None] | None = None,
) -> Judged:
    """Return the candidates for a description of some logs, each judged on held-out logs.

    Args:
        logs: the logs.
        rig: the original rig, whose values and stds are the priors.
        options: those of `fit`.
        progress: called with what the fit is doing.
        early: called with the map on readings alone as soon as the logs have passed all checks.

    Raises:
        FitError: the logs cannot be fitted.
    """
    training = Training.of(logs, rig, options)
    line = readings_map(training) if training.judges else None
    problem = problem_of(logs, rig, options)
    if line is not None and early is not None:
        early(with_shares(line, dict.fromkeys(rig.joint_names, 1.0)))
    solutions = parameters_of(problem, options, progress)
    stopped = solutions[-1].optimum.interrupted
    models = list(solutions)
    candidates = list[Candidate]()
    if line is None:
        chosen = _alone(solutions[-1], rig)
        return Judged(logs, training, line, solutions, models, chosen, candidates, stopped)
    try:
        for name, way, parameters in _ways(training, solutions):
            judging(progress, f"judging {name}", len(candidates), JUDGED)
            candidates.append(filter_candidate(name, way, parameters))
        tried = Tried() if stopped else tried_parts(logs, rig, options, solutions[0])
        models += tried.parameters
        for part, parameters in tried.named:
            name = f"{BY_EQUATIONS}, with {part.name}"
            judging(progress, f"judging {name}", len(candidates), JUDGED)
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


def learned_by(judged: Judged, chosen: Candidate) -> Learned:
    """Return all that is learned if a candidate is chosen: its parameters, and its maps with those
    that are learned beside it from the same logs.
    """
    options = judged.training.options
    line = judged.line
    alone = judged.solutions[-1] if chosen.parameters is None else chosen.parameters
    parameters = among_models(alone, judged.models)
    learned = chosen.rig.bare()
    maps = _torque_map(judged.logs, learned, options)
    if line is not None:
        maps += answer_maps(chosen, judged.training, line)
    by_kind = {map_fit.kind: map_fit for map_fit in maps}
    ranked = sorted(
        judged.candidates, key=lambda candidate: (candidate is not chosen, candidate.error)
    )
    compared = comparisons(judged.training, ranked, by_kind) if ranked else ()
    return Learned(
        rig=learned.with_map(**{map_fit.kind: map_fit.maps for map_fit in maps}),
        parameters=parameters,
        kept=chosen.parameters is not None,
        hold=chosen.hold,
        maps=by_kind,
        part=chosen.part,
        candidates=tuple(replace(candidate, data={}, rigs=()) for candidate in ranked),
        compared=compared,
        interrupted=judged.interrupted,
        doubts=(
            *parameters.doubts,
            *_unknown(judged.training.unknown),
            *chosen.refused,
            *_as_given(chosen, judged.candidates),
        ),
    )


def _alone(parameters: ParameterEstimates, rig: Rig) -> Candidate:
    """Return the candidate of parameter estimates alone, which nothing judges because some joint's
    angle is known in no log.
    """
    rig = described(rig, assignments(parameters.fitted, parameters.problem.filter.rig))
    return Candidate("numbers", rig, parameters, False, float("nan"), {})


def _unknown(joints: Sequence[str]) -> list[str]:
    if not joints:
        return []
    return [
        f"the angle of {', '.join(joints)} is known in no log: parameters of the rig are fitted, "
        "but no map, which is of all joints"
    ]


def _as_given(chosen: Candidate, candidates: Sequence[Candidate]) -> list[str]:
    """Return a sentence where the rig as given errs least on held-out logs."""
    fitted = [candidate.error for candidate in candidates if candidate.parameters is not None]
    if not fitted or chosen.parameters is not None:
        return []
    return [
        f"{AS_GIVEN} errs less on held-out logs ({np.rad2deg(chosen.error):.2f}°) than the fitted "
        f"one ({np.rad2deg(min(fitted)):.2f}°): its parameters are kept"
    ]


def readings_map(training: Training) -> MapFit:
    """Return the map of the angles by readings alone."""
    data = [samples_of_angles(log, training.rig) for log in training.logs]
    homing = training.options.homing
    parts = parts_read(data, training.rig, training.folds, training.options.guessed)
    map_fit = map_of(data, training.rig, "readings", parts, training.folds, homing)
    return map_fit if homing is not None else with_its_reference_error(map_fit, training.logs)


def _torque_map(logs: Sequence[Log], learned: Rig, options: Options) -> list[MapFit]:
    """Return the map of the external torque, where logs have this torque and the rig says that it
    can occur.
    """
    joints = learned.joint_names
    felt = list[Log]()
    for log in logs:
        torques = true_torques(log, joints)
        if torques is not None and np.isfinite(torques).any():
            felt.append(log)
    if not felt or any(joint.external_torque.std == 0.0 for joint in learned.joints):
        return []
    groups = groups_among(felt, options.units)
    return [learn_map(felt, learned, "torque", homing=options.homing, groups=groups)]
