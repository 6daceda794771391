"""`learn`: everything that is learned from logs. A fold of `leave_out` is the same call with fewer
logs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distal.fitting.candidates import (
    AFFINE_MAP,
    AS_GIVEN,
    BY_EQUATIONS,
    BY_FILTER,
    Candidate,
    Training,
    best_of,
    filter_candidate,
    groups_among,
    line_candidate,
    line_map,
)
from distal.fitting.fit_options import Options
from distal.fitting.fitted_parameter import FittedParameter, assignments, described
from distal.fitting.learned_maps import MapFit, learn_contact
from distal.fitting.missing_terms import MissingTerm, Tried, tried_parts, with_parts
from distal.fitting.parameter_estimates import (
    ParameterEstimates,
    among_models,
    parameters_of,
    problem_of,
)
from distal.fitting.progress import Progress, judging
from distal.fitting.sensor_curves import curves
from distal.logs import Log, true_torques
from distal.rig import Rig


@dataclass(frozen=True)
class Learned:
    """All that is learned from logs: the description with all results, and the rig's numbers as the
    logs tell them.

    Args:
        kept: whether these are in the description; else it has them as they came.
        hold: whether filters take the numbers as they are.
        curves: path → value of the position sensors' systematic errors.
        maps: what was learned beside the numbers, by the name of its table: ``affine``,
            ``discrepancy``, ``contact``.
        part: physics that the rig lacked and the description has now, if any.
        candidates: that were judged, the chosen one first.
        doubts: sentences with the reasons not to trust the fit.
    """

    rig: Rig
    parameters: ParameterEstimates
    kept: bool
    hold: bool
    curves: Mapping[str, object]
    maps: Mapping[str, MapFit]
    part: MissingTerm | None
    candidates: tuple[Candidate, ...]
    doubts: tuple[str, ...]

    @property
    def interrupted(self) -> bool:
        """Whether the user stopped it."""
        return self.parameters.optimum.interrupted

    @property
    def fitted(self) -> tuple[FittedParameter, ...]:
        """Every free number as it is in the description."""
        return (
            self.parameters.fitted
            if self.kept
            else tuple(part.as_it_came for part in self.parameters.fitted)
        )


def learn(
    logs: Sequence[Log],
    rig: Rig,
    options: Options,
    progress: Progress | None = None,
    parts: Sequence[MissingTerm] | None = None,
    early: Callable[[MapFit], None] | None = None,
) -> Learned:
    """Return all that is learned from logs: the candidate that errs least on logs left out, and
    what goes with it.

    All choices that depend on logs are made here, starting from the original rig, whose values and
    stds are the priors. The parts are tried beside the rig's own physics, None for what the
    residuals name; `early` is called with the straight line as soon as nothing speaks against a
    fit.

    Raises:
        FitError: the logs cannot be fitted.
    """
    judged = judge(logs, rig, options, progress, parts, early)
    return learned_by(judged, judged.chosen)


@dataclass(frozen=True)
class Judged:
    """The candidates for a description of some logs, and what each is written from.

    Args:
        line: the map of the estimator `affine`; None where no log has the angle of every joint.
        solutions: the rig's parameters by its equations and by its filter, where each was asked.
        models: those of all models of the equations.
        chosen: the candidate that errs least by the logs' own judgement.
    """

    logs: Sequence[Log]
    training: Training
    line: MapFit | None
    solutions: Sequence[ParameterEstimates]
    models: Sequence[ParameterEstimates]
    chosen: Candidate
    candidates: Sequence[Candidate]


def judge(
    logs: Sequence[Log],
    rig: Rig,
    options: Options,
    progress: Progress | None = None,
    parts: Sequence[MissingTerm] | None = None,
    early: Callable[[MapFit], None] | None = None,
) -> Judged:
    """Return the candidates for a description of some logs; see `learn`.

    Raises:
        FitError: the logs cannot be fitted.
    """
    training = Training.of(logs, rig, options)
    line = line_map(training) if training.judges else None
    problem = problem_of(logs, rig, options)
    if line is not None and early is not None:
        early(line)
    solutions = parameters_of(problem, options, progress)
    chosen, candidates, models = _chosen(logs, training, line, solutions, parts, progress)
    return Judged(logs, training, line, solutions, models, chosen, candidates)


def learned_by(judged: Judged, chosen: Candidate) -> Learned:
    """Return what a candidate teaches, with what was learned beside it from the same logs."""
    options = judged.training.options
    line = judged.line
    alone = judged.solutions[-1] if chosen.parameters is None else chosen.parameters
    parameters = among_models(alone, judged.models)
    bends = (
        dict(curves(parameters.problem.of_filter, parameters.optimum.z)) if options.curves else {}
    )
    learned = described(chosen.rig.bare(), bends)
    maps = [
        *([] if line is None else [line]),
        *chosen.maps.values(),
        *_contact_map(judged.logs, learned, options),
    ]
    candidates = judged.candidates
    ranked = sorted(candidates, key=lambda candidate: (candidate is not chosen, candidate.error))
    return Learned(
        rig=learned.with_values({map_fit.table: map_fit.learned.model_dump() for map_fit in maps}),
        parameters=parameters,
        kept=chosen.parameters is not None,
        hold=chosen.hold,
        curves=bends,
        maps={map_fit.table: map_fit for map_fit in maps},
        part=chosen.part,
        candidates=tuple(replace(candidate, data={}) for candidate in ranked),
        doubts=(
            *parameters.doubts,
            *_unknown(judged.training.unknown),
            *chosen.refused,
            *_as_given(chosen, candidates),
        ),
    )


def _chosen(
    logs: Sequence[Log],
    training: Training,
    line: MapFit | None,
    solutions: Sequence[ParameterEstimates],
    parts: Sequence[MissingTerm] | None,
    progress: Progress | None,
) -> tuple[Candidate, list[Candidate], list[ParameterEstimates]]:
    """Return the candidate that is written, all that were judged, and the numbers of all models of
    the equations.

    The first is of numbers alone where none can be judged, or Ctrl-C came.
    """
    if line is None or solutions[-1].optimum.interrupted:
        return _alone(solutions[-1], training.rig), [], []
    try:
        if parts is None:
            tried = tried_parts(logs, training.rig, training.options, solutions[0])
        else:
            named = with_parts(parts, logs, training.rig, training.options, solutions[0])
            tried = Tried(named, tuple(parameters for _, parameters in named))
        return (
            *_judged(training, line, solutions, tried.named, progress),
            [solutions[0], *tried.parameters],
        )
    except KeyboardInterrupt:
        parameters = replace(
            solutions[-1], optimum=replace(solutions[-1].optimum, interrupted=True)
        )
        return _alone(parameters, training.rig), [], []


def _judged(
    training: Training,
    line: MapFit,
    solutions: Sequence[ParameterEstimates],
    more: Sequence[tuple[MissingTerm, ParameterEstimates]],
    progress: Progress | None,
) -> tuple[Candidate, list[Candidate]]:
    """Return the best of the numbers, of the rig as it came, and of a line beside the better of
    these; and all of them.
    """
    ways = list[tuple[str, Training, ParameterEstimates | None]]()
    for parameters in reversed(solutions):
        if not parameters.optimum.interrupted:
            ways.append(
                (BY_EQUATIONS if parameters.by_equations else BY_FILTER, training, parameters)
            )
    for part, parameters in more:
        described_as = replace(training, rig=training.rig.with_values(part.values), part=part)
        ways.append((f"{BY_EQUATIONS}, with {part.name}", described_as, parameters))
    ways.append((AS_GIVEN, training, None))
    filters = list[Candidate]()
    for name, described_as, way_parameters in ways:
        judging(progress, f"judging {name}", len(filters), len(ways))
        filters.append(filter_candidate(name, described_as, way_parameters, filters))
    base = best_of([candidate for candidate in filters if candidate.maps] or filters)
    if not base.maps:
        return base, filters
    candidates = (
        filters
        if training.options.homing is not None
        else [*filters, line_candidate(training, line, base)]
    )
    return best_of(candidates), candidates


def _alone(parameters: ParameterEstimates, rig: Rig) -> Candidate:
    """Return the numbers as a description that nothing judges: no log has the angle of every
    joint.
    """
    rig = described(rig, assignments(parameters.fitted, parameters.problem.filter.rig))
    return Candidate("numbers", rig, parameters, False, {}, float("nan"), float("nan"), {})


def _unknown(joints: Sequence[str]) -> list[str]:
    if not joints:
        return []
    return [
        f"the angle of {', '.join(joints)} is known in no log: parameters of the rig are fitted, "
        "but no affine map and no correction (discrepancy), which are of all joints"
    ]


def _as_given(chosen: Candidate, candidates: Sequence[Candidate]) -> list[str]:
    """Return a sentence where the rig as given errs least on held-out logs."""
    fitted = [
        candidate.error
        for candidate in candidates
        if candidate.parameters is not None and candidate.name != AFFINE_MAP
    ]
    if not fitted or chosen.parameters is not None:
        return []
    return [
        f"{AS_GIVEN} errs less on held-out logs ({np.rad2deg(chosen.error):.2f}°) than the fitted "
        f"one ({np.rad2deg(min(fitted)):.2f}°): its parameters are kept"
    ]


def _contact_map(logs: Sequence[Log], learned: Rig, options: Options) -> list[MapFit]:
    """Return the map of the external torque, if the logs have it and the rig says that it can
    occur.
    """
    felt = [
        log
        for log in logs
        if true_torques(log, [joint.name for joint in learned.joints]) is not None
    ]
    if not felt or any(joint.external_torque.std == 0.0 for joint in learned.joints):
        return []
    return [learn_contact(felt, learned, options.homing, groups_among(felt, options), scored=False)]
