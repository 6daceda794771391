"""Leave out each log once: `learn` from the others, and test the result on that log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from distal.errors import DistalError
from distal.fitting.learn import Learned
from distal.logs import Log, shown, true_angles
from distal.regression import splits
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


@dataclass(frozen=True)
class Compared:
    """One log that was left out: scores of `adaptive` and `affine` learned from the other logs, and
    of the rig `before`.

    A score is None where the estimator cannot run, or has no map.
    """

    log: str
    fitted: Score | None
    before: Score | None
    affine: Score | None


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
            done.append(_scored([logs[i] for i in out], rig, learned, homing))
        except KeyboardInterrupt:
            break
    return done


def _scored(out: Sequence[Log], rig: Rig, learned: Learned, homing: float | None) -> Fold:
    compared, tried = [], ((learned.rig, "adaptive"), (rig, "adaptive"), (learned.rig, "affine"))
    for log in out:
        if true_angles(log, [joint.name for joint in rig.joints]) is None:
            continue
        scores = [_score(log, description, name, homing) for description, name in tried]
        compared.append(Compared(shown(log.source), *scores))
    return Fold(tuple(log.source for log in out), learned, tuple(compared))


def _score(log: Log, rig: Rig, estimator: str, homing: float | None) -> Score | None:
    if estimator == "affine" and rig.affine is None:
        return None
    try:
        estimated = estimate(log, rig, estimator, compiled=False, homing=homing)
    except DistalError:
        return None
    return Score(estimated.rms_error(), estimated.inside_band(), estimated.half_width())
