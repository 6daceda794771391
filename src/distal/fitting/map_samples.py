"""The samples that each kind of map is learned from: readings, targets and the filter's angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from distal.errors import DistalError
from distal.estimators import (
    LARGEST_ANGLE,
    AdaptiveFilter,
    first_values,
)
from distal.homing import (
    check_homing,
    plain_samples,
)
from distal.kernels import Compiled
from distal.logs import Log, TruthKind, shown, true_angles
from distal.regression import Samples
from distal.rig import Rig
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
    samples = samples_of(log, estimator.channels, estimator.name, estimator.bridged)
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
