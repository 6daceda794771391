"""Cross-validation of a fit: `learn` without the logs of a fold, and test the result on these."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import radians

import numpy as np

from distal.errors import DistalError
from distal.estimators import affine_samples
from distal.fitting.candidates import Candidate
from distal.fitting.fitted_parameter import described
from distal.fitting.learn import Learned
from distal.fitting.learn_free_motion import untouched
from distal.logs import Log, shown, true_angles
from distal.regression import YARDSTICKS, splits, yardstick_error
from distal.rig import Rig
from distal.run import estimate


@dataclass(frozen=True)
class Score:
    """The RMS error of an estimator on a log [rad], the share of samples inside its 95 % band, and
    the band's mean half-width [rad].

    Of each joint `joint_rms` has the RMS error and `joint_halves` the mean half-width of the band
    [rad]; both are empty where there is no band.
    """

    rms: float
    inside: float
    half: float
    joint_rms: tuple[float, ...] = ()
    joint_halves: tuple[float, ...] = ()


WRITTEN = "as written, chosen without each log"
"""Name of the score of what the fit writes, chosen anew without the held-out log."""

ALONE = "the rig as given, nothing learned"
"""Name of the score of the original rig without any learned map."""

AFFINE = "affine map, as the file has it"
"""Name of the score of the estimator `affine` with the learned affine map."""


@dataclass(frozen=True)
class Compared:
    """A held-out log, by its name, and the scores on it of all that the other logs teach, by name.

    A score is None where an estimator cannot run.
    """

    log: str
    scores: Mapping[str, Score | None]


@dataclass(frozen=True)
class Fold:
    """One fold: the names of the held-out logs, what was learned from the others alone, and the
    scores on those held-out logs whose angle is known.
    """

    left_out: tuple[str, ...]
    learned: Learned
    compared: tuple[Compared, ...]


def leave_out(
    logs: Sequence[Log],
    rig: Rig,
    folds: Sequence[int],
    learned_from: Callable[[Sequence[Log], int], Learned],
    homing: float | None,
) -> list[Fold]:
    """Return for each fold what is learned from the logs of all other folds, and its scores on the
    fold's own logs.

    There are fewer results than folds where the user interrupts.

    Args:
        logs: all logs.
        rig: the original rig.
        folds: the fold of each log.
        learned_from: `learn`, called with the logs of the other folds and the number of the fold,
            from 1.
        homing: for how long the reference is read [s], None for never.
    """
    done = list[Fold]()
    for count, (out, remaining) in enumerate(splits(folds), 1):
        try:
            learned = learned_from([logs[i] for i in remaining], count)
            if learned.interrupted:
                break  # an interrupted fit says nothing of a complete one
            held_out = [logs[i] for i in out]
            others = [logs[i] for i in remaining]
            done.append(_scored(held_out, others, rig, learned, homing))
        except KeyboardInterrupt:
            break
    return done


def candidate_by_folds(
    folds: Sequence[Fold],
    candidates: Sequence[Candidate],
    preferred: Candidate,
    offset: float,
) -> Candidate:
    """Return the candidate that errs clearly less than the `preferred` one on held-out logs, or
    else the preferred one.

    The cost of a candidate is √(RMS on held-out logs · RMS beyond what it had seen), each the mean
    over all folds: twice the error within the range of the logs weighs as much as twice the error
    beyond it. The errors must differ by more than the `offset` may explain, which the reference has
    on all logs [rad]; a preferred candidate that cannot run on some log errs infinitely.
    """
    errors = _errors(folds)
    unknown = (np.inf, np.inf)

    def cost(candidate: Candidate) -> float:
        rms, beyond = errors.get(candidate.name, unknown)
        return float(np.sqrt(rms * beyond))

    best = min(candidates, key=cost, default=preferred)
    rms = errors.get(best.name, unknown)[0]
    usual = errors.get(preferred.name, unknown)[0]
    is_better = cost(best) < CLEARLY * cost(preferred)
    return best if is_better and usual > np.hypot(rms, offset) else preferred


CLEARLY = 0.9
"""Ratio of two costs below which one candidate errs clearly less than another, since few logs tell
no smaller difference. Source: judgement.
"""


def _errors(folds: Sequence[Fold]) -> dict[str, tuple[float, float]]:
    """Return the mean RMS error on held-out logs of each candidate that has a score on all, and
    that beyond what it had seen [rad], by name.
    """
    errors = dict[str, tuple[float, float]]()
    for name in {each.name: None for fold in folds for each in fold.learned.candidates}:
        scores = [comparison.scores.get(name) for fold in folds for comparison in fold.compared]
        beyond = [
            each.beyond
            for fold in folds
            for each in fold.learned.candidates
            if each.name == name and fold.compared
        ]
        if scores and None not in scores:
            rms = float(np.mean([score.rms for score in scores if score is not None]))
            # a fold whose filter could not follow the logs says nothing of what is beyond them
            known = [error for error in beyond if np.isfinite(error)]
            errors[name] = rms, float(np.mean(known)) if known else rms
    return errors


def with_written(folds: Sequence[Fold], offset: float) -> list[Fold]:
    """Return the folds with the score `WRITTEN` added: that of the candidate which the fit would
    write without the fold's logs, which `candidate_by_folds` chooses from all other folds with the
    error `offset` of the reference [rad].
    """
    written = []
    for k, fold in enumerate(folds):
        others = [*folds[:k], *folds[k + 1 :]]
        candidates = fold.learned.candidates
        name = candidate_by_folds(others, candidates, candidates[0], offset).name
        compared = tuple(
            replace(each, scores={WRITTEN: each.scores.get(name), **each.scores})
            for each in fold.compared
        )
        written.append(replace(fold, compared=compared))
    return written


def _scored(
    out: Sequence[Log],
    remaining: Sequence[Log],
    rig: Rig,
    learned: Learned,
    homing: float | None,
) -> Fold:
    joints = rig.joint_names
    compared = [
        Compared(shown(log.source), _scores(log, remaining, rig, learned, homing))
        for log in out
        if true_angles(log, joints) is not None
    ]
    return Fold(tuple(log.source for log in out), learned, tuple(compared))


def _scores(
    log: Log, remaining: Sequence[Log], rig: Rig, learned: Learned, homing: float | None
) -> dict[str, Score | None]:
    """Return the scores on a held-out log of all that the remaining logs teach, by name."""
    scores = {
        candidate.name: _score(log, described(candidate.rig, learned.curves), "adaptive", homing)
        for candidate in learned.candidates
    }
    scores[ALONE] = _score(log, rig, "adaptive", homing)
    if learned.rig.affine is not None:
        scores[AFFINE] = _score(log, learned.rig, "affine", homing)
        if homing is None:
            scores |= _yardsticks(log, remaining, rig)
    return scores


def _yardsticks(log: Log, remaining: Sequence[Log], rig: Rig) -> dict[str, Score | None]:
    joints = rig.joint_names
    held_out = affine_samples(log, rig)
    training = [
        affine_samples(other, rig) for other in remaining if true_angles(other, joints) is not None
    ]
    return {
        name: Score(yardstick_error(name, training, held_out), float("nan"), float("nan"))
        for name in YARDSTICKS
    }


def _score(log: Log, rig: Rig, estimator: str, homing: float | None) -> Score | None:
    # logs of a fit are of free motion, and without the normal forces of it, which these very logs
    # are to show, a filter that lacks physics takes what it lacks for touches
    free = untouched(rig) if estimator == "adaptive" and homing is None else rig
    try:
        estimated = estimate(log, free, estimator, compiled=False, homing=homing)
    except DistalError:
        return None
    summary = estimated.summary()
    halves = estimated.stds_of_band * estimated.angle_stds.mean(axis=0)
    return Score(
        estimated.rms_error(),
        estimated.inside_band(),
        estimated.half_width(),
        tuple(radians(row["RMS error [deg]"] or 0.0) for row in summary),
        tuple(float(half) for half in halves),
    )
