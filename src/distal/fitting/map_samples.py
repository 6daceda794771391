"""What logs say to each kind of map: readings, targets and the filter's own angles; and which terms
there may be.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from distal.arrays import Bools
from distal.errors import DistalError, EstimationError
from distal.estimators import AdaptiveFilter, channels_of, first_values
from distal.fitting.samples_in_stops import in_stops
from distal.homing import (
    Window,
    check_homing,
    parameters_homed,
    plain_samples,
    torque_samples,
    with_references,
)
from distal.logs import Log, TruthKind, shown, true_angles, true_torques
from distal.regression import Kind, Samples, contact_kind, discrepancy_kind
from distal.rig import LearnedMap, Rig, Sensor
from distal.run import samples_of
from distal.sensor_errors import variance

OFFSETS = 2.0
"""What angles lack in the mean may be the encoder's offset up to so many of its standard
deviations.
"""

MOST_PARTLY = 12
FEWEST_PARTLY = 20
"""So many logs at most say what a homing move that covers half of the range costs, each with so
many samples in it.
"""

SETTLING = 0.5
"""Without homing a filter finds the joint within so long [s]; errors count after that."""


def discrepancy_of(rig: Rig, data: Sequence[Samples]) -> Kind:
    """Return how what the filter's angles lack is learned from logs; a sensor that never changes in
    them is no variable.
    """
    sensors = _sensors(rig)
    readings = np.vstack([samples.readings for samples in data])
    moving = [sensor for sensor, column in zip(sensors, readings.T) if np.ptp(column) > 0.0]
    efforts = [sensor.name for sensor in moving if sensor.measures in ("force", "tension")]
    names = [sensor.name for sensor in sensors]
    joints = rig.joint_names
    noise = np.sqrt([variance(sensor) for sensor in sensors])
    return discrepancy_kind(names, [sensor.name for sensor in moving], efforts, joints, noise)


LEAST_FREE = 0.1
"""A joint that is off its stops for less than this share of a log is judged in them too."""


def filtered(
    logs: Sequence[Log],
    rigs: Sequence[Rig],
    homing: float | None,
    compiled: bool,
    usable: Sequence[Bools] | None = None,
) -> tuple[dict[int, Samples], list[str]]:
    """Return what the filter makes of logs with truth, by the index of the log, and why of some it
    makes nothing.

    Each log has a rig without a discrepancy; the first says what the encoders' offsets may be. A
    homing move lasts `homing` s, None for none, and may use the samples that are `usable`, (k,) for
    each log, None for all.
    """
    data = dict[int, Samples]()
    refused = list[str]()
    estimators = dict[tuple[int, frozenset[str]], AdaptiveFilter]()
    for i, (log, rig) in enumerate(zip(logs, rigs)):
        try:
            key = id(rig), frozenset(log.truth)  # what has a truth says which references there are
            if key not in estimators:
                described, references = (
                    with_references(rig, log) if homing is not None else (rig, ())
                )
                estimators[key] = AdaptiveFilter(described, compiled, references=references)
            samples = _filtered(log, estimators[key], homing, None if usable is None else usable[i])
        except DistalError as problem:
            refused.append(f"discrepancy: {shown(log.source)} is left out: {problem}")
            continue
        if not np.isfinite(samples.angles).all():
            refused.append(
                f"discrepancy: {shown(log.source)} is left out: adaptive left all bounds on it"
            )
            continue
        data[i] = replace(
            samples, reference_std=0.0 if homing is not None else reference_std(rig, log)
        )
    sensor = homing is None and any(log.truth_kind is TruthKind.SENSOR for log in logs)
    if sensor and data:
        data = dict(zip(data, without_offset(list(data.values()), rigs[0])))
    return data, refused


def partly_homed(
    logs: Sequence[Log], rigs: Sequence[Rig], homing: float | None, compiled: bool
) -> dict[int, Samples]:
    """Return what the filter makes of some logs after a homing move that covers half of their
    range, by their index.

    The half is that of the first angle. Used are `MOST_PARTLY` logs, spread over all, where the
    window of `homing` s has such samples; None gives nothing.
    """
    if homing is None:
        return {}
    chosen = np.unique(
        np.linspace(0, len(logs) - 1, min(len(logs), MOST_PARTLY)).round().astype(int)
    )
    masks = dict[int, Bools]()
    for i in map(int, chosen):
        truths = true_angles(logs[i], [joint.name for joint in rigs[i].joints])
        assert truths is not None
        usable = np.asarray(np.isfinite(truths).any(axis=1))
        for angles in truths.T:
            is_known = np.isfinite(angles)
            if is_known.any():
                middle = 0.5 * (angles[is_known].min() + angles[is_known].max())
                usable = usable & (
                    ~is_known | ((angles - middle) * (angles[is_known][0] - middle) >= 0.0)
                )
        if np.count_nonzero(usable & (logs[i].time - logs[i].time[0] < homing)) >= FEWEST_PARTLY:
            masks[i] = usable
    used = list(masks)
    used_logs = [logs[i] for i in used]
    used_rigs = [rigs[i] for i in used]
    data, _ = filtered(used_logs, used_rigs, homing, compiled, list(masks.values()))
    return {used[k]: replace(samples, usable=masks[used[k]]) for k, samples in data.items()}


def without_offset(data: Sequence[Samples], rig: Rig) -> list[Samples]:
    """Return samples without what all logs' angles lack in the mean, where the encoder's own offset
    may be as large.

    Model and encoder are both off by something, and no log tells which; a correction to an encoder
    that is mounted askew would be worse than none. That the offset is not known is in the band, see
    `with_reference_error`.
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


def with_reference_error(learned: LearnedMap, rig: Rig, logs: Sequence[Log]) -> LearnedMap:
    """Return a map of the angle with the std of the reference's offset in its band: c² s² becomes
    c² s² + σ_b².

    An encoder that is mounted 0.2° off is so in all logs, so that no log left out shows it. The
    rig's angle sensors say how unsure their offsets are.
    """
    if not any(log.truth_kind is TruthKind.SENSOR for log in logs):
        return learned
    offsets = {sensor.of: sensor.bias.filter_std for sensor in reversed(rig.sensors_of("angle"))}
    joints = tuple(
        joint.model_copy(
            update={"std": float(np.hypot(joint.std, offsets.get(joint.joint, 0.0) / band))}
        )
        for joint, band in zip(learned.joints, learned.band)
    )
    return learned.model_copy(update={"joints": joints})


def _filtered(
    log: Log, estimator: AdaptiveFilter, homing: float | None, usable: Bools | None
) -> Samples:
    joints = estimator.rig.joint_names
    truths = true_angles(log, joints)
    assert truths is not None
    m = len(estimator.positions)
    proximal = samples_of(log, estimator.channels[:m], estimator.name)
    reference = np.full((len(log), len(estimator.channels) - m), np.nan)
    unaided = np.column_stack([proximal, reference])
    start = estimator.initial(log.time[0], np.append(first_values(proximal), reference[0]))
    early = log.time - log.time[0] < (SETTLING if homing is None else homing)
    if homing is not None:
        check_homing(homing, log, joints)
        usable_truths = truths if usable is None else np.where(usable[:, None], truths, np.nan)
        of = {sensor.name: sensor.of for sensor in estimator.rig.sensors_of("angle")}
        columns = [joints.index(of[name]) for name in estimator.channels[m:]]
        aided = np.column_stack(
            [proximal, np.where(early[:, None], usable_truths[:, columns], np.nan)]
        )
        start = parameters_homed(Window.of(estimator, start, log, aided, usable_truths, homing))
    elif log.time[-1] - log.time[0] > 4 * SETTLING:
        # where the joint begins is not known yet: that is no error of the model
        truths = np.where(early[:, None], np.nan, truths)
    if homing is None:
        stopped = in_stops(log.time, truths, estimator.rig)
        # one that hardly leaves its stops would be left without a truth
        moves = (np.isfinite(truths) & ~stopped).mean(axis=0) >= LEAST_FREE
        truths = np.where(stopped & moves, np.nan, truths)
    return plain_samples(estimator, start, log, unaided, truths)


def mean_rms(data: Mapping[int, Samples]) -> float:
    """Return the mean over logs of the RMS of what the filter's angle errs by [rad]."""
    log_errors = [samples.targets[np.isfinite(samples.targets)] for samples in data.values()]
    return float(np.mean([np.sqrt(np.mean(errors**2)) for errors in log_errors if len(errors)]))


def reference_std(rig: Rig, log: Log) -> float:
    """Return the random error of the angle sensor that a log's truth comes from [rad]; 0 where it
    comes from elsewhere.

    Its offset is not counted: it is the same everywhere, and what changes along a log is worth a
    correction beside it.
    """
    if log.truth_kind is not TruthKind.SENSOR:
        return 0.0
    return max(
        (float(np.sqrt(variance(sensor))) for sensor in rig.sensors_of("angle")), default=0.0
    )


def reference_offset(rig: Rig, log: Log) -> float:
    """Return the std of the zero of the angle sensor that a log's truth comes from [rad], the
    largest of all; 0 where it comes from elsewhere.
    """
    if log.truth_kind is not TruthKind.SENSOR:
        return 0.0
    return max((sensor.bias.filter_std for sensor in rig.sensors_of("angle")), default=0.0)


def _sensors(rig: Rig) -> tuple[Sensor, ...]:
    channels = channels_of(rig, "adaptive")
    return (*channels.positions, *channels.tensions, *channels.forces)


def has_torque(log: Log, rig: Rig) -> bool:
    """Return whether a log has the torque on a joint from outside."""
    torques = true_torques(log, rig.joint_names)
    return torques is not None and bool(np.isfinite(torques).any())


def torques_of(log: Log, rig: Rig) -> Samples:
    """Return a log with the torque on its joints as the map of the torque sees it.

    Raises:
        EstimationError: the log lacks a sensor.
    """
    torques = true_torques(log, rig.joint_names)
    assert torques is not None
    names = [sensor.name for sensor in _sensors(rig)]
    for name in names:
        if name not in log.channels:
            raise EstimationError(f"{log.source}: the sensor '{name}' is not in the log")
    return torque_samples(log, rig, {name: log.channels[name] for name in names}, torques)


def contact_of(rig: Rig) -> Kind:
    """Return how the torque from outside is learned from what the sensors of a rig read."""
    sensors = _sensors(rig)
    positions = [sensor.name for sensor in sensors if sensor.measures == "position"]
    noise = np.sqrt([variance(sensor) for sensor in sensors])
    return contact_kind([s.name for s in sensors], positions, rig.joint_names, noise)
