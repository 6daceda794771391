"""Each log left out once: how the rig that the others teach does on it, beside the rig as it came and `affine`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from distal.errors import DistalError
from distal.estimators.affine import NORMAL
from distal.fitting.affine import AffineFit
from distal.fitting.discrepancy import filtered, learned_from
from distal.fitting.discrepancy_learning import Errors, errors_of
from distal.logs import Log, shown
from distal.rig import Rig
from distal.run import estimate

MOST_LEFT_OUT = 6
"""So many logs, or units of them, are left out at most, spread over all: each costs a fit of the others."""

CLEARLY = 1.1
"""`affine` is said to do better where the error of `adaptive` is this many times larger."""


@dataclass(frozen=True)
class Score:
    """How an estimator did on a log.

    Args:
        rms: error [rad].
        inside: share of samples inside the 95 % band.
    """

    rms: float
    inside: float


@dataclass(frozen=True)
class Compared:
    """One log that was left out.

    Args:
        log: its name.
        fitted: `adaptive` with what the other logs teach.
        before: `adaptive` with the rig as it came; None where it cannot run.
        affine: `affine` with what the other logs teach; None where it has no map.
    """

    log: str
    fitted: Score
    before: Score | None
    affine: Score | None


def leave_out(
    logs: Sequence[Log],
    every: Sequence[Log],
    start: Rig,
    refitted: Callable[[Sequence[Log]], Rig],
    affine: AffineFit,
    homing: float | None,
    groups: Sequence[str],
) -> tuple[tuple[Compared, ...], list[Errors]]:
    """Return how each log is estimated by what the others teach, and the errors that `adaptive` makes of it.

    Nothing of a log that is left out is used: not in the rig's numbers, not in the discrepancy, its terms or its size.

    Args:
        logs: with truth.
        every: all logs of the fit.
        start: the rig as it came.
        refitted: returns the rig that some logs teach, without a discrepancy.
        affine: what all logs teach, with its own scores on logs left out.
        homing: length of the homing move [s], or None.
        groups: of each log: those of one (a unit, a pose, a day) are left out together.
    """
    units = list(dict.fromkeys(groups))
    chosen = np.unique(np.linspace(0, len(units) - 1, min(len(units), MOST_LEFT_OUT)).round().astype(int))
    compared, errors = [], []
    straight = {one.log: Score(one.rms, one.inside) for one in affine.left_out}
    for unit in (units[i] for i in chosen):
        left = [log for log, group in zip(logs, groups) if group == unit]
        rig = refitted([log for log in every if not any(log is one for one in left)])
        rest = [(log, group) for log, group in zip(logs, groups) if group != unit]
        seen, _ = filtered([log for log, _ in rest], rig, homing, False)
        if len(seen) < len(rest):
            continue  # the filter left all bounds: that is said of the fit to all logs
        made = learned_from(seen, rig, homing, [group for _, group in rest], scored=False).discrepancy
        for out in left:
            for own in filtered([out], rig, homing, False)[0]:
                parts = errors_of(made, own, homing)
                errors.append(parts)
                name = shown(out.source)
                compared.append(Compared(name, _score(parts), _as_it_came(out, start, homing), straight.get(name)))
    return tuple(compared), errors


def _score(parts: Errors) -> Score:
    error = np.concatenate([part[0] for part in parts])
    std = np.sqrt(np.concatenate([part[1] + part[2] for part in parts]))
    return Score(float(np.sqrt(np.mean(error**2))), float(np.mean(np.abs(error) <= NORMAL * std)))


def _as_it_came(log: Log, rig: Rig, homing: float | None) -> Score | None:
    try:
        result = estimate(log, rig, compiled=False, homing=homing)
    except DistalError:
        return None
    return Score(result.rms_error(), result.inside_band())


def verdict(compared: Sequence[Compared]) -> str:
    """Return which estimator did better on logs left out, in a sentence; empty where none was left out.

    Args:
        compared: the logs.
    """
    if not compared:
        return ""
    ours = float(np.mean([one.fitted.rms for one in compared]))
    known = [one.affine.rms for one in compared if one.affine is not None]
    said = f"on logs left out adaptive errs by {np.rad2deg(ours):.3f}° (mean RMS)"
    if not known:
        return said
    other = float(np.mean(known))
    said += f", affine by {np.rad2deg(other):.3f}°"
    if ours > CLEARLY * other:
        said += "; on this rig affine does better: estimate with -e affine"
    return said
