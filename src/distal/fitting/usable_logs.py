"""What is found out of logs before they are fitted: which cannot be fitted at all (`check_logs`),
how late the reference is (`reference_lag`), and in which something touches a joint
(`touched_logs`).

Two candidates explain a lag between drives and reference. The reference is late by L: what it
reads at t follows from φ(y) at t − L. Or the joints are, by a lag of first order with time
constant τ: it follows from φ(y) behind that lag. Each is the map on readings alone with
hyperparameters of its own, and the likelier one on logs left out is taken.

A touched log says nothing true of free motion. Least squares from the other logs err far more on
it than on each other, since the same positions of the drives go with other angles.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np

from distal.arrays import Floats
from distal.errors import EstimationError, FitError
from distal.estimators import channels_of, samples_of_angles
from distal.fitting.learned_maps import Seen, Task, density, moved
from distal.logs import Log, TruthKind, check_unit, earlier, true_angles
from distal.regression import FEWEST_LOGS, Evidence, Prior, yardstick_error
from distal.rig import REFERENCES, Rig, angle_names
from distal.run import estimate
from distal.sensor_models import variance

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
    known = np.isfinite(np.vstack([log.targets for log in samples])).any(axis=0)
    channels = channels_of(rig, "regression")
    of = {"channels": channels.proximal, "positions": channels.positions}
    names = {key: tuple(sensor.name for sensor in sensors) for key, sensors in of.items()}
    seen = Seen.of(samples, names)
    tasks = [seen.task(samples, joint, folds) for joint in np.flatnonzero(known).tolist()]
    times = [log.time for log in samples]
    # samples whose errors are one correlation time apart count as independent
    each = float(np.mean([np.ptp(time) for time in times]) / np.exp(Prior().error_time))

    def late(how: Lateness, age: float) -> list[Task]:
        """Return the tasks with features that are late by an age [s]."""
        features = [how(along, time, age) for along, time in zip(seen.along, times)]
        return [
            replace(task, logs=tuple(map(_at_samples, task.logs, features, times)))
            for task in tasks
        ]

    as_reference, lag = _likeliest(partial(late, _delayed), each)
    as_joint, _ = _likeliest(partial(late, _followed), each)
    # a reference that is read with the drives is hardly late; a camera is never on time
    if any(np.mean(np.isfinite(log.targets).any(axis=1)) < SLOWER for log in samples):
        prior = _log_density(max(lag - LARGEST_USUAL, 0.0)) - np.log(LARGEST_USUAL)
        on_time = np.inf
    else:
        prior = np.log(LATE) + _log_density(lag) + np.log(2.0 / (UNUSUAL_STD * np.sqrt(2 * np.pi)))
        on_time = _searched(tasks, each)[1] + np.log(LATE)
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
            max(sum(density(*pair) for pair in task.held_out(prior)) for prior in priors)
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
        found, least = _searched(tasks_at(age), each)
        tried = [[moved(z)] for z in found]
    return least, age


def _searched(tasks: Sequence[Task], each: float) -> tuple[list[Floats], float]:
    """Return the likeliest coordinates of each task's hyperparameters, and −ln of their posterior
    density; see `Task.search` for `each`.
    """
    found = [task.search(each=each, lags=False) for task in tasks]
    return found, sum(task.cost(z, each) for task, z in zip(tasks, found))


NOISES = (-1.0, 1.0, 3.0)
"""Steps of the noise from the usual one with which ages are first compared [1]. Source: judgement.
"""

ROUNDS = 2
"""Number of times that age and hyperparameters are found in turn [1]. Source: benchmark (python -m
benchmarks.late).
"""


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
    return {
        n: lfilter([1 - pole], [1, -pole], along[n], 0, pole * along[n][:1])[0] for n in OF_EVIDENCE
    }


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


UNLIKE_OTHERS = 2.5
"""Ratio of a log's error to the median error of the other logs, above which the log is unlike them
[1]. Source: benchmark (docs/results/touch.md).
"""

SPOILT = 1.5
"""Ratio of the errors on the other logs with and without such logs in the training, above which
these count as touched [1]. Source: benchmark (docs/results/touch.md).
"""

YARDSTICK = "least squares with lags"
"""Name of the yardstick, see `YARDSTICKS`, whose errors are compared."""


def touched_logs(logs: Sequence[Log], rig: Rig) -> list[int]:
    """Return the indices of the logs in which something seems to touch the joints.

    The log on which least squares from the others err most is set aside, again and again, until
    half of the logs are left, or `FEWEST_LOGS`. Logs that were set aside count as touched where two
    things hold. Least squares from the rest err `UNLIKE_OTHERS` times as much on them as on the
    rest. Least squares from the rest and them together err `SPOILT` times as much on the rest. A
    log of fast motions is far off too, but spoils nothing.
    """
    joints = rig.joint_names
    with_angles = [i for i, log in enumerate(logs) if true_angles(log, joints) is not None]
    if len(with_angles) <= FEWEST_LOGS:
        return []
    try:
        samples = {i: samples_of_angles(logs[i], rig) for i in with_angles}
    except EstimationError:
        return []

    def errors(of: Sequence[int], training: Sequence[int]) -> dict[int, float]:
        return {
            i: yardstick_error(YARDSTICK, [samples[j] for j in training if j != i], samples[i])
            for i in of
        }

    kept = list(with_angles)
    aside = list[int]()
    while len(kept) > max(FEWEST_LOGS, len(with_angles) // 2):
        by_others = errors(kept, kept)
        worst = max(kept, key=lambda i: by_others[i])
        aside.append(worst)
        kept.remove(worst)
    by_kept = errors(with_angles, kept)
    usual = float(np.median([by_kept[i] for i in kept]))
    far = [i for i in aside if by_kept[i] > UNLIKE_OTHERS * usual]
    spoilt = errors(kept, [*kept, *far])
    return sorted(far) if np.median(list(spoilt.values())) > SPOILT * usual else []


MOTION_TO_NOISE = 20.0
"""Range of a drive's position, in standard deviations of its sensor, below which the drive counts
as at rest. Source: judgement.
"""

SMALLEST_TURN = np.deg2rad(2.0)
"""Turn of the joint below which the drive that would cause it counts as at rest [rad]. Source:
judgement.
"""

DEAD_TRUTH_TURN = np.deg2rad(20.0)
"""Turn that the drives would give the joint, above which a constant reference angle means a dead
reference sensor [rad], since no friction holds a joint so. Source: judgement.
"""

CLEAR_CORRELATION = 0.8
"""Correlation of the reference angle and the drives' motion, above which sign and size can be
judged. Source: judgement.
"""

FEWEST_TRUTHS = 10
"""Least number of known angles by which signs and sizes are judged [1]. Source: judgement."""

RATIO_RANGE = (1 / 12, 12.0)
"""Least and largest ratio of the reference angle's motion to the turn by the drives, between which
the units may be right. Source: judgement.
"""


def check_logs(logs: Sequence[Log], rig: Rig, drafted: bool = False) -> None:
    """Refuse logs that come twice, have wrong stamps, no motion or a dead sensor, or a reference
    angle in a wrong unit or of a wrong sign; of a rig that was `drafted` from these logs, whose
    signs and sizes are theirs, the last two are not asked.

    Raises:
        FitError: no log came, or a log is refused; names the log and the sensor.
    """
    if not logs:
        raise FitError("no log came; a fit needs at least one")
    for i, log in enumerate(logs):
        check_unit(log.time, rig, log.source)
        for twin in logs[:i]:
            if _same(log, twin):
                raise FitError(
                    f"{log.source} holds the same as {twin.source}; a log that counts twice makes "
                    "a fit too sure of itself"
                )
        _check_motion(log, rig)
        _check_sensors(log, logs, rig)
        joints = rig.joint_names
        angles = true_angles(log, joints)
        if angles is None:
            continue
        for j, joint in enumerate(joints):
            if len(joints) == 1 or np.isfinite(angles[:, j]).any():
                subject = "the joint" if len(joints) == 1 else f"the joint {joint}"
                _check_truth(log, rig, angles, subject, j, drafted)


def _same(log: Log, other: Log) -> bool:
    return np.array_equal(log.time, other.time) and all(
        name in other.channels and np.array_equal(values, other.channels[name], equal_nan=True)
        for name, values in log.channels.items()
    )


def unknown_joints(logs: Sequence[Log], rig: Rig) -> list[str]:
    """Return the names of the joints whose angle is known in none of the logs."""
    known = {
        name for log in logs for name, values in log.truth.items() if np.isfinite(values).any()
    }
    names = rig.joint_names
    return [name for name, column in zip(names, angle_names(names)) if column not in known]


def _check_motion(log: Log, rig: Rig) -> None:
    moved = []
    for sensor in rig.sensors_of("position"):
        values = log.channels[sensor.name]
        if np.isnan(values).all():
            continue
        span = np.ptp(np.nanquantile(values, (0.01, 0.99)))
        drive = rig.drive(sensor.of)
        # of the joint
        turn = span * drive.lever / rig.tendons_of(drive.name)[0].total_arm
        noise = np.sqrt(variance(sensor))
        moved.append(span > MOTION_TO_NOISE * noise and turn > SMALLEST_TURN)
    if moved and not any(moved):
        raise FitError(
            f"{log.source}: nothing moves (no drive by more than {np.rad2deg(SMALLEST_TURN):g}° "
            "of the joint); a log "
            "without motion tells nothing of friction and stiffness: leave it out"
        )


def _check_sensors(log: Log, logs: Sequence[Log], rig: Rig) -> None:
    """Refuse a sensor that is constant over a log, unless its drive rests in this log and the
    sensor changes in another.
    """
    positions = {sensor.of: sensor.name for sensor in rig.sensors_of("position")}
    positions |= {
        tendon.name: positions[tendon.drive] for tendon in rig.tendons if tendon.drive in positions
    }
    for sensor in rig.sensors:
        if sensor.measures in REFERENCES or not _constant(log, sensor.name):
            continue
        rests = positions.get(sensor.of) is None or _constant(log, positions[sensor.of])
        if rests and not all(_constant(other, sensor.name) for other in logs):
            continue
        values = log.channels[sensor.name]
        raise FitError(
            f"{log.source}: sensor '{sensor.name}' is constant "
            f"({values[np.isfinite(values)][0]:g} {sensor.si}) over the "
            "whole log; is it connected? Leave the log out, or remove the sensor from the rig"
        )


def _constant(log: Log, name: str) -> bool:
    """Return whether a log has more than 20 values of a sensor and all are the same."""
    values = log.channels.get(name, np.zeros(0))
    finite = values[np.isfinite(values)]
    return len(finite) > 20 and float(np.ptp(finite)) == 0.0


def _check_truth(log: Log, rig: Rig, truths: Floats, joint: str, index: int, drafted: bool) -> None:
    """Refuse a reference angle that has too few values, is dead, or has a wrong sign or unit."""
    truth = truths[:, index]
    has_truth = np.isfinite(truth)
    subject = f"{log.source}: the truth of {joint}" + (
        f" ({log.truth_source})" if str(log.truth_source) else ""
    )
    if has_truth.sum() < FEWEST_TRUTHS:
        raise FitError(
            f"{subject} has {int(has_truth.sum())} values; at least {FEWEST_TRUTHS} are needed"
        )
    # with forces the stretch is taken off: soft tendons let drives and joint move differently
    baseline = "elastic" if rig.sensors_of("force") else "inextensible"
    by_drives = estimate(Log(log.time, log.channels, {}, log.source), rig, baseline).angles
    if float(np.std(by_drives[has_truth, index])) < SMALLEST_TURN / 2:
        return
    turn = float(np.ptp(by_drives[has_truth, index]))
    if float(np.ptp(truth[has_truth])) == 0.0 and turn > DEAD_TRUTH_TURN:
        raise FitError(f"{subject} is constant while the drives move; is the encoder connected?")
    for way in () if drafted else _ways_of(rig, index):
        crossed = way != 0.0
        known = np.isfinite(truths[:, crossed]).all(axis=1)
        a, b = (angles[known][:, crossed] @ way[crossed] for angles in (by_drives, truths))
        if known.sum() < FEWEST_TRUTHS or min(np.std(a), np.std(b)) == 0.0:
            continue  # the joint sticks: nothing to judge by
        _check_direction(subject, float(np.corrcoef(a, b)[0, 1]), float(np.std(b) / np.std(a)))


def _ways_of(rig: Rig, joint: int) -> list[Floats]:
    """Return the sums of joints' angles, as weights, (n_joints,), that the drives give and a known
    angle of a joint can be judged by: the angle itself, or the way of each tendon over the joint
    where the drives are fewer than the joints and leave their angles open.
    """
    names = rig.joint_names
    if len(rig.drives) >= len(names):
        return [np.eye(len(names))[joint]]
    every = [tendon.arms() for tendon in rig.tendons]
    return [
        np.array([arms.get(name, 0.0) for name in names]) for arms in every if names[joint] in arms
    ]


def _check_direction(subject: str, correlation: float, ratio: float) -> None:
    """Refuse a reference angle by its correlation with the turn by the drives, and the ratio of
    both.
    """
    if correlation < -CLEAR_CORRELATION:
        raise FitError(
            f"{subject} moves against the drives (correlation {correlation:.2f}); a sign is "
            "wrong: turn that of "
            "the angle sensor or of the position sensors round, or swap the tendons' sides"
        )
    if abs(correlation) > CLEAR_CORRELATION and not RATIO_RANGE[0] < ratio < RATIO_RANGE[1]:
        near = "is the unit, or a radius, wrong?"
        for low, high, units in (
            (20.0, 160.0, "degrees read as radians"),
            (1 / 160.0, 1 / 20.0, "radians read as degrees"),
        ):
            near = f"it looks like {units}" if low < ratio < high else near
        raise FitError(
            f"{subject} moves {ratio:.3g} times as far as the drives turn it; {near} (set the "
            "angle sensor's unit)"
        )
