"""Causes of an error, tried with reference angles: the filter runs again without each cause. The
one after which it errs least, weighed with the rig's stds, comes first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from distal.arrays import Floats
from distal.diagnosis.causes import Cause
from distal.diagnosis.drive_residuals import INDEPENDENT
from distal.diagnosis.rerun import ModelChange, Outcome, Rerun
from distal.estimators import AdaptiveFilter
from distal.logs import true_angles
from distal.rig import parameters_below

FRICTION_KEYS = ("coefficient", "constant", "load")
"""Keys of friction that are tried."""

LEAST_STD = 0.1
"""Least std of a friction, as a share [1]. Source: judgement."""

FRICTIONS = (0.4, 2.5)
"""Factors on the rig's friction that are tried [1]. Source: judgement."""

FACTORS = (0.5, 0.67, 0.87, 1.15, 1.5, 2.0)
"""Factors on the rig's stiffness, or on the scale of a position, that are tried [1]: the columns of
the two are alike. Source: judgement.
"""

SPACING = 1.3
"""Ratio of two neighbouring `FACTORS`, roughly [1]. Source: judgement."""

NEARER = (0.4, 0.2, 0.1)
"""Steps by which the likeliest changes are tried smaller and larger, as shares [1]: three halvings
of the interval between two `FACTORS`. Source: judgement.
"""

LIKELIEST = 6
"""Number of the likeliest trials that are refined by `NEARER`. Source: judgement."""

COMPLIANCE = {"force": "compliance", "stiffness": "compliance"}
"""Kind of a cause → kind under which it is compared: what stretches a tendon is one cause."""

SURE = 6.0
"""Least gain in −2 ln p of a cause [1]. Source: reference (Kass and Raftery, J. American
Statistical Association 90, 1995: above 6 is strong evidence).
"""

ALIKE = 10.0
"""Difference of gains in −2 ln p below which the second cause is named too [1]. Source: reference
(Kass and Raftery 1995: above 10 is very strong evidence).
"""

HALF = 0.5
"""Largest share of the error that a second cause, beside the first, may leave [1]. Source:
judgement.
"""


@dataclass(frozen=True, eq=False)
class Trial:
    """A cause, tried by the change that removes it.

    Args:
        cause: that is tried.
        change: that removes it.
        gain: in −2 ln p of the truth.
        errors: RMS errors of the joints with the change, NaN without a reference angle, (n_joints,)
            [rad].
        before: the same without the change.
    """

    cause: Cause
    change: ModelChange
    gain: float = 0.0
    errors: Floats = field(default_factory=lambda: np.zeros(0))
    before: Floats = field(default_factory=lambda: np.zeros(0))


def tried(rerun: Rerun, causes: Sequence[Cause]) -> list[Trial]:
    """Return the likeliest causes of an error, at most two, by runs of the filter without each.

    −2 ln p = k Σ_j ln(e_j² + σ_j²) + 2 ln(1 + δ²), with the RMS error e_j of joint j, its mean
    variance σ_j², the number k of independent samples, and the distance δ of the change from the
    rig, in stds of the rig. The last term is Cauchy's prior: a wrong parameter may be wrong by any
    size. If the sensors agree less with each other after the change, that is subtracted from the
    gain.

    Args:
        rerun: runs the filter.
        causes: to be tried.
    """
    if not causes:
        return []
    score = _Score(rerun)
    found = _best_of_each(score.of([*_of_causes(causes), *_of_frictions(rerun.estimator)]))
    for share in NEARER:
        again = [nearer for trial in found[:LIKELIEST] for nearer in _nearer(trial, share)]
        found = _best_of_each([*found, *score.of(again)])
    if not found or found[0].gain < SURE:
        return []
    best, *others = found
    further = [way for cause in causes for way in _ways(cause) if _key(way) != _key(best)]
    together = score.of([replace(way, change=best.change & way.change) for way in further])
    beside = [trial for trial in together if trial.gain > best.gain + SURE and _halves(trial, best)]
    alike = [other for other in others if best.gain - other.gain < ALIKE]
    return [best, *(_best_of_each(beside) or alike)[:1]]


def _halves(trial: Trial, before: Trial) -> bool:
    """Return whether the largest error of a joint falls to half of what it was."""
    return bool(np.nanmax(trial.errors) < HALF * np.nanmax(before.errors))


class _Score:
    """Gain of a run by the reference angles."""

    def __init__(self, rerun: Rerun) -> None:
        joints = rerun.estimator.rig.joint_names
        truths = true_angles(rerun.log, joints)
        assert truths is not None
        self._rerun = rerun
        self._truths = truths
        self._variances = np.mean(rerun.base.variances[:, : len(joints)], axis=0)
        self._count = max(float(np.ptp(rerun.log.time)) / INDEPENDENT, 2.0)
        self._base = self._cost(rerun.base)

    def of(self, trials: Sequence[Trial]) -> list[Trial]:
        """Return trials with their gains; a trial is left out if its parameter is a constant of the
        filter's kernel.
        """
        known = set(self._rerun.estimator.parameter_names)
        possible = [trial for trial in trials if trial.change.parameters.keys() <= known]
        outcomes = self._rerun.each(trial.change for trial in possible)
        scored = []
        for trial, outcome in zip(possible, outcomes):
            if not outcome.bounded:
                continue
            gain = self._base - self._cost(outcome) - self._disagrees(outcome)
            gain -= 2.0 * float(np.log1p(trial.cause.unlikely**2))
            errors = self._errors(outcome)
            before = self._errors(self._rerun.base)
            scored.append(replace(trial, gain=gain, errors=errors, before=before))
        return scored

    def _disagrees(self, outcome: Outcome) -> float:
        """Return by how much less the sensors agree with each other, in −2 ln p: a reading that is
        made so wrong that the filter leaves it out explains nothing.
        """
        lost = _likelihood(self._rerun.base) - _likelihood(outcome)
        return 2.0 * self._count * max(lost, 0.0)

    def _errors(self, outcome: Outcome) -> Floats:
        squares = (outcome.means[:, : self._truths.shape[1]] - self._truths) ** 2
        known = np.isfinite(squares)
        count = known.sum(axis=0)
        total = np.where(known, squares, 0.0).sum(axis=0)
        errors: Floats = np.sqrt(np.where(count > 0, total / np.maximum(count, 1), np.nan))
        return errors

    def _cost(self, outcome: Outcome) -> float:
        return self._count * float(np.nansum(np.log(self._errors(outcome) ** 2 + self._variances)))


def _likelihood(outcome: Outcome) -> float:
    """Return ln p of innovations per compared value."""
    return outcome.log_likelihood / max(int(np.isfinite(outcome.innovations).sum()), 1)


def _ways(cause: Cause) -> list[Trial]:
    return [Trial(cause, change) for change in cause.undone]


def _scaled(cause: Cause, factors: Sequence[float]) -> list[Trial]:
    """Return trials of a cause with other factors."""
    others = (replace(cause, change=factor - 1.0) for factor in factors)
    return [trial for other in others for trial in _ways(other)]


def _of_causes(causes: Sequence[Cause]) -> Iterator[Trial]:
    """Yield a trial for each way to remove each cause, stiffness, scales and forces with other
    factors too.
    """
    for cause in causes:
        yield from _ways(cause)
        if cause.kind in ("stiffness", "scale"):
            yield from _scaled(cause, FACTORS)
        if cause.kind == "force":
            yield from _scaled(cause, cause.units)


def _of_frictions(estimator: AdaptiveFilter) -> Iterator[Trial]:
    """Yield trials of friction in joints and drives that is less, or more, than in the rig."""
    known = set(estimator.parameter_names)
    for kind in ("joints", "drives"):
        for i, part in enumerate(estimator.rig.components[kind]):
            frictions = {f"{kind}.{i}.friction.{key}" for key in FRICTION_KEYS} & known
            paths = {
                path: number
                for path, number in parameters_below(part, f"{kind}.{i}")
                if path in frictions and number.value > 0.0
            }
            if paths:
                std = max(number.total_std / number.value for number in paths.values())
                subject = f"friction of {part.name}"
                cause = Cause(
                    subject, "friction", np.zeros(0), max(std, LEAST_STD), paths=tuple(paths)
                )
                yield from _scaled(cause, FRICTIONS)


def _key(trial: Trial) -> tuple[str, str]:
    return trial.cause.subject, COMPLIANCE.get(trial.cause.kind, trial.cause.kind)


def _best_of_each(trials: Sequence[Trial]) -> list[Trial]:
    """Return the best trial of each subject and kind, the likeliest first."""
    best = dict[tuple[str, str], Trial]()
    for trial in trials:
        key = _key(trial)
        if key not in best or trial.gain > best[key].gain:
            best[key] = trial
    return sorted(best.values(), key=lambda trial: -trial.gain)


def _nearer(trial: Trial, share: float) -> list[Trial]:
    """Return the same cause, removed in the same way, with a smaller and a larger change: by a
    `share` of the change, or of the interval between two `FACTORS`.
    """
    cause = trial.cause
    change = trial.cause.change
    if cause.kind == "swap" or change <= -1.0:
        return []
    if cause.kind in ("zero", "delay"):
        sizes = [(1.0 - share) * change, (1.0 + share) * change]
    else:
        step = SPACING**share
        sizes = [(1.0 + change) / step - 1.0, (1.0 + change) * step - 1.0]
    way = cause.undone.index(trial.change)
    others = [replace(cause, change=size) for size in sizes]
    return [Trial(other, other.undone[way]) for other in others]
