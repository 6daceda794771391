"""Candidates: the ways to describe what logs show, each judged on the same held-out logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distal.arrays import Bools
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
    Errors,
    Samples,
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
        (mean_rms(candidate.data) for candidate in previous if candidate.data),
        default=np.inf,
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
    map_fit = with_its_reference_error(map_fit, training)
    folds = folds_of(groups)
    error = held_out_rms(samples, left_out_errors(samples, kind, map_fit.terms, folds, homing))

    def learned(logs: Sequence[int], parts: Sequence[Bools]) -> LearnedMap:
        return fit_coefficients(
            [samples[i].part(part) for i, part in zip(logs, parts)], kind, map_fit.terms
        )

    beyond = held_out_rms(samples, errors_beyond(samples, kind, folds, homing, learned), error)
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


def held_out_rms(
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


def best_of(candidates: Sequence[Candidate]) -> Candidate:
    """Return the candidate with the least geometric mean of its two errors on held-out logs,
    √(error · beyond).

    Twice the error within the range of the logs thus weighs as much as twice the error beyond it.
    Of equals the first is taken.
    """

    return min(candidates, key=lambda candidate: np.sqrt(candidate.error * candidate.beyond))


def with_its_reference_error(map_fit: MapFit, training: Training) -> MapFit:
    """Return a map with the error of the reference's zero in its band; unchanged with a homing
    move, which reads that reference.
    """
    if training.options.homing is not None:
        return map_fit
    return map_fit.with_map(with_reference_error(map_fit.learned, training.rig, training.logs))
