"""Leave out each log once: `learn` from the others, and test the result on that log."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from distal.errors import DistalError
from distal.estimators import affine_samples
from distal.fitting.learn import Learned
from distal.logs import Log, shown, true_angles
from distal.regression import YARDSTICKS, splits, yardstick_error
from distal.rig import Rig
from distal.run import estimate


@dataclass(frozen=True)
class Score:
    """RMS error of an estimator on a log [rad], share of samples inside the 95 % band, and its mean
    half-width [rad].
    """

    rms: float
    inside: float
    half: float


WRITTEN = "as written, chosen anew without each log"
ALONE = "the rig as given, nothing learned"
AFFINE = "affine map, as the file has it"
"""What is scored on each held-out log beside the candidates and the yardsticks."""


@dataclass(frozen=True)
class Compared:
    """A held-out log, and the scores of all that the other logs teach, by name.

    A score is None where an estimator cannot run.
    """

    log: str
    scores: Mapping[str, Score | None]


@dataclass(frozen=True)
class Fold:
    """One fold: names of the logs left out, what was learned from the others alone, and scores on
    those with truth.
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
    """Return what is learned from all logs except those of one fold, and its scores on these, for
    each fold in turn.

    There are fewer folds where the user stopped it. The reference is used for `homing` [s], None
    for never. `learned_from` is `learn` of some logs; it gets these and the number of the fold,
    from 1.
    """
    done = list[Fold]()
    for count, (out, remaining) in enumerate(splits(folds), 1):
        try:
            learned = learned_from([logs[i] for i in remaining], count)
            if learned.interrupted:
                break  # it says nothing of a fit that ends by itself
            held_out, others = [logs[i] for i in out], [logs[i] for i in remaining]
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
    joints = [joint.name for joint in rig.joints]
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
    for candidate in learned.candidates:
        is_written = candidate is learned.candidates[0] and not learned.curves
        scores[candidate.name] = (
            scores[WRITTEN] if is_written else _score(log, candidate.rig, "adaptive", homing)
        )
    scores[ALONE] = _score(log, rig, "adaptive", homing)
    if learned.rig.affine is not None:
        scores[AFFINE] = _score(log, learned.rig, "affine", homing)
        if homing is None:
            scores |= _yardsticks(log, remaining, rig)
    return scores


def _yardsticks(log: Log, remaining: Sequence[Log], rig: Rig) -> dict[str, Score | None]:
    joints = [joint.name for joint in rig.joints]
    held_out = affine_samples(log, rig)
    training = [
        affine_samples(other, rig) for other in remaining if true_angles(other, joints) is not None
    ]
    return {
        name: Score(yardstick_error(name, training, held_out), float("nan"), float("nan"))
        for name in YARDSTICKS
    }


def _score(log: Log, rig: Rig, estimator: str, homing: float | None) -> Score | None:
    try:
        estimated = estimate(log, rig, estimator, compiled=False, homing=homing)
    except DistalError:
        return None
    return Score(estimated.rms_error(), estimated.inside_band(), estimated.half_width())
