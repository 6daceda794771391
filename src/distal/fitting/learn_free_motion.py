"""The forces that are normal for a rig in free motion, by the positions of its drives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from distal.arrays import Floats
from distal.confidence import COVERED
from distal.estimators import channels_of, parts_of
from distal.fitting.learned_maps import learned_map
from distal.logs import Log
from distal.regression import FEWEST_LOGS, Samples, whitening
from distal.rig import LearnedMap, MapArrays, Rig
from distal.run.redundancy import NORMAL, means_along

USUAL_SPREAD = 0.4
"""Std over the logs of a rig of the natural logarithm of a log's largest mean of T² [1]. Source:
benchmark (docs/results/reliability.md: 0.52 over a second, 0.27 over 30 s, on ten rigs).
"""

USUAL_FREEDOM = 8
"""Degrees of freedom of that spread as a prior. Source: judgement (these rigs)."""


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
        # at rest nobody knows on which side of a wide play a force is
        of_usable = [folds[i] for i in usable]
        learned, held_out = learned_map(data, described, of_usable, plays=(1.0,))
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


def untouched(rig: Rig) -> Rig:
    """Return a rig whose filter never looks for a touch; without forces none does."""
    if not any(sensor.measures in ("force", "tension") for sensor in rig.sensors):
        return rig
    never = tuple(joint.model_copy(update={"touch": "never"}) for joint in rig.joints)
    return rig.model_copy(update={"joints": never})
