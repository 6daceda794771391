"""Candidates: the ways to describe what logs show, each judged on the same held-out logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distal.arrays import Bools
from distal.estimators import affine_of, affine_samples
from distal.fitting.fit_options import Options
from distal.fitting.fitted_parameter import assignments, described
from distal.fitting.jackknife import parameters_without
from distal.fitting.learned_maps import MapFit, map_of
from distal.fitting.log_checks import unknown_joints
from distal.fitting.map_samples import (
    discrepancy_of,
    filtered,
    mean_rms,
    partly_homed,
    with_reference_error,
)
from distal.fitting.missing_terms import MissingTerm
from distal.fitting.parameter_estimates import ParameterEstimates
from distal.logs import Log, true_angles
from distal.regression import (
    Blend,
    Errors,
    Learner,
    Samples,
    Terms,
    as_discrepancy,
    errors_beyond,
    fit_coefficients,
    folds_of,
    groups_of,
    left_out_errors,
    rms_beyond_noise,
)
from distal.rig import LearnedMap, Rig

AS_GIVEN = "the rig as given"
"""Name of the candidate that is the original rig.

Each candidate but the affine map has a correction map (`discrepancy`) for the errors of its angle.
"""

AFFINE_MAP = "affine map"
"""Name of the candidate that reports the angle of the map `affine`."""

BLEND = "blend of the best filter and the affine map"
"""Name of the candidate whose angle is a weighted mean of the best filter's and the affine map's
within the range of the logs; beyond it moves as the filter does.
"""

BY_EQUATIONS = "parameters by its equations"
"""Name of the candidate whose parameters are estimated by the rig's equations."""

BY_FILTER = "parameters by its filter"
"""Name of the candidate whose parameters are estimated by the rig's filter."""

SURER = 0.85
"""Ratio of the angle's errors with parameters taken as exactly known (`hold`) and without, below
which filters take them so. Source: judgement.
"""

FAR = 1.5
"""Ratio of a filter's angle error to the least of the filters before it, above which it gets no
map. Source: judgement.
"""

LEADS = 3.0
"""Ratio of a filter's angle error without a map to that of the affine map, above which the filter
does not lead beyond the logs. Source: judgement.
"""


FOR_WEIGHTS = 3
"""Least number of logs, or groups of logs, that tell the weights of a blend: to be held out in turn
while two or more teach. Source: judgement.
"""


def groups_among(logs: Sequence[Log], options: Options) -> tuple[str, ...]:
    """Return the group of each log, whose logs are held out together: its unit with the option
    `units`, else a group of its own.
    """
    names = [log.source for log in logs]
    if options.units is None or not names:
        return tuple(str(i) for i in range(len(names)))
    return tuple(groups_of(names, options.units, 1))


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
        return cls(with_truth, groups_among(with_truth, options), rig, options, unknown)

    @property
    def judges(self) -> bool:
        """Whether candidates can be judged: every joint's angle is known in some log."""
        return bool(self.logs) and not self.unknown

    @property
    def folds(self) -> list[int]:
        """The fold of each log."""
        return folds_of(self.groups)


@dataclass(frozen=True)
class Candidate:
    """One way to describe what logs show.

    Args:
        name: name in words.
        rig: the description, with parameters and maps.
        parameters: the parameter estimates in it; None where it has the original values.
        hold: whether filters take the parameters as exactly known.
        maps: the learned maps by the names of their tables.
        error: RMS error of the angle on held-out logs [rad]; infinite where it cannot run.
        beyond: the same in the outer part of these logs, with a map learned from the inner part of
            the others [rad].
        data: the filter's estimates along the logs, with parameters that have not seen them, by the
            index of the log.
        refused: sentences on logs that its filter could not follow.
        part: the term of the physics that was added to the original description, if any.
    """

    name: str
    rig: Rig
    parameters: ParameterEstimates | None
    hold: bool
    maps: Mapping[str, MapFit]
    error: float
    beyond: float
    data: Mapping[int, Samples]
    refused: tuple[str, ...] = ()
    part: MissingTerm | None = None


@dataclass(frozen=True)
class _Run:
    """The filter's estimates along the logs, with parameters that have not seen them, by the index
    of the log.
    """

    rig: Rig
    rigs: Sequence[Rig]
    hold: bool
    data: Mapping[int, Samples]
    refused: Sequence[str]


def filter_candidate(
    name: str,
    training: Training,
    parameters: ParameterEstimates | None,
    previous: Sequence[Candidate] = (),
) -> Candidate:
    """Return the candidate of a rig's filter and the map of the errors of its angle.

    Its parameters are the given estimates; None stands for the original values. Where a filter of
    the `previous` candidates errs far less, it gets no map.
    """
    run = _run(training, parameters, False)
    plain = Candidate(
        name,
        run.rig,
        parameters,
        False,
        {},
        np.inf,
        np.inf,
        run.data,
        tuple(run.refused),
        training.part,
    )
    least = min(
        (mean_rms(candidate.data) for candidate in previous if candidate.data), default=np.inf
    )
    if not run.data or mean_rms(run.data) > FAR * least:
        judged = bool(run.data) and len(set(training.folds)) > 1
        return (
            replace(plain, error=mean_rms(run.data), beyond=mean_rms(run.data)) if judged else plain
        )
    run = _surest(run, training, parameters)
    homing = training.options.homing
    samples = list(run.data.values())
    ran = list(run.data)
    rigs = [run.rigs[i] for i in ran]
    groups = [training.groups[i] for i in ran]
    half = partly_homed([training.logs[i] for i in ran], rigs, homing, training.options.compiled)
    kind = discrepancy_of(run.rig, samples)
    map_fit = map_of(samples, kind, run.rig, homing, groups, scored=False, partly=half)
    map_fit = _with_reference_error(map_fit, training)
    folds = folds_of(groups)
    error = _rms(samples, left_out_errors(samples, kind, map_fit.terms, folds, homing))

    def learned(logs: Sequence[int], parts: Sequence[Bools]) -> LearnedMap:
        return fit_coefficients(
            [samples[i].part(part) for i, part in zip(logs, parts)], kind, map_fit.terms
        )

    beyond = _rms(samples, errors_beyond(samples, kind, folds, homing, learned), error)
    maps = {map_fit.table: map_fit}
    return replace(
        plain, rig=map_fit.rig, hold=run.hold, maps=maps, error=error, beyond=beyond, data=run.data
    )


def _surest(run: _Run, training: Training, parameters: ParameterEstimates | None) -> _Run:
    """Return the run of the filter that takes the parameters as exactly known, where it errs far
    less than the given run.
    """
    if parameters is None or training.options.homing is not None:
        return run
    surer = _run(training, parameters, True)
    return (
        surer
        if len(surer.data) == len(run.data) and mean_rms(surer.data) < SURER * mean_rms(run.data)
        else run
    )


def _rms(
    samples: Sequence[Samples], errors: Sequence[Sequence[Errors]], unknown: float = np.inf
) -> float:
    """Return the RMS error on held-out logs beyond the reference's noise [rad]; `unknown` where no
    log is held out.
    """
    error = rms_beyond_noise(errors, max(log_samples.reference_std for log_samples in samples))
    return error if np.isfinite(error) else unknown


def _run(training: Training, parameters: ParameterEstimates | None, hold: bool) -> _Run:
    def described_by(source: ParameterEstimates) -> Rig:
        return described(training.rig, assignments(source.fitted, source.problem.filter.rig, hold))

    rig = training.rig
    rigs = [training.rig] * len(training.folds)
    if parameters is not None:
        of_folds = parameters_without(parameters, training.logs, training.folds)
        fold_rigs = [described_by(of_fold) for of_fold in of_folds]
        rig = described_by(parameters)
        rigs = [fold_rigs[fold] for fold in training.folds]
    return _Run(
        rig,
        rigs,
        hold,
        *filtered(training.logs, rigs, training.options.homing, training.options.compiled),
    )


def line_map(training: Training) -> MapFit:
    """Return the map of the estimator `affine`: the angles as a weighted sum of the readings."""
    data = [affine_samples(log, training.rig) for log in training.logs]
    data = [samples.part(np.asarray(np.isfinite(samples.targets).any(axis=1))) for samples in data]
    kind = affine_of(training.rig)
    homing = training.options.homing
    return _with_reference_error(
        map_of(data, kind, training.rig, homing, training.groups, scored=False), training
    )


def line_candidates(training: Training, line: MapFit, base: Candidate) -> list[Candidate]:
    """Return the candidates that report the angle of the affine map `line`.

    They are the `BLEND` with the filter of the candidate `base`, unless that errs more than `LEADS`
    times as much without its map, or there are fewer logs than `FOR_WEIGHTS`; and the map alone,
    which goes on beyond the logs (`AFFINE_MAP`).
    """
    frame = base.maps["discrepancy"]
    among = [
        _at_times_of(samples, affine_samples(training.logs[i], training.rig))
        for i, samples in base.data.items()
    ]
    folds = folds_of([training.groups[i] for i in base.data])
    kind = affine_of(training.rig)
    samples = [
        _with_readings_of(filtered_log, straight)
        for filtered_log, straight in zip(base.data.values(), among)
    ]
    ranges = discrepancy_of(training.rig, samples)
    said = line.notes[0].partition(": ")[2]

    def judged(
        name: str,
        learned: LearnedMap,
        terms: Terms,
        note: str,
        errors: Sequence[Sequence[Errors]],
        learner: Learner,
    ) -> Candidate:
        map_fit = replace(frame.with_map(learned), notes=(note, *frame.notes[1:]), terms=terms)
        error = _rms(samples, errors)
        return replace(
            base,
            name=name,
            rig=map_fit.rig,
            maps={map_fit.table: map_fit},
            error=error,
            beyond=_rms(samples, errors_beyond(samples, ranges, folds, None, learner), error),
        )

    def learned_line(logs: Sequence[int], parts: Sequence[Bools]) -> LearnedMap:
        inner = [samples[i].part(part) for i, part in zip(logs, parts)]
        straight = [
            among[i].part(np.isin(among[i].time, part.time)) for i, part in zip(logs, inner)
        ]
        inner_line = fit_coefficients(straight, kind, line.terms)
        return as_discrepancy(inner_line, fit_coefficients(inner, ranges, frame.terms))

    alone = judged(
        AFFINE_MAP,
        as_discrepancy(line.learned, frame.learned),
        line.terms,
        f"discrepancy: the angle is that of affine: {said}",
        left_out_errors(among, kind, line.terms, folds, None),
        learned_line,
    )
    if len(set(folds)) < FOR_WEIGHTS or mean_rms(base.data) >= LEADS * alone.error:
        return [alone]
    blend = Blend.of(samples, ranges, line.terms, folds)

    def learned_blend(logs: Sequence[int], parts: Sequence[Bools]) -> LearnedMap:
        inner = [samples[i].part(part) for i, part in zip(logs, parts)]
        return blend.learned(inner, [folds[i] for i in logs])

    errors = blend.left_out_errors(samples, folds)
    mixed = blend.sized(samples, folds, errors)
    shares = ", ".join(
        f"{joint.joint} {100 * weight:.0f} %"
        for joint, weight in zip(mixed.joints, blend.weights(samples, folds))
    )
    note = f"discrepancy: blended with the affine map, {said}, whose weight is {shares}"
    return [
        judged(
            BLEND,
            _with_reference_error(frame.with_map(mixed), training).learned,
            blend.line,
            note,
            errors,
            learned_blend,
        ),
        alone,
    ]


def best_of(candidates: Sequence[Candidate]) -> Candidate:
    """Return the candidate with the least geometric mean of its two errors on held-out logs,
    √(error · beyond).

    Twice the error within the range of the logs thus weighs as much as twice the error beyond it.
    Of equals the first is taken.
    """

    return min(candidates, key=lambda candidate: np.sqrt(candidate.error * candidate.beyond))


def _at_times_of(samples: Samples, straight: Samples) -> Samples:
    """Return the samples `straight`, with their target known only at times at which that of
    `samples` is.
    """
    has_target = np.isin(straight.time, samples.time[np.isfinite(samples.targets).any(axis=1)])
    targets = np.where(has_target[:, None], straight.targets, np.nan)
    return replace(straight, targets=targets, reference_std=samples.reference_std)


def _with_readings_of(samples: Samples, straight: Samples) -> Samples:
    """Return samples of a filter with the readings as logged, which those of `straight` are; the
    filter's own are positions of drives, without the biases that the fit found.
    """
    rows = np.searchsorted(straight.time, samples.time)
    return replace(samples, readings=straight.readings[np.minimum(rows, len(straight.time) - 1)])


def _with_reference_error(map_fit: MapFit, training: Training) -> MapFit:
    if training.options.homing is not None:
        return map_fit
    return map_fit.with_map(with_reference_error(map_fit.learned, training.rig, training.logs))
