"""The samples that each kind of map is learned from: readings, targets and the filter's angles; and
how much later a reference is than the drives, by the density of the map on readings alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from distal.arrays import Floats
from distal.errors import DistalError
from distal.estimators import (
    LARGEST_ANGLE,
    AdaptiveFilter,
    channels_of,
    first_values,
    samples_of_angles,
)
from distal.fitting.map_search import Seen, Task, clearly_gains
from distal.homing import (
    check_homing,
    plain_samples,
)
from distal.kernels import Compiled
from distal.logs import Log, TruthKind, shown, true_angles
from distal.regression import FEWEST_LOGS, Prior, Samples
from distal.rig import Rig, angle_names
from distal.run import samples_of
from distal.sensor_errors import variance

OFFSETS = 2.0
"""Largest mean error of the angles that may be the encoder's offset, in standard deviations of that
offset. Source: judgement.
"""

SETTLING = 0.5
"""Time in which a filter without homing finds the joint [s]; errors count after it. Source:
judgement.
"""


def counted_from(log: Log, homing: float | None) -> float:
    """Return the time from which on errors on a log count [s]: the end of its homing move, or of
    the time in which the filter finds the joint, unless the log is short.
    """
    if homing is not None:
        return homing
    return SETTLING if log.time[-1] - log.time[0] > 4 * SETTLING else 0.0


def filtered(
    logs: Sequence[Log],
    rigs: Sequence[Rig],
    homing: float | None,
    compiled: Compiled,
) -> tuple[dict[int, Samples], list[str]]:
    """Return the samples of the filter along logs of known angle, by the index of the log, and
    sentences on the logs that it cannot follow.

    Args:
        logs: the logs, all of known angle.
        rigs: the rig of each log, without maps; the first gives the stds of the encoders'
            offsets.
        homing: length of the homing move [s], None for none.
        compiled: how the filter is compiled, see `Compiled`.
    """
    data = dict[int, Samples]()
    refused = list[str]()
    estimators = dict[int, AdaptiveFilter]()
    for i, (log, rig) in enumerate(zip(logs, rigs)):
        try:
            if id(rig) not in estimators:
                estimators[id(rig)] = AdaptiveFilter(rig, compiled)
            samples = _filtered(log, estimators[id(rig)], homing)
        except DistalError as problem:
            refused.append(f"{shown(log.source)} is left out: {problem}")
            continue
        if not np.all(np.abs(samples.angles) < LARGEST_ANGLE):  # NaN is not below it either
            refused.append(f"{shown(log.source)} is left out: adaptive left all bounds on it")
            continue
        data[i] = samples
    sensor = homing is None and any(log.truth_kind is TruthKind.SENSOR for log in logs)
    if sensor and data:
        data = dict(zip(data, without_offset(list(data.values()), rigs[0])))
    return data, refused


def without_offset(data: Sequence[Samples], rig: Rig) -> list[Samples]:
    """Return samples whose targets lack the mean error over all logs, where that may be the
    encoder's own offset.

    Both the model and the encoder may have a constant error, and no log tells which; to correct the
    angle by the encoder's would be worse than no correction. The band contains the offset, see
    `learned_maps.with_its_reference_error`.
    """
    doubts = {sensor.of: sensor.bias.filter_std for sensor in reversed(rig.sensors_of("angle"))}
    limits = OFFSETS * np.array([doubts.get(joint.name, 0.0) for joint in rig.joints])
    targets = [samples.targets for samples in data if np.isfinite(samples.targets).any()]
    if not targets:
        return list(data)
    means = [
        np.array([np.mean(c[np.isfinite(c)]) if np.isfinite(c).any() else 0.0 for c in t.T])
        for t in targets
    ]
    common = np.mean(means, axis=0)
    common = np.where(np.abs(common) <= limits, common, 0.0)
    return [replace(samples, targets=samples.targets - common) for samples in data]


def reference_variances(rig: Rig, logs: Sequence[Log]) -> dict[str, float]:
    """Return joint → variance of the zero of the angle sensor that gives the reference [rad²]; none
    for a reference from elsewhere.
    """
    if not any(log.truth_kind is TruthKind.SENSOR for log in logs):
        return {}
    return {sensor.of: sensor.bias.total_std**2 for sensor in reversed(rig.sensors_of("angle"))}


def _filtered(log: Log, estimator: AdaptiveFilter, homing: float | None) -> Samples:
    joints = estimator.rig.joint_names
    truths = true_angles(log, joints)
    assert truths is not None
    samples = samples_of(log, estimator.channels, estimator.name)
    start = estimator.initial(log.time[0], first_values(samples))
    if homing is not None:
        check_homing(homing, log, joints)
    else:
        # the filter does not know yet where the joint begins: that is no error of the model
        early = log.time - log.time[0] < counted_from(log, None)
        truths = np.where(early[:, None], np.nan, truths)
    return plain_samples(estimator, start, log, samples, truths)


def mean_rms(data: Mapping[int, Samples], homing: float | None) -> float:
    """Return the mean over logs of the RMS error of the filter's angles after homing [rad]."""
    late = [samples.targets[samples.time >= (homing or 0.0)] for samples in data.values()]
    log_errors = [targets[np.isfinite(targets)] for targets in late]
    return float(np.mean([np.sqrt(np.mean(errors**2)) for errors in log_errors if len(errors)]))


def reference_std(rig: Rig, log: Log) -> float:
    """Return the std of the random error of the angle sensor that gives a log's reference [rad],
    the largest of several; 0 for a reference from elsewhere.

    The sensor's offset is not counted, since it is the same along a log.
    """
    if log.truth_kind is not TruthKind.SENSOR:
        return 0.0
    return max(
        (float(np.sqrt(variance(sensor))) for sensor in rig.sensors_of("angle")), default=0.0
    )


def reference_offset(rig: Rig, log: Log) -> float:
    """Return the std of the zero of the angle sensor that gives a log's reference [rad], the
    largest of several; 0 for a reference from elsewhere.
    """
    if log.truth_kind is not TruthKind.SENSOR:
        return 0.0
    return max((sensor.bias.total_std for sensor in rig.sensors_of("angle")), default=0.0)


EARLIEST, LATEST = -0.1, 0.2
"""Range of the lags that are looked for [s]. Source: judgement (cameras)."""

STEP = 0.02
"""Step of the first search [s], which goes on beside the best. Source: judgement."""

BRIDGED = 2.5
"""Gap of a reference that is interpolated, in its usual intervals [1]. Source: judgement."""


def said_of_lag(lag: float) -> list[str]:
    """Return what a user should know of a lag of the reference [s]; nothing of none."""
    if lag == 0.0:
        return []
    which = "later" if lag > 0.0 else "earlier"
    return [
        f"the reference is taken as {1e3 * abs(lag):.0f} ms {which} than the drives, and "
        "moved by that; a joint that follows its drives late looks the same (--reference-lag 0 "
        "leaves it as it is)"
    ]


def without_lag(logs: Sequence[Log], rig: Rig, lag: float) -> list[Log]:
    """Return the logs with their true angles moved back in time by a lag [s]."""
    if lag == 0.0:
        return list(logs)
    names = angle_names(rig.joint_names)
    return [
        replace(
            log,
            truth={
                name: _moved(log.time, values, lag) if name in names else values
                for name, values in log.truth.items()
            },
        )
        for log in logs
    ]


def reference_lag(logs: Sequence[Log], rig: Rig, folds: Sequence[int]) -> float:
    """Return the lag of the true angles of some logs [s], each of which is in a fold; 0 where none
    makes them clearly more probable on logs held out.

    The joints' angles at t + lag are mapped from what is read up to t, and the lag is that with the
    largest density of held-out logs. A joint that follows its drives late looks the same, so that
    the lag is an assumption.
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

    def densities(lag: float) -> Floats:
        moved = [_late(log, lag) for log in samples]
        tasks = (seen.task(moved, joint, folds)[0] for joint in joints)
        return np.asarray(sum(_best(task) for task in tasks))

    grid = np.arange(EARLIEST, LATEST + STEP / 2, STEP)
    means = [float(np.mean(densities(lag))) for lag in grid]
    best = int(np.argmax(means))
    from scipy.optimize import minimize_scalar  # loaded late: it takes as long as all of distal

    bounds = (grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)])
    search = minimize_scalar(
        lambda lag: -float(np.mean(densities(lag))),
        bounds=bounds,
        method="bounded",
        options={"xatol": 1e-3},
    )
    lag = float(search.x)
    clear = abs(lag) >= STEP and clearly_gains(densities(lag) - densities(0.0))
    return lag if clear else 0.0


def _best(task: Task) -> Floats:
    """Return the densities of the logs at the best of a few sizes of the noise."""
    search = [task.densities(replace(Prior(), noise=Prior().noise + more)) for more in (-1, 1, 3)]
    return max(search, key=lambda densities_there: float(np.mean(densities_there)))


def _late(samples: Samples, lag: float) -> Samples:
    targets = [_moved(samples.time, column, lag) for column in samples.targets.T]
    return replace(samples, targets=np.column_stack(targets))


def _moved(time: Floats, values: Floats, lag: float) -> Floats:
    """Return values at the times that are later by a lag, NaN in gaps and beyond their ends."""
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite) < 2:
        return values
    stamps = time[finite]
    at = time + lag
    moved = np.interp(at, stamps, values[finite])
    after = np.clip(np.searchsorted(stamps, at), 1, len(finite) - 1)
    gap = stamps[after] - stamps[after - 1] > BRIDGED * np.median(np.diff(stamps))
    outside = (at < stamps[0]) | (at > stamps[-1])
    # only as often as the reference has values: between them nothing new is known
    seen = np.zeros(len(time), dtype=bool)
    seen[finite] = True
    return np.where(gap | outside | ~seen, np.nan, moved)
