"""Candidates that report the angle of the affine map: alone, or blended with a filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from distal.arrays import Bools
from distal.estimators import affine_of, affine_samples
from distal.fitting.candidates import (
    Candidate,
    Training,
    held_out_rms,
    with_its_reference_error,
)
from distal.fitting.learn_free_motion import NORMAL, recent_mean
from distal.fitting.learned_maps import MapFit, map_of
from distal.fitting.map_samples import discrepancy_of, mean_rms
from distal.regression import (
    Blend,
    Errors,
    HeldOut,
    Kind,
    Learner,
    Samples,
    Terms,
    as_discrepancy,
    design,
    errors_beyond,
    errors_of,
    fit_coefficients,
    folds_of,
    left_out_errors,
    row_of,
    sized_by,
)
from distal.rig import LearnedMap
from distal.run.health import MEMORY

AFFINE_MAP = "affine map"
"""Name of the candidate that reports the angle of the map `affine`."""

BLEND = "blend of the best filter and the affine map"
"""Name of the candidate whose angle is a weighted mean of the best filter's and the affine map's
within the range of the logs; beyond it moves as the filter does.
"""

LEADS = 3.0
"""Ratio of a filter's angle error without a map to that of the affine map, above which the filter
does not lead beyond the logs. Source: judgement.
"""

SMALLEST_SQUARE = 1e-12
"""Least normal mean square of that difference [rad²]. Source: rounding (members that are one)."""

FOR_WEIGHTS = 3
"""Least number of logs, or groups of logs, that tell the weights of a blend: to be held out in turn
while two or more teach. Source: judgement.
"""


def line_map(training: Training) -> MapFit:
    """Return the map of the estimator `affine`: the angles as a weighted sum of the readings."""
    data = [affine_samples(log, training.rig) for log in training.logs]
    data = [samples.part(np.asarray(np.isfinite(samples.targets).any(axis=1))) for samples in data]
    kind = affine_of(training.rig)
    homing = training.options.homing
    return with_its_reference_error(
        map_of(data, kind, training.rig, homing, training.groups, scored=False), training
    )


def line_candidates(training: Training, line: MapFit, base: Candidate) -> list[Candidate]:
    """Return the candidates that report the angle of the affine map `line`.

    They are the `BLEND` with the filter of the candidate `base`, unless that errs more than `LEADS`
    times as much without its map, or there are fewer logs than `FOR_WEIGHTS`; and the map alone,
    which goes on beyond the logs (`AFFINE_MAP`).
    """
    lines = _Lines(training, line, base)
    alone = lines.alone()
    leads = mean_rms(base.data) < LEADS * alone.error
    return [lines.blend(), alone] if leads and len(set(lines.folds)) >= FOR_WEIGHTS else [alone]


@dataclass(frozen=True)
class _Lines:
    """What both candidates are made from: the logs, the affine map, and the best filter."""

    training: Training
    line: MapFit
    base: Candidate

    @cached_property
    def folds(self) -> list[int]:
        """The fold of each log that the filter could follow."""
        return folds_of([self.training.groups[i] for i in self.base.data])

    @cached_property
    def straight(self) -> list[Samples]:
        """The samples of the affine map along these logs."""
        return [
            _at_times_of(samples, affine_samples(self.training.logs[i], self.training.rig))
            for i, samples in self.base.data.items()
        ]

    @cached_property
    def samples(self) -> list[Samples]:
        """Those of the filter, with readings as logged."""
        return [
            _with_readings_of(filtered, straight)
            for filtered, straight in zip(self.base.data.values(), self.straight)
        ]

    @property
    def kind(self) -> Kind:
        """The kind of map of the filter's error."""
        kind = discrepancy_of(self.training.rig, self.samples)
        return replace(kind, moves=affine_of(self.training.rig).moves)

    @property
    def frame(self) -> MapFit:
        """The filter's own map."""
        return self.base.maps["discrepancy"]

    @property
    def terms_in_words(self) -> str:
        """The terms of the affine map, in words."""
        return self.line.notes[0].partition(": ")[2]

    def alone(self) -> Candidate:
        """Return the affine map as a candidate."""
        kind = affine_of(self.training.rig)
        terms = self.line.terms

        def learned(logs: Sequence[int], parts: Sequence[Bools]) -> LearnedMap:
            inner = self._parts(logs, parts)
            straight = [
                self.straight[i].part(np.isin(self.straight[i].time, part.time))
                for i, part in zip(logs, inner)
            ]
            ranges = fit_coefficients(inner, self.kind, self.frame.terms)
            return as_discrepancy(fit_coefficients(straight, kind, terms), ranges)

        map_fit = self._map_fit(
            as_discrepancy(self.line.learned, self.frame.learned),
            terms,
            f"the angle is that of affine: {self.terms_in_words}",
        )
        errors = left_out_errors(self.straight, kind, terms, self.folds, None)
        return self._judged(AFFINE_MAP, map_fit, errors, learned)

    def blend(self) -> Candidate:
        """Return the blend of the affine map and the filter as a candidate."""
        blend = Blend.of(self.samples, self.kind, self.line.terms, self.folds)

        def learned(logs: Sequence[int], parts: Sequence[Bools]) -> LearnedMap:
            return blend.learned(self._parts(logs, parts), [self.folds[i] for i in logs])

        held = blend.held_out(self.samples, self.folds)
        whole = blend.learned(self.samples, self.folds)
        mixed = _with_normal_difference(sized_by(whole, self.kind, self.folds, held), held)
        shares = ", ".join(
            f"{joint.joint} {100 * weight:.0f} %"
            for joint, weight in zip(mixed.joints, blend.weights(self.samples, self.folds))
        )
        note = f"blended with the affine map, {self.terms_in_words}, whose weight is {shares}"
        map_fit = with_its_reference_error(self._map_fit(mixed, blend.line, note), self.training)
        errors = [errors_of(fold, log, self.kind, None) for fold, log in held]
        return self._judged(BLEND, map_fit, errors, learned)

    def _parts(self, logs: Sequence[int], parts: Sequence[Bools]) -> list[Samples]:
        return [self.samples[i].part(part) for i, part in zip(logs, parts)]

    def _map_fit(self, learned: LearnedMap, terms: Terms, note: str) -> MapFit:
        notes = (f"discrepancy: {note}", *self.frame.notes[1:])
        return replace(self.frame.with_map(learned), notes=notes, terms=terms)

    def _judged(
        self,
        name: str,
        map_fit: MapFit,
        errors: Sequence[Sequence[Errors]],
        learned: Learner,
    ) -> Candidate:
        error = held_out_rms(self.samples, errors)
        beyond = errors_beyond(self.samples, self.kind, self.folds, None, learned)
        return replace(
            self.base,
            name=name,
            rig=map_fit.rig,
            maps={map_fit.table: map_fit},
            error=error,
            beyond=held_out_rms(self.samples, beyond, error),
        )


def _with_normal_difference(blend: LearnedMap, held: Sequence[HeldOut]) -> LearnedMap:
    """Return a blend with its members' difference over the root of its largest normal mean square
    over a second in `held` logs.
    """
    rows = list[tuple[float, ...]]()
    for j, row in enumerate(blend.apart):
        seconds = [
            recent_mean((design(fold, log) @ fold.apart[j]) ** 2, log.time, MEMORY)
            for fold, log in held
        ]
        largest = max(float(np.quantile(np.concatenate(seconds), NORMAL)), SMALLEST_SQUARE)
        rows.append(row_of(np.asarray(row) / np.sqrt(largest)))
    return blend.model_copy(update={"apart": tuple(rows)})


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
