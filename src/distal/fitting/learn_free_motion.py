"""The forces that are normal for a rig in free motion, learned from logs that its fit had not seen:
beside its filter, and by the positions of the drives alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import exp

import numpy as np
from scipy.optimize import nnls
from scipy.signal import lfilter
from scipy.special import stdtrit

from distal.arrays import Floats
from distal.confidence import COVERED
from distal.estimators import AdaptiveFilter, channels_of, parts_of
from distal.estimators.adaptive.drive_tracking import MOTION_TIME
from distal.estimators.adaptive.touch import EVIDENCE_TIME, PACE_TIME
from distal.fitting.map_samples import SETTLING
from distal.fitting.map_search import learned_map
from distal.logs import Log
from distal.regression import FEWEST_LOGS, Samples
from distal.rig import FreeMotion, LearnedMap, MapArrays, Rig
from distal.run import estimate
from distal.run.redundancy import NORMAL, means_along, whitening

LEAST_AT_REST = 0.3
"""Least mean square innovation at rest, as a share of that over all speeds, since a log that rests
seldom says little of rest [1]. Source: judgement.
"""

USUAL_SPREAD = 0.4
"""Std over the logs of a rig of the natural logarithm of a log's largest mean of T² [1]. Source:
benchmark (docs/results/reliability.md: 0.52 over a second, 0.27 over 30 s, on ten rigs).
"""

USUAL_FREEDOM = 8
"""Degrees of freedom of that spread as a prior. Source: judgement (these rigs)."""

UNTOUCHED = 1e6
"""Limit on mean innovations in standard deviations, which none reaches, so that no touch is found
[1]. Source: judgement.
"""


def free_motion_of(
    rigs: Sequence[Rig], logs: Sequence[Log], rms: float, inside: float
) -> FreeMotion | None:
    """Return the normal forces of free motion in `logs`, each with the rig that the other logs
    taught; None where no force is compared.

    The square of each force's mean innovation, in standard deviations, is fitted by a² + b² v² (see
    `FreeMotion`) with nonnegative least squares, and scaled so that `NORMAL` of the samples are
    below it. On these logs the angles have the RMS error `rms` [rad], and the share `inside` of
    them is inside the band.
    """
    rig = rigs[0]
    channels = [s.name for s in rig.sensors if s.measures in ("force", "tension")]
    of_drives = {s.of: s.name for s in rig.sensors if s.measures == "position"}
    drives = tuple(drive.name for drive in rig.drives if drive.name in of_drives)
    if not channels or not drives:
        return None
    positions = [[log.channels[of_drives[name]] for name in drives] for log in logs]
    spread = np.maximum(np.nanstd(np.hstack([np.array(rows) for rows in positions]), axis=1), 1e-9)
    squares, paces, variances = (list[Floats]() for _ in range(3))
    for taught, log, readings in zip(rigs, logs, positions):
        estimator = closed_filter(taught)
        result = estimate(log, taught, estimator)
        begun = log.time - log.time[0] > SETTLING
        stds = np.sqrt(np.maximum(result.innovation_variances, 1e-30))
        shown = np.nan_to_num(result.innovations / stds)
        variances.append(result.innovation_variances[begun])
        squares.append(recent_mean(shown, log.time, EVIDENCE_TIME)[begun] ** 2)
        paces.append(_pace(np.array(readings) / spread[:, None], log)[begun])
    square = np.vstack(squares)
    pace = np.concatenate(paces)
    names = estimator.measured
    compared = [name for name in names if name in channels]
    expected = np.vstack(variances)
    at = [names.index(name) for name in compared]
    ends = np.cumsum([len(log) for log in squares])[:-1].tolist()
    at_rest, moving = zip(*(_normal(square[:, k], pace, ends) for k in at))
    return FreeMotion(
        channels=tuple(compared),
        at_rest=tuple(at_rest),
        moving=tuple(moving),
        rms=rms,
        inside=inside,
        felt=_felt(
            estimator, dict(zip(compared, np.array(at_rest) ** 2 * np.median(expected, 0)[at]))
        ),
        fastest=float(np.max(pace)),
        drives=drives,
        spread=tuple(spread.tolist()),
        logs=len(logs),
    )


def efforts_of(logs: Sequence[Log], rig: Rig, folds: Sequence[int]) -> tuple[LearnedMap, ...]:
    """Return what each force and tension is in free motion, by the positions of the drives of its
    part and what these remember; see `distal.run.redundancy`.

    No log needs the known angle. The errors are those on logs left out; fewer than `FEWEST_LOGS`
    teach nothing.
    """
    efforts = {sensor.name for sensor in rig.sensors if sensor.measures in ("force", "tension")}
    maps = []
    for part in parts_of(rig, channels_of(rig, "regression")):
        forces = tuple(name for name in part["channels"] if name in efforts)
        if not forces or not part["positions"]:
            continue
        names = (*forces, *part["positions"])
        usable = [
            i
            for i, log in enumerate(logs)
            if all(np.isfinite(log.channels.get(n, np.nan)).any() for n in names)
        ]
        if len({folds[i] for i in usable}) < FEWEST_LOGS:
            continue
        data = [_of_efforts(logs[i], forces, part["positions"]) for i in usable]
        described = {**part, "joints": forces, "channels": part["positions"]}
        learned, held_out = learned_map(data, described, [folds[i] for i in usable])
        arrays = dict(learned.arrays.by_name)
        # no variance is asked: the errors on logs left out are what is known of it
        arrays["covariance"] = np.zeros_like(arrays["covariance"])
        errors = [np.array([log.errors for log in logs]) for logs in zip(*held_out)]
        scaled = [whitening(arrays["correlation"]) @ (e.T / learned.rms).T for e in errors]
        times = [log.time for log in held_out[0]]
        update = {"arrays": MapArrays(**arrays), "normal": _largest_means(times, scaled)}
        maps.append(learned.model_copy(update=update))
    return tuple(maps)


def _of_efforts(log: Log, forces: Sequence[str], positions: Sequence[str]) -> Samples:
    readings, targets = (
        np.column_stack([log.channels[name] for name in names]) for names in (positions, forces)
    )
    targets[~np.isfinite(targets).all(axis=1)] = np.nan  # their errors are asked together
    none = np.zeros((len(log), 0))
    time = log.time - log.time[0]
    return Samples(log.source, time, readings, none, targets, np.zeros(targets.shape))


def _largest_means(times: Sequence[Floats], errors: Sequence[Floats]) -> tuple[float, ...]:
    """Return the largest means of T² that are normal on a further log: the bound of 95 % by
    Student's distribution of the logarithms of each left-out log's largest means, with a prior of
    their std from other rigs.

    Args:
        times: stamps of each log [s].
        errors: independent ones of unit variance of each log, (n_forces, k).
    """
    needed = np.log(
        [
            np.quantile(means_along(time, np.mean(of_log**2, axis=0)), NORMAL, axis=0)
            for time, of_log in zip(times, errors, strict=True)
        ]
    )
    logs, means = needed.shape
    freedom = means * (logs - 1) + USUAL_FREEDOM
    squares_about = np.sum(needed.var(axis=0)) * logs + USUAL_FREEDOM * USUAL_SPREAD**2
    spread = np.sqrt(squares_about / freedom * (1 + 1 / logs))
    # neither of the means is to be beyond (Bonferroni)
    bound = stdtrit(freedom, 1 - (1 - COVERED) / (2 * means))
    return tuple(np.exp(needed.mean(axis=0) + bound * spread).tolist())


def recent_mean(values: Floats, stamps: Floats, time: float) -> Floats:
    """Return exponentially fading means as a stream computes them.

    Args:
        values: what is averaged, (k,) or (k, m).
        stamps: times of the samples [s], (n,), as far apart as the values.
        time: time constant of the mean [s].
    """
    fade = exp(-float(np.median(np.diff(stamps))) / time)
    means: Floats = lfilter([1 - fade], [1, -fade], values, axis=0)
    return means


def widest(first: FreeMotion, second: FreeMotion) -> FreeMotion:
    """Return the normal forces of two results for the same sensors and logs, of each limit the
    larger.
    """
    larger = {
        name: tuple(map(max, getattr(first, name), getattr(second, name)))
        for name in ("at_rest", "moving", "felt")
    }
    return first.model_copy(update=larger)


def _felt(estimator: AdaptiveFilter, normal: Mapping[str, float]) -> tuple[float, ...]:
    """Return the least torque on each joint that is felt as a touch, 1/τ₀² = Σ a²/normal [N m]; 0
    for a joint without touches.
    """
    context = estimator.states.context
    felt = list[float]()
    for joint in range(context.n_joints):
        if joint not in context.touchable:
            felt.append(0.0)
            continue
        changes = context.by_contact(joint).items()
        total = sum(change**2 / normal[name] for name, change in changes if name in normal)
        felt.append(float(total**-0.5) if total > 0.0 else 0.0)
    return tuple(felt)


def closed_filter(rig: Rig) -> AdaptiveFilter:
    """Return the filter of a rig without its maps, in which no touch is ever found."""
    return AdaptiveFilter(untouched(rig.bare()), compiled=False)


def untouched(rig: Rig) -> Rig:
    """Return a rig whose filter never finds a touch; without forces none does."""
    forces = tuple(s.name for s in rig.sensors if s.measures in ("force", "tension"))
    if not forces:
        return rig
    drives = tuple(rig.drive_names)
    never = FreeMotion(
        channels=forces,
        at_rest=(UNTOUCHED,) * len(forces),
        moving=(0.0,) * len(forces),
        rms=0.0,
        inside=0.0,
        felt=(0.0,) * len(rig.joints),
        drives=drives,
        spread=(1.0,) * len(drives),
        logs=1,
    )
    return rig.model_copy(update={"free_motion": never})


def _pace(positions: Floats, log: Log) -> Floats:
    """Return v² = Σ (ẋ_i/spread_i)², (k,) [1/s²], each drive's term the largest of the recent
    past.
    """
    interval = float(np.median(np.diff(log.time)))
    fade = exp(-interval / MOTION_TIME)
    slowly = exp(-2 * interval / PACE_TIME)
    rows = np.arange(positions.shape[1])
    read = [np.flatnonzero(np.isfinite(of_drive)) for of_drive in positions]
    filled = np.array([np.interp(rows, at, row[at]) for at, row in zip(read, positions)])
    steps = np.diff(filled, axis=1, prepend=filled[:, :1]) / interval
    speeds = lfilter([1 - fade], [1, -fade], steps, axis=1) ** 2
    paces = np.empty(speeds.shape[1])
    kept = np.zeros(len(positions))
    for k, now in enumerate(speeds.T):
        kept = np.maximum(slowly * kept, now)
        paces[k] = kept.sum()
    return paces


def _normal(square: Floats, pace: Floats, ends: Sequence[int]) -> tuple[float, float]:
    """Return a and b for which the squares are below a² + b² v² in `NORMAL` of the time of each
    log; all but the last log end at the indices `ends`.
    """
    columns = np.column_stack([np.ones(len(pace)), pace])
    size = max(float(np.mean(square)), 1e-12)
    shares, _ = nnls(columns / (1.0, max(float(np.mean(pace)), 1e-12)), square / size)
    still, moving = shares * size / (1.0, max(float(np.mean(pace)), 1e-12))
    still = max(float(still), LEAST_AT_REST * size)
    ratios = np.split(square / (still + moving * pace), ends)
    beyond = max(float(np.quantile(ratio, NORMAL)) for ratio in ratios)
    return float(np.sqrt(still * beyond)), float(np.sqrt(moving * beyond))
