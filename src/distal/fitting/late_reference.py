"""How late a reference is: the age L of its samples; or whether joints follow their drives late.

Two candidates explain a lag between drives and reference. The reference is late: what it reads at t
follows from φ(y) at t − L. Or the joint is: it follows from φ(y) at t, whose lags say how
(`TIME_CONSTANTS`). Each is the map on readings alone with hyperparameters of its own, and the
likelier one on logs left out is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from distal.arrays import Floats
from distal.estimators import channels_of, samples_of_angles
from distal.fitting.map_search import Seen, Task, clearly_gains
from distal.logs import Log, TruthKind, earlier
from distal.regression import FEWEST_LOGS, Evidence, Prior
from distal.rig import Rig, angle_names

LARGEST_USUAL = 0.08
"""Lags of a reference up to this are equally likely [s]: an encoder's, and those of cameras with
their drivers. Source: judgement.
"""

UNUSUAL_STD = 0.02
"""Std of what a lag is beyond that [s]. Source: judgement."""

LARGEST = 0.2
"""Largest lag that is looked for [s]. Source: definition (six of these stds beyond)."""

STEP = 0.02
"""Step of the first search [s], which goes on beside the best. Source: judgement."""


def reference_lag(logs: Sequence[Log], rig: Rig, folds: Sequence[int]) -> float:
    """Return the lag of the true angles of some logs [s], each of which is in a fold; 0 where none
    makes them clearly more probable on logs held out, or where late joints explain them better.
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
    along = [seen.along[i] for i in range(len(logs))]
    times = [log.time for log in samples]

    def at(lag: float) -> list[Task]:
        """Return the tasks if the reference is so late."""
        return [
            replace(
                task,
                logs=tuple(
                    _as_of(evidence, each, time, lag)
                    for evidence, each, time in zip(task.logs, along, times)
                ),
            )
            for task in tasks
        ]

    def densities(lag: float) -> Floats:
        return np.asarray(sum(_at_best_noise(task) for task in at(lag)))

    def cost(lag: float) -> float:
        return _surprise(lag) - float(np.sum(densities(lag)))

    grid = np.arange(0.0, LARGEST + STEP / 2, STEP)
    best = int(np.argmin([cost(lag) for lag in grid]))
    from scipy.optimize import minimize_scalar  # loaded late: it takes as long as all of distal

    bounds = (grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)])
    lag = float(minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-3}).x)
    if not clearly_gains(densities(lag) - densities(0.0)):
        return 0.0
    late_joint = sum(task.search()[1] for task in tasks)
    late_reference = sum(task.search()[1] for task in at(lag)) + _surprise(lag)
    return lag if late_reference < late_joint else 0.0


def _surprise(lag: float) -> float:
    """Return −ln of the prior density of a lag, but for a constant [1]."""
    return 0.5 * (max(lag - LARGEST_USUAL, 0.0) / UNUSUAL_STD) ** 2


def _as_of(evidence: Evidence, along: dict[str, Floats], time: Floats, lag: float) -> Evidence:
    """Return what a map saw a `lag` before each of its samples [s]; `along` are the features at all
    stamps of the log, `time` [s].
    """
    at = np.interp(evidence.time - lag, time, np.arange(len(time)))
    before = np.minimum(at.astype(int), len(time) - 2)
    share = (at - before)[:, None]

    def between(values: Floats) -> Floats:
        return np.asarray((1 - share) * values[before] + share * values[before + 1])

    return replace(
        evidence,
        phi=between(along["features"]),
        doubt=between(along["doubt"]),
        far=between(along["far"])[:, 0],
    )


def _at_best_noise(task: Task) -> Floats:
    """Return the densities of the logs at the best of a few sizes of the noise."""
    search = [task.densities(replace(Prior(), noise=Prior().noise + more)) for more in (-1, 1, 3)]
    return max(search, key=lambda densities_there: float(np.mean(densities_there)))


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
