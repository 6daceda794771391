"""Homing: while a joint's angle is known, the filter reads it, and its maps are conditioned on what
it lacks. The reference is a sensor that is read for that time, or a column of true angles.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distal.arrays import Bools, Floats
from distal.errors import EstimationError
from distal.estimators import (
    LARGEST_ANGLE,
    AdaptiveFilter,
    Belief,
    KernelEstimator,
    channels_of,
    of_part,
    offsets_of,
    parts_of,
)
from distal.estimators.estimator_protocol import sensor_for
from distal.kernels import covariance_of, mean_of, variances_of
from distal.logs import Log, TruthKind, TruthSource, frozen, true_angles
from distal.machine_limits import one_blas_thread
from distal.regression import Samples, from_prior, from_window, given
from distal.rig import LearnedMap, Parameter, Rig, Sensor, angle_names

TRUTH_NOISE = np.deg2rad(0.1)
"""Standard deviation of a true angle that is no sensor of the rig [rad]. Source: judgement."""


def with_references(rig: Rig, log: Log) -> tuple[Rig, tuple[Sensor, ...]]:
    """Return a rig in which each joint whose angle the log knows has a sensor of it, and these
    sensors.

    If the log's true angles come from the rig's own sensors, they are these; else sensors called
    ``reference`` are added, with `TRUTH_NOISE`.

    Raises:
        EstimationError: the log has no true angle.
    """
    joints = rig.joint_names
    known_joints = [joint for joint, name in zip(joints, angle_names(joints)) if name in log.truth]
    if not known_joints:
        raise EstimationError(
            f"{log.source}: homing needs the joint's angle for a while; give --truth, or log the "
            "column of the rig's angle sensor"
        )
    names = []
    for joint in known_joints:
        sensor = sensor_for(rig.sensors_of("angle"), joint)
        if sensor is None or not log.truth_kind.by_sensor:
            rig, sensor = added_reference(rig, log.rate, joint)
        elif sensor.noise == 0.0 and sensor.resolution == 0.0:
            rig = rig.with_values({f"sensors.{sensor.name}.noise": TRUTH_NOISE})
        names.append(sensor.name)
    return rig, tuple(rig.sensors[rig.sensor_names.index(name)] for name in names)


def added_reference(rig: Rig, rate: float, joint: str | None = None) -> tuple[Rig, Sensor]:
    """Return the rig with one more sensor of a joint's angle, default the first joint's, that is
    read at some `rate` [Hz]; and that sensor.
    """
    joint = joint or rig.joints[0].name
    sensor = sensor_for(rig.sensors_of("angle"), joint)
    # how far the model's angle and the joint's may be apart
    bias = Parameter(value=0.0) if sensor is None else sensor.bias
    return _with_sensor(rig, "reference", joint, rate, bias, len(rig.sensors))


def _with_sensor(
    rig: Rig, stem: str, joint: str, rate: float, bias: Parameter, at: int
) -> tuple[Rig, Sensor]:
    """Return the rig with one more sensor of a joint's angle, its sensor number `at`, with a name
    that no other one has; and that sensor. A rate of NaN is taken as 100 Hz.
    """
    stem = stem if len(rig.joints) == 1 else f"{stem}_{joint}"
    names = (stem, f"{stem}_angle", f"{stem}_angle_2")
    added = {
        "name": next(name for name in names if name not in rig.sensor_names),
        "measures": "angle",
        "of": joint,
        "noise": TRUTH_NOISE,
        "rate": float(np.clip(np.nan_to_num(rate, nan=100.0), 1e-3, 1e6)),
        "bias": bias.model_dump(),
    }
    sensors = rig.model_dump()["sensors"]
    described = rig.with_values({"sensors": [*sensors[:at], added, *sensors[at:]]})
    return described, described.sensors[at]


def at_known_angle(
    log: Log, rig: Rig, homing: float, angle: float, std: float = 0.0, joint: str | None = None
) -> tuple[Log, Rig]:
    """Return a log and a rig for homing where a joint stands at a known angle: at a mark, or
    against a hard stop.

    The rig gets a sensor ``home`` of the joint's angle (``home_JOINT`` where there are several
    joints). In the log the joint's true angle is `angle` for the first `homing` s; later it is what
    it was, NaN where it was not known. For several joints call it once for each that stands at a
    known angle; true angles of the others are not used during homing.

    Args:
        log: the run.
        rig: its description.
        homing: for how long the joint stands there [s].
        angle: the known angle [rad].
        std: standard deviation of the sensor's constant offset [rad].
        joint: its name; may be left out where there is only one.

    Raises:
        EstimationError: it is not clear which joint is meant, or a number is out of bounds.
    """
    joints = rig.joint_names
    which = joints[0] if joint is None and len(joints) == 1 else joint
    if which is None or which not in joints:
        came = "none was named" if which is None else f"{which!r} came"
        raise EstimationError(
            f"a homing angle is of one joint; name one of {', '.join(joints)} ('pip: 0 deg'); "
            f"{came}"
        )
    if not abs(angle) <= LARGEST_ANGLE or not 0.0 <= std <= LARGEST_ANGLE:
        raise EstimationError(
            f"a homing angle is at most {LARGEST_ANGLE:g} rad, {angle:g} ± {std:g} rad came"
        )
    bias = Parameter(value=0.0, std=std)
    described, _ = _with_sensor(rig, "home", which, log.rate, bias, 0)
    columns = angle_names(joints)
    early = log.time - log.time[0] < homing
    homed_before = log.truth_kind is TruthKind.HOME
    truth = dict(log.truth)
    if not homed_before:
        # during homing, true angles of all other joints are not used
        truth |= {name: np.where(early, np.nan, truth[name]) for name in columns if name in truth}
    column = columns[joints.index(which)]
    truth[column] = np.where(early, angle, truth.get(column, np.nan))
    at = f"{np.rad2deg(angle):g}° ± {np.rad2deg(std):g}° at home"
    at = at if len(joints) == 1 else f"{which} {at}"
    position = f"{log.truth_source.position}, {at}" if homed_before else at
    return replace(log, truth=truth, truth_source=TruthSource(TruthKind.HOME, position)), described


def homing_filter(rig: Rig, std: float = 0.0, compiled: bool = True) -> AdaptiveFilter:
    """Return an `adaptive` that can home at any time: its samples also say where joints are known
    to stand.

    After its other channels it has one more for each joint, ``home`` or ``home_JOINT``. Its value
    is the angle [rad] while the joint is known to stand there, at a mark or against a stop, and NaN
    at all other times. Between that angle and the joint's own there is a constant offset of
    standard deviation `std` [rad]. Where the rig has learned maps beside the filter, that angle
    conditions them and does not move the filter.

    Raises:
        EstimationError: the std is out of bounds, or the filter cannot run on it.
    """
    if not isinstance(std, (int, float, np.floating)) or not 0.0 <= std <= LARGEST_ANGLE:
        raise EstimationError(
            f"a homing angle is known to 0 to {LARGEST_ANGLE:g} rad, {std!r} came"
        )
    rate = max((sensor.rate for sensor in rig.sensors), default=np.nan)
    is_mapped = rig.map is not None and bool(rig.map.filter)
    bias = Parameter(value=0.0, std=0.0 if is_mapped else float(std))
    for joint in reversed(rig.joints):
        rig, _ = _with_sensor(rig, "home", joint.name, rate, bias, 0)
    homes = rig.sensors[: len(rig.joints)]
    return AdaptiveFilter(rig, compiled, references=homes, home_std=std if is_mapped else None)


def check_homing(homing: float, log: Log, joints: Sequence[str]) -> Floats:
    """Return the true angles of a log, (k, n_joints) [rad], of which the first `homing` s are the
    reference.

    Raises:
        EstimationError: there is no reference in these seconds, or they leave no time to estimate.
    """
    span = float(log.time[-1] - log.time[0])
    if not np.isfinite(homing) or not 0.0 < homing < span:
        raise EstimationError(
            f"homing must be longer than 0 s and shorter than the log ({span:g} s), {homing:g} s "
            "came"
        )
    truths = true_angles(log, joints)
    if truths is None:
        raise EstimationError(
            f"{log.source}: homing needs the joint's angle for a while, and this log has none"
        )
    if not np.isfinite(truths[log.time - log.time[0] < homing]).any():
        raise EstimationError(
            f"{log.source}: the reference has no value in the first {homing:g} s; homing needs one"
        )
    return truths


def homed(angles: Floats, truths: Floats, early: Bools) -> Floats:
    """Return `angles` [rad], (k, n_joints), each joint's shifted so that its mean error against the
    reference is zero.

    Args:
        angles: as estimated.
        truths: the reference's angles [rad], NaN where it has none, (k, n_joints).
        early: where the reference is used, (k,).
    """
    shifted = angles.copy()
    for j in range(angles.shape[1]):
        compared = early & np.isfinite(truths[:, j])
        if compared.any():
            shifted[:, j] -= np.mean(angles[compared, j] - truths[compared, j])
    return shifted


@dataclass(frozen=True)
class Run:
    """A log and an estimator, ready to run.

    Args:
        estimator: to run over it.
        samples: values of the estimator's channels, (k, n_channels).
        start: belief before the first sample.
        homing: for how long the true angle is used as a reference [s], or None.
    """

    log: Log
    estimator: KernelEstimator
    samples: Floats
    start: Belief
    homing: float | None = None


@one_blas_thread()
def home(estimator: AdaptiveFilter, run: Run, truths: Floats, homing: float) -> Run:
    """Return a run, adapted by its homing move.

    The run itself reads no reference. Where no log has taught a map, the filter first reads the
    reference in the window, and the run begins with the parameters that it then has, if it stays
    bounded with them. What its angle lacks in the window conditions the maps.

    Args:
        estimator: the filter, whose channels contain the reference, with maps (see
            `with_prior_maps`).
        run: whose samples have the reference only in the window.
        truths: true angles [rad], NaN where not known, (k, n_joints).
        homing: length of the window [s].
    """
    log = run.log
    samples = run.samples
    start = run.start
    early = log.time - log.time[0] < homing
    unaided = samples.copy()
    unaided[:, len(estimator.positions) :] = np.nan
    offsets = offsets_of(log, estimator.rig)
    begun = start
    if not all(learned.logs for learned in estimator.maps.filter):
        start = _anchored(start, truths[early], estimator.rig.joint_names, offsets)
        begun = _with_parameters(estimator, start, log.time[early], samples[early])
    for first in (begun, start):
        plain = plain_samples(estimator, first, log, unaided, truths)
        if np.all(np.abs(plain.angles) <= LARGEST_ANGLE):  # NaN is not below it either
            break
    else:
        return replace(run, samples=unaided, start=start)
    names = estimator.channels[: len(estimator.positions)]
    of_readings = Samples.of_readings(log, samples[:, : len(names)], truths)
    changed = dict[str, object]()
    for kind, maps, of in (
        ("filter", estimator.maps.filter, plain),
        ("readings", estimator.maps.readings, of_readings),
    ):
        conditioned = []
        for learned in maps:
            part = of_part(of, estimator.rig, names, learned.joints, learned.channels)
            conditioned.append(_conditioned(learned, part, early, offsets))
        changed[kind] = tuple(conditioned)
    adapted = estimator.with_maps(estimator.maps.model_copy(update=changed))
    return replace(run, estimator=adapted, samples=unaided, start=first)


def with_prior_maps(rig: Rig) -> Rig:
    """Return the rig with a map of what its filter lacks for each independent part, of which
    nothing is known yet; unchanged where it has learned ones.
    """
    if rig.map is not None and rig.map.filter:
        return rig
    maps = []
    for part in parts_of(rig, channels_of(rig, "regression")):
        none = np.zeros((2, len(part["joints"])))
        rest = np.zeros((2, len(part["channels"])))
        maps.append(from_prior(Samples(np.arange(2.0), rest, none, none, none), part, {}))
    return rig.with_map(filter=maps)


def _anchored(
    start: Belief, truths: Floats, joints: Sequence[str], offsets: Mapping[str, float]
) -> Belief:
    """Return a first belief in which each joint's first known angle counts, with the std of its
    zero and its noise.
    """
    kernel_state = start.kernel_state.copy()
    covariance = covariance_of(kernel_state, start.size)
    for j, (joint, column) in enumerate(zip(joints, truths.T)):
        angles = column[np.isfinite(column)]
        if len(angles):
            before = covariance[j, j]
            gain = before / (before + TRUTH_NOISE**2 + offsets.get(joint, 0.0) ** 2)
            kernel_state[j] += gain * (angles[0] - kernel_state[j])
            covariance[j, :] = covariance[:, j] = 0.0
            covariance[j, j] = (1.0 - gain) * before
    return Belief(start.time, frozen(kernel_state), start.size)


def _with_parameters(
    estimator: AdaptiveFilter, start: Belief, time: Floats, samples: Floats
) -> Belief:
    """Return a first belief with the rig's parameters, and their covariance, after `samples` that
    contain the reference; unchanged where the filter then diverges.
    """
    after = estimator.advanced(start, time, samples).kernel_states[-1]
    if not np.isfinite(after).all():
        return start
    lasting = np.flatnonzero(estimator.states.lasting)
    kernel_state = start.kernel_state.copy()
    kernel_state[lasting] = after[lasting]
    square = np.ix_(lasting, lasting)
    covariance_of(kernel_state, start.size)[square] = covariance_of(after, start.size)[square]
    return Belief(start.time, frozen(kernel_state), start.size)


def _conditioned(
    learned: LearnedMap, samples: Samples, early: Bools, offsets: Mapping[str, float]
) -> LearnedMap:
    """Return a map conditioned on the targets of a run's first samples, `early`."""
    if learned.logs:
        return given(learned, samples, early, offsets)
    described = {
        "joints": learned.joints,
        "channels": learned.channels,
        "positions": learned.positions,
    }
    return from_window(samples, described, early, offsets)


def plain_samples(
    estimator: AdaptiveFilter, start: Belief, log: Log, samples: Floats, truths: Floats
) -> Samples:
    """Return the readings of a filter over a log, the filter's own angles, and the errors of these,
    true minus estimated.

    Args:
        estimator: the filter; the angles are those before its maps correct them.
        start: belief before the first sample.
        log: with its stamps.
        samples: values of the channels, (k, n_channels).
        truths: true angles [rad], NaN where not known, (k, n_joints).
    """
    kernel_states = estimator.advanced(start, log.time, samples).kernel_states
    nj = truths.shape[1]
    n = start.size
    angles = mean_of(kernel_states, n)[:, :nj].copy()
    variances = variances_of(kernel_states, n)[:, :nj].copy()
    # a map reads the positions of drives as the filter tracks them, while they are read
    readings = [
        column if at is None else np.where(np.isfinite(column), kernel_states[:, at], np.nan)
        for column, at in zip(samples.T, estimator.positions)
    ]
    since = log.time - log.time[0]
    return Samples(since, np.column_stack(readings), angles, truths - angles, variances)
