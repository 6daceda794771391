"""Cross-validation of a fit: `learn` without the logs of a fold, and test the result on these."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import radians

from distal.errors import DistalError
from distal.estimators import samples_of_angles
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

REGRESSION = "readings alone, without the filter"
"""Name of the score of the estimator `regression`."""


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
    scores = {WRITTEN: _score(log, learned.rig, "adaptive", homing)}
    for candidate in learned.candidates[1:]:
        rig_of = described(candidate.rig, learned.curves)
        scores[candidate.name] = _score(log, rig_of, "adaptive", homing)
    if learned.rig.map is not None and learned.rig.map.readings:
        scores[REGRESSION] = _score(log, learned.rig, "regression", homing)
        if homing is None:
            scores |= _yardsticks(log, remaining, rig)
    return scores


def _yardsticks(log: Log, remaining: Sequence[Log], rig: Rig) -> dict[str, Score | None]:
    joints = rig.joint_names
    held_out = samples_of_angles(log, rig)
    training = [
        samples_of_angles(other, rig)
        for other in remaining
        if true_angles(other, joints) is not None
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
