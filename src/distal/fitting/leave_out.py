"""Leave out each log once: learn from the others, and test the result on that log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distal.errors import DistalError
from distal.fitting.learn import Learned, learn
from distal.fitting.options import Options
from distal.fitting.progress import Progress, of_part
from distal.logs import Log, shown, true_angles
from distal.rig import Rig
from distal.run import estimate

MOST_LEFT_OUT = 6
"""At most this many logs (or units) are left out, spread over all: each costs a fit of the others."""


@dataclass(frozen=True)
class Score:
    """Scores of an estimator on a log.

    Args:
        rms: error [rad].
        inside: share of samples inside the 95 % band.
        half: mean half-width of that band [rad].
    """

    rms: float
    inside: float
    half: float


@dataclass(frozen=True)
class Compared:
    """One log that was left out.

    Args:
        log: its name.
        fitted: `adaptive`, learned from the other logs.
        before: `adaptive` with the original rig; None where it cannot run.
        affine: `affine`, learned from the other logs; None where it has no map.
    """

    log: str
    fitted: Score | None
    before: Score | None
    affine: Score | None


@dataclass(frozen=True)
class Fold:
    """One fold: what was learned from some logs, and its scores on those left out.

    Args:
        left_out: names of the logs.
        learned: by `learn` from the others, and from nothing else.
        compared: one for each log with truth that was left out.
    """

    left_out: tuple[str, ...]
    learned: Learned
    compared: tuple[Compared, ...]


def leave_out(
    logs: Sequence[Log],
    rig: Rig,
    options: Options,
    groups: Sequence[str],
    progress: Progress | None = None,
    most: int = MOST_LEFT_OUT,
) -> list[Fold]:
    """Return the result of `learn` on all logs except those of one group, for each group in turn.

    Args:
        logs: of the fit.
        rig: the original description.
        options: of the fit.
        groups: of each log; those of one (a unit, a pose, a day) are left out together.
        progress: called with the progress.
        most: so many groups are left out at most, spread over all.

    Returns:
        folds: one for each group that was left out; fewer where the user stopped it.
    """
    units = list(dict.fromkeys(groups))
    chosen = np.unique(np.linspace(0, len(units) - 1, min(len(units), most)).round().astype(int))
    folds = []
    for part, i in enumerate(chosen, 1):
        out = [log for log, group in zip(logs, groups) if group == units[i]]
        rest = [log for log, group in zip(logs, groups) if group != units[i]]
        try:
            learned = learn(rest, rig, options, of_part(progress, part, len(chosen) + 1))
            if learned.numbers.found.interrupted:
                break  # it says nothing of a fit that ends by itself
            folds.append(_scored(out, rig, learned, options.homing))
        except KeyboardInterrupt:
            break
    return folds


def _scored(out: Sequence[Log], rig: Rig, learned: Learned, homing: float | None) -> Fold:
    compared = []
    for log in out:
        if true_angles(log, [joint.name for joint in rig.joints]) is None:
            continue
        scores = [
            _score(log, each, name, homing)
            for each, name in ((learned.rig, "adaptive"), (rig, "adaptive"), (learned.rig, "affine"))
        ]
        compared.append(Compared(shown(log.source), *scores))
    return Fold(tuple(log.source for log in out), learned, tuple(compared))


def _score(log: Log, rig: Rig, estimator: str, homing: float | None) -> Score | None:
    if estimator == "affine" and rig.affine is None:
        return None
    try:
        result = estimate(log, rig, estimator, compiled=False, homing=homing)
    except DistalError:
        return None
    return Score(result.rms_error(), result.inside_band(), result.half_width())
