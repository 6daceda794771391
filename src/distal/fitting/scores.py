"""Scores: how much each way to know the angle errs on logs left out, of which nothing was learned.

A filter has parameters that the other logs tell (`jackknife`), a map weights of the other logs, and
least squares are solved without the log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND
from distal.estimators import samples_of_angles
from distal.fitting.candidates import Candidate, Training
from distal.fitting.learned_maps import MapFit
from distal.fitting.map_samples import counted_from
from distal.fitting.map_search import HeldOut
from distal.logs import shown
from distal.regression import YARDSTICKS, Samples, yardstick_error


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

    @classmethod
    def of(cls, joints: Sequence[HeldOut], begin: float) -> Score:
        """Return the score of each joint's errors, which count from the time `begin` on [s]."""
        parts = [(joint, joint.time >= begin) for joint in joints]
        pairs = [(joint.errors[late], np.sqrt(joint.variances[late])) for joint, late in parts]
        errors, stds = (np.concatenate(columns) for columns in zip(*pairs))
        return cls(
            _mean(errors**2) ** 0.5,
            _mean(np.abs(errors) <= BAND * stds),
            BAND * _mean(stds),
            tuple(_mean(of_joint**2) ** 0.5 for of_joint, _ in pairs),
            tuple(BAND * _mean(of_joint) for _, of_joint in pairs),
        )


def _mean(values: Floats) -> float:
    """Return the mean of some values; NaN where there are none."""
    return float(np.mean(values)) if len(values) else float("nan")


WRITTEN = "as written"
"""Name of the score of what the fit writes."""

REGRESSION = "readings alone, without the filter"
"""Name of the score of the estimator `regression`."""


@dataclass(frozen=True)
class Compared:
    """A log left out, by its name, and the scores on it of all that the other logs teach, by name.

    A score is None where an estimator cannot run.
    """

    log: str
    scores: Mapping[str, Score | None]


def comparisons(
    training: Training, candidates: Sequence[Candidate], maps: Mapping[str, MapFit]
) -> tuple[Compared, ...]:
    """Return the scores on each log of known angle, but those whose angle is known at the beginning
    alone, which does not count.

    Args:
        training: the logs.
        candidates: what was judged; the first is written, with a map where `maps` has one.
        maps: the maps by their kinds.
    """
    if len(set(training.folds)) < 2:
        return ()
    homing = training.options.homing
    every = [samples_of_angles(log, training.rig) for log in training.logs]
    compared = []
    for i, log in enumerate(training.logs):
        begin = counted_from(log, homing)
        if not np.isfinite(every[i].targets[every[i].time >= begin]).any():
            continue
        of_readings = maps["readings"].held_out(i)
        alone = Score.of(of_readings, begin)
        scores: dict[str, Score | None] = {WRITTEN: None if "filter" in maps else alone}
        judged = of_readings[0].time
        if "filter" in maps and i in candidates[0].data:
            of_map = maps["filter"].held_out(list(candidates[0].data).index(i))
            scores[WRITTEN] = Score.of(of_map, begin)
            judged = of_map[0].time
        for candidate in candidates:
            scores[candidate.name] = _of_filter(candidate.data.get(i), judged, begin)
        scores[REGRESSION] = alone
        if homing is None:
            groups = zip(training.groups, every)
            remaining = [samples for group, samples in groups if group != training.groups[i]]
            early = (every[i].time < begin)[:, None]
            late = replace(every[i], targets=np.where(early, np.nan, every[i].targets))
            for name in YARDSTICKS:
                rms = yardstick_error(name, remaining, late)
                scores[name] = Score(rms, float("nan"), float("nan"))
        compared.append(Compared(shown(log.source), scores))
    return tuple(compared)


def _of_filter(samples: Samples | None, judged: Floats, begin: float) -> Score | None:
    """Return the score of a filter at the times at which maps are `judged` [s], (k,), from the time
    `begin` on [s]; None where it cannot run.
    """
    if samples is None:
        return None
    masks = (np.isfinite(samples.targets) & np.isin(samples.time, judged)[:, None]).T
    errors = [
        HeldOut(samples.time[mask], of_joint[mask], variances[mask])
        for mask, of_joint, variances in zip(masks, samples.targets.T, samples.variances.T)
    ]
    return Score.of(errors, begin)
