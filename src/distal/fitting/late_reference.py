"""How late a reference is: the age L of its samples; or whether joints follow their drives late.

Two candidates explain a lag between drives and reference. The reference is late by L: what it reads
at t follows from φ(y) at t − L. Or the joints are, by a lag of first order with time constant τ: it
follows from φ(y) behind that lag. Each is the map on readings alone with hyperparameters of its
own, and the likelier one on logs left out is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np

from distal.arrays import Floats
from distal.estimators import channels_of, samples_of_angles
from distal.fitting.learned_maps import Seen, Task
from distal.logs import Log, TruthKind, earlier
from distal.regression import FEWEST_LOGS, Evidence, Prior, Samples
from distal.rig import Rig, angle_names

LARGEST_USUAL = 0.08
"""Lags of a camera with its driver up to this are equally likely [s]. Source: judgement."""

UNUSUAL_STD = 0.02
"""Std of what a lag is beyond that, and of one of a reference that is read with the drives [s].
Source: judgement.
"""

LARGEST = 0.2
"""Largest lag that is looked for [s]. Source: definition (six of these stds beyond)."""

LATE = 0.1
"""Probability that joints follow late, and that a reference which is read with the drives is late,
before logs are seen [1]. Source: judgement.
"""

STEP = 0.02
"""Step of the first search [s], which goes on beside the best. Source: judgement."""


def reference_lag(logs: Sequence[Log], rig: Rig, folds: Sequence[int]) -> float:
    """Return the lag of the true angles of some logs [s], each of which is in a fold; 0 where late
    joints explain them better.
    """
    if len(set(folds)) < FEWEST_LOGS:
        return 0.0
    samples = [samples_of_angles(log, rig) for log in logs]
    targets = np.vstack([log.targets for log in samples])
    joints = [j for j, column in enumerate(targets.T) if np.isfinite(column).any()]
    channels = channels_of(rig, "regression")
    of = {"channels": channels.proximal, "positions": channels.positions}
    names = {key: tuple(sensor.name for sensor in sensors) for key, sensors in of.items()}
    seen = Seen.of(samples, names)
    tasks = [seen.task(samples, joint, folds)[0] for joint in joints]
    times = [log.time for log in samples]
    # samples whose errors are one correlation time apart count as independent
    each = float(np.mean([np.ptp(time) for time in times]) / np.exp(Prior().error_time))

    def late(how: Lateness, age: float) -> list[Task]:
        """Return the tasks with features that are late by an age [s]."""
        features = [how(along, time, age) for along, time in zip(seen.along, times)]
        return [
            replace(
                task,
                logs=tuple(
                    _at_samples(evidence, *of_log)
                    for evidence, of_log in zip(task.logs, zip(features, times))
                ),
            )
            for task in tasks
        ]

    as_reference, lag = _likeliest(partial(late, _delayed), each)
    as_joint, _ = _likeliest(partial(late, _followed), each)
    if any(_is_slower(log) for log in samples):  # a camera, which is never on time
        prior = _log_density(max(lag - LARGEST_USUAL, 0.0)) - np.log(LARGEST_USUAL)
        on_time = np.inf
    else:
        prior = np.log(LATE) + _log_density(lag) + np.log(2.0 / (UNUSUAL_STD * np.sqrt(2 * np.pi)))
        on_time = sum(task.search(each, lags=False)[1] for task in tasks) + np.log(LATE)
    # a joint behind a pure delay looks as a late reference does
    late_joint = min(as_joint, as_reference) - np.log(LATE / LARGEST)
    return lag if as_reference < min(late_joint + prior, on_time + _log_density(lag)) else 0.0


def _log_density(beyond: float) -> float:
    """Return ln of the normal density of a lag beyond the usual ones [s], but for a constant."""
    return -0.5 * (beyond / UNUSUAL_STD) ** 2


Features: TypeAlias = Mapping[str, Floats]
Lateness: TypeAlias = Callable[[Features, Floats, float], Features]
"""Function from features along a log, their stamps [s] and an age [s] to features that are late."""


def _likeliest(tasks_at: Callable[[float], list[Task]], each: float) -> tuple[float, float]:
    """Return −ln of the largest posterior density, but for a constant, and the age where it is [s].

    Args:
        tasks_at: function that returns the tasks at an age.
        each: number of independent samples for which a log counts.
    """
    from scipy.optimize import minimize_scalar  # loaded late: it takes as long as all of distal

    ages = np.arange(0.0, LARGEST + STEP / 2, STEP)
    options = {"xatol": 2e-4}

    def cost(age: float, tried: Sequence[Sequence[Prior]]) -> float:
        """Return the least cost of an age with one of the hyperparameters of each task."""
        return -sum(
            max(float(np.sum(task.densities(prior))) for prior in priors)
            for task, priors in zip(tasks_at(age), tried)
        )

    usual = [replace(Prior(), noise=Prior().noise + more) for more in NOISES]
    tried: Sequence[Sequence[Prior]] = [usual for _ in tasks_at(0.0)]
    least = np.inf
    for _ in range(ROUNDS):
        best = int(np.argmin([cost(each_age, tried) for each_age in ages]))
        bounds = (ages[max(best - 1, 0)], ages[min(best + 1, len(ages) - 1)])
        search = minimize_scalar(
            cost, args=(tried,), bounds=bounds, method="bounded", options=options
        )
        age = float(search.x)
        found = [task.search(each, lags=False) for task in tasks_at(age)]
        tried = [[prior] for prior, _ in found]
        least = sum(of_task for _, of_task in found)
    return least, age


NOISES = (-1.0, 1.0, 3.0)
"""Steps of the noise from the usual one with which ages are first compared [1]. Source: judgement.
"""

ROUNDS = 2
"""Number of times that age and hyperparameters are found in turn [1]. Source: benchmark (python -m
benchmarks.late).
"""


def _is_slower(samples: Samples) -> bool:
    """Return whether a reference has fewer samples than a log has rows, as a camera's; one that is
    read with the drives is hardly late.
    """
    known = np.isfinite(samples.targets).any(axis=1)
    return bool(np.mean(known) < SLOWER)


SLOWER = 0.8
"""Share of rows with a sample of the reference below which it is slower than the drives [1].
Source: judgement (a camera of 60 Hz beside drives of 100 Hz: 0.6).
"""


def _delayed(along: Features, time: Floats, age: float) -> Features:
    """Return features as they were an `age` before [s]."""
    at = np.interp(time - age, time, np.arange(len(time)))
    before = np.minimum(at.astype(int), len(time) - 2)
    share = (at - before)[:, None]
    return {n: (1 - share) * along[n][before] + share * along[n][before + 1] for n in OF_EVIDENCE}


def _followed(along: Features, time: Floats, age: float) -> Features:
    """Return features behind a lag of first order with the time constant `age` [s]."""
    from scipy.signal import lfilter

    pole = np.exp(-np.median(np.diff(time)) / max(age, SHORTEST))
    state = {name: pole * along[name][:1] for name in OF_EVIDENCE}
    return {n: lfilter([1 - pole], [1, -pole], along[n], 0, state[n])[0] for n in OF_EVIDENCE}


SHORTEST = 1e-6
"""Shortest time constant of a lag [s]. Source: rounding (a division by zero)."""

OF_EVIDENCE = ("features", "doubt", "far")
"""Names of the features that are evidence."""


def _at_samples(evidence: Evidence, along: Features, time: Floats) -> Evidence:
    rows = np.searchsorted(time, evidence.time)
    phi, doubt, far = (along[name][rows] for name in OF_EVIDENCE)
    return replace(evidence, phi=phi, doubt=doubt, far=far[:, 0])


def said_of_lag(lag: float) -> list[str]:
    """Return what a user should know of a lag of the reference [s]; nothing of none."""
    if lag == 0.0:
        return []
    return [
        f"the reference is taken as {1e3 * lag:.0f} ms later than the drives, here and by `distal "
        "estimate` (`delay` in the file); a joint that follows its drives late looks almost the "
        "same (--reference-lag 0 takes it as that)"
    ]


def delays(logs: Sequence[Log], rig: Rig, lag: float) -> dict[str, object]:
    """Return path by names → delay of the reference sensors [s], which are later by a lag than the
    rig says; nothing where the true angles come from elsewhere.
    """
    if lag == 0.0 or not any(log.truth_kind is TruthKind.SENSOR for log in logs):
        return {}
    return {f"sensors.{s.name}.delay": round(s.delay + lag, 6) for s in rig.sensors_of("angle")}


def without_lag(logs: Sequence[Log], rig: Rig, lag: float) -> list[Log]:
    """Return the logs with their true angles moved back in time by a lag [s]."""
    if lag == 0.0:
        return list(logs)
    names = angle_names(rig.joint_names)
    return [
        replace(
            log,
            truth={
                name: earlier(log.time, values, lag) if name in names else values
                for name, values in log.truth.items()
            },
        )
        for log in logs
    ]
