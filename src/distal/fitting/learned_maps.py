"""Maps learned from logs with a reference: of the angle by readings alone, of what a filter's angle
lacks, and of the forces that are normal in free motion.

Each has samples (readings, targets and the filter's angles), hyperparameters by the density of
held-out logs, and a band by their errors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from distal.arrays import Floats
from distal.confidence import BAND, COVERED
from distal.errors import DistalError, EstimationError
from distal.estimators import (
    LARGEST_ANGLE,
    AdaptiveFilter,
    channels_of,
    first_values,
    of_part,
    parts_of,
    samples_of_angles,
)
from distal.homing import check_homing, plain_samples
from distal.kernels import Compiled
from distal.logs import Log, TruthKind, shown, true_angles
from distal.regression import (
    FEWEST_LOGS,
    Evidence,
    Prior,
    Samples,
    Shape,
    Weights,
    conformal_factor,
    evidence_of,
    features_along,
    framed,
    map_from,
    shape_for,
    whitening,
    with_arrays,
)
from distal.rig import LearnedMap, Rig, Sensor
from distal.run import samples_of
from distal.run.exchanged_or_late import NORMAL, means_along
from distal.sensor_models import variance

RADIAL = 32
"""Number of radial functions. Source: benchmark (python -m benchmarks.one_map)."""

SEARCHED = (
    ("noise",),
    ("log",),
    ("log_readings", "log_slips"),
    ("radial",),
    ("slips",),
    ("readings", "lags"),
    ("filter",),
)
"""Names of the hyperparameters that move with each coordinate of the search."""

STARTS = (
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),  # the usual
    (0.0, 2.5, 0.0, 0.0, 0.0, 0.0, 0.0),  # logs that differ by their zeros
    (0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)
"""Coordinates where the search may begin. Source: benchmark (python -m benchmarks.one_map)."""

SPREAD = 3.0
"""Std of each coordinate over rigs. Source: benchmark (python -m benchmarks.one_map)."""

PLAYS = (1.0, 0.5, 0.25)
"""Factors on the half-widths of plays, of which the likeliest is taken [1]. Source: benchmark
(python -m benchmarks.positions_only).
"""

EVALUATIONS = 200
"""Largest number of sets of hyperparameters that are tried. Source: benchmark (python -m
benchmarks.one_map).
"""


def density(errors: Floats, variances: Floats) -> float:
    """Return the mean ln of the normal density of some errors, given their `variances`; 0 where
    there are none.
    """
    if not len(errors):
        return 0.0
    return float(-0.5 * np.mean(np.log(2 * np.pi * variances) + errors**2 / variances))


def moved(z: Floats) -> Prior:
    """Return the hyperparameters at the coordinates z of the search, see `SEARCHED`."""
    usual = Prior()
    steps = {name: step for names, step in zip(SEARCHED, z) for name in names}
    return replace(usual, **{name: getattr(usual, name) + step for name, step in steps.items()})


@dataclass(frozen=True)
class Task:
    """A joint's map to be learned.

    Args:
        shape: of its features.
        logs: what each log tells.
        groups: the group of each log, which is held out together.
        centre: of the targets [SI], which is off those of the logs.
        scale: of the targets [SI], in which those of the logs are.
    """

    shape: Shape
    logs: tuple[Evidence, ...]
    groups: tuple[int, ...]
    centre: float = 0.0
    scale: float = 1.0

    @property
    def in_groups(self) -> Task:
        """The same with the halves of logs as groups, where there is one group only."""
        if len(set(self.groups)) > 1:
            return self
        halves = [np.arange(len(log.target)) < len(log.target) // 2 for log in self.logs]
        parts = [log.part(rows) for log, half in zip(self.logs, halves) for rows in (half, ~half)]
        return replace(self, logs=tuple(parts), groups=(0, 1) * len(self.logs))

    def without(self, prior: Prior) -> list[Weights]:
        """Return for each log the weights that the other groups tell."""
        return Weights.without(self.shape, prior, self.logs, self.groups)

    def held_out(self, prior: Prior) -> list[tuple[Floats, Floats]]:
        """Return errors and variances on each log by the weights that the other groups tell, after
        what is given of it.
        """
        return [weights.errors(log) for weights, log in zip(self.without(prior), self.logs)]

    def cost(self, z: Floats, each: float = 1.0) -> float:
        """Return −ln of the posterior density of hyperparameters, but for a constant: by logs left
        out, with a normal prior around the usual ones.

        Args:
            z: coordinates, see `SEARCHED`.
            each: number of independent samples for which a log counts.
        """
        try:
            without = self.without(moved(z))
            pairs = [weights.errors(log) for weights, log in zip(without, self.logs)]
            # what is given must not come as a surprise either
            pairs += [
                weights.errors(replace(known, given=~known.given))
                for weights, known in zip(without, [log.part(log.given) for log in self.logs])
            ]
        except np.linalg.LinAlgError:
            return 1e9
        total = sum(density(*pair) for pair in pairs) * len(set(self.groups)) / len(self.logs)
        return float(0.5 * np.sum((z / SPREAD) ** 2) - each * total)

    def search(self, starts: ArrayLike = STARTS, each: float = 1.0, lags: bool = True) -> Floats:
        """Return the coordinates of the likeliest hyperparameters, see `cost`.

        Args:
            starts: coordinates, (n, 7) or (7,), at the likeliest of which the search begins.
            each: number of independent samples for which a log counts.
            lags: whether joints may follow their drives later than usual.
        """
        from scipy.optimize import minimize  # loaded late: it takes as long as all of distal

        axes = np.eye(len(SEARCHED))[[lags or "lags" not in names for names in SEARCHED]]

        def cost(of_free: Floats) -> float:
            return self.cost(of_free @ axes, each)

        options = {"maxfev": EVALUATIONS, "xtol": 0.1, "ftol": 1e-3}
        start = min(np.atleast_2d(starts) @ axes.T, key=cost)
        best: Floats = minimize(cost, start, method="Powell", options=options).x @ axes
        return best


@dataclass(frozen=True)
class Seen:
    """What a map sees along some logs: the numbers of its features, and these features."""

    shape: Shape
    frame: dict[str, Floats]
    along: tuple[dict[str, Floats], ...]

    @classmethod
    def of(
        cls, logs: Sequence[Samples], described: Mapping[str, tuple[str, ...]], play: float = 1.0
    ) -> Seen:
        """Return what a map sees along logs, with a factor on the half-widths of `play`; see
        `learned_map`.
        """
        shape = shape_for(logs[0], described, RADIAL)
        frame = framed(shape, logs, play)
        flat = shape.flat(frame)
        along = (features_along(shape, flat, log.time, log.every) for log in logs)
        return cls(shape, frame, tuple(along))

    def task(
        self,
        logs: Sequence[Samples],
        joint: int,
        groups: Sequence[int],
        homing: float | None = None,
    ) -> Task:
        """Return what is to be learned of a joint; see `learned_map` for `homing`."""
        targets = np.concatenate([log.targets[:, joint] for log in logs])
        beside = self.shape.angles > 0
        centre = 0.0 if beside else float(np.nanmean(targets))
        # of an error of the filter, the angle itself is the scale
        angles = [log.angles[:, joint] if beside else 0.0 * log.time for log in logs]
        scale = max(float(np.nanstd(targets + np.concatenate(angles))), SMALLEST_SCALE)
        evidence = tuple(
            evidence_of(log, along, joint, scale, centre, homing)
            for log, along in zip(logs, self.along)
        )
        return Task(self.shape, evidence, tuple(groups), centre, scale)


@dataclass(frozen=True)
class HeldOut:
    """The errors of a joint's angle on a log [rad], (k,), by what other logs tell, their variances,
    and the time since the log's beginning [s].
    """

    time: Floats
    errors: Floats
    variances: Floats


@dataclass(frozen=True)
class Score:
    """The RMS error of an estimator on a log [rad], the share of samples inside its 95 % band, and
    the band's mean half-width [rad].

    `joint_halves` has the half-width of each joint [rad]; it is empty where there is no band.
    """

    rms: float
    inside: float
    half: float
    joint_halves: tuple[float, ...] = ()

    @classmethod
    def of(cls, joints: Sequence[HeldOut], begin: float = -np.inf) -> Score:
        """Return the score of each joint's errors, which count from the time `begin` on [s]."""
        parts = [(joint, joint.time >= begin) for joint in joints]
        pairs = [(joint.errors[late], np.sqrt(joint.variances[late])) for joint, late in parts]
        errors, stds = (np.concatenate(columns) for columns in zip(*pairs))
        return cls(
            _mean(errors**2) ** 0.5,
            _mean(np.abs(errors) <= BAND * stds),
            BAND * _mean(stds),
            tuple(BAND * _mean(of_joint) for _, of_joint in pairs),
        )


def _mean(values: Floats) -> float:
    """Return the mean of some values; NaN where there are none."""
    return float(np.mean(values)) if len(values) else float("nan")


SMALLEST_SCALE = 1e-9
"""Least scale of targets [rad, N m]. Source: rounding (division by a scale of zero)."""


def learned_map(
    logs: Sequence[Samples],
    described: Mapping[str, tuple[str, ...]],
    groups: Sequence[int],
    homing: float | None = None,
    plays: Sequence[float] = PLAYS,
) -> tuple[LearnedMap, list[list[HeldOut]]]:
    """Return the map that logs teach, and of each joint the errors on each log by what the other
    groups tell.

    Args:
        logs: the samples of each; with one log its two halves are held out in turn.
        described: the fields of the `LearnedMap` that say what it reads and gives.
        groups: the group of each log, whose logs are held out together.
        homing: for how long the target is known in use [s]; None: it is not.
        plays: factors on half-widths of plays, of which the likeliest is taken.
    """
    joints = range(logs[0].targets.shape[1])
    seen = {play: Seen.of(logs, described, play) for play in plays}
    tasks = {
        play: [of_play.task(logs, joint, groups, homing) for joint in joints]
        for play, of_play in seen.items()
    }
    first, *_ = plays
    found = [task.in_groups.search() for task in tasks[first]]

    def cost(play: float) -> float:
        return sum(task.in_groups.cost(z) for task, z in zip(tasks[play], found))

    likeliest = min(plays, key=cost)
    if likeliest != first:
        found = [task.in_groups.search(z) for task, z in zip(tasks[likeliest], found)]
    results = [_of_joint(moved(z), task) for z, task in zip(found, tasks[likeliest])]
    held_out = [errors for _, errors in results]
    arrays = {name: np.stack([result[name] for result, _ in results]) for name in results[0][0]}
    learned = map_from(
        logs,
        described,
        seen[likeliest].frame,
        len(logs),
        **arrays,
        correlation=_correlation(held_out),
    )
    return learned.model_copy(update=scores_of(held_out)), held_out


def scores_of(held_out: Sequence[Sequence[HeldOut]]) -> dict[str, tuple[float, ...]]:
    """Return the scores of a `LearnedMap` by the errors of each joint on each log."""
    scores = [Score.of(logs) for logs in held_out]
    return {
        "rms": tuple(score.rms for score in scores),
        "inside": tuple(score.inside for score in scores),
    }


def _correlation(held_out: Sequence[Sequence[HeldOut]]) -> Floats:
    """Return the correlation of the joints' errors on logs left out, (n_joints, n_joints); joints
    whose angles are not known at the same samples count as independent.
    """
    standardized = [
        np.concatenate([log.errors / np.sqrt(log.variances) for log in logs]) for logs in held_out
    ]
    if len({errors.shape for errors in standardized}) > 1:
        return np.eye(len(standardized))
    products = np.array(standardized) @ np.array(standardized).T
    stds = np.sqrt(np.maximum(np.diag(products), 1e-300))
    correlation: Floats = products / np.outer(stds, stds)
    np.fill_diagonal(correlation, 1.0)
    return correlation


def _of_joint(prior: Prior, task: Task) -> tuple[dict[str, Floats], list[HeldOut]]:
    """Return the arrays of a joint's map with its scores on logs left out, and its errors there."""
    weights = Weights.of(task.shape, prior, task.logs)
    groups = len(set(task.groups))
    task = task.in_groups
    held_out = task.held_out(prior)
    if task.shape.angles:
        targets = [log.target[~log.given] for log in task.logs]
        pairs = [(target, error) for target, (error, _) in zip(targets, held_out)]
        # halves of one log are more alike than two logs, so the smaller of their shares is taken
        share = _share(pairs) if groups > 1 else min(_share([pair]) for pair in pairs)
        weights = replace(weights, mean=share * weights.mean)
        held_out = [
            (target * (1 - share) + share * error, variance)
            for target, (error, variance) in zip(targets, held_out)
        ]
    # Student's distribution for as many logs: t_{0.975}/1.96
    wider = float(stdtrit(max(groups - 1.0, 1.0), (1 + COVERED) / 2)) / BAND
    factor = conformal_factor(held_out) * np.sqrt(wider)
    square = (factor * task.scale) ** 2
    scored = [
        HeldOut(log.time[~log.given], task.scale * error, square * variance)
        for log, (error, variance) in zip(task.logs, held_out)
    ]
    mean = task.scale * weights.mean
    mean[0] += task.centre
    arrays = {
        "mean": mean,
        "covariance": square * weights.covariance,
        "radial": square * np.exp(2 * np.array(prior.radial)),
        "noise": square * np.exp(2 * np.array(prior.noise)),
        "filter": factor * np.exp(np.array(prior.filter)),
        "error_time": np.exp(np.array(prior.error_time)),
    }
    return arrays, scored


def _share(held_out: Sequence[tuple[Floats, Floats]]) -> float:
    """Return the share of a map's values, 0 to 1, with which it errs least on held-out logs beside
    the filter alone (stacking; Wolpert, Neural Networks 5, 1992), by targets and errors on each.
    """
    pairs = [(target, target - error) for target, error in held_out if len(target)]
    products = sum(float(np.mean(target * mapped)) for target, mapped in pairs)
    squares = sum(float(np.mean(mapped**2)) for _, mapped in pairs)
    return float(np.clip(products / max(squares, 1e-300), 0.0, 1.0))


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
    estimator_of = cache(AdaptiveFilter)
    for i, (log, rig) in enumerate(zip(logs, rigs)):
        try:
            samples = _filtered(log, estimator_of(rig, compiled), homing)
            if not np.all(np.abs(samples.angles) < LARGEST_ANGLE):  # NaN is not below it either
                raise EstimationError("adaptive left all bounds on it")
        except DistalError as problem:
            refused.append(f"{shown(log.source)} is left out: {problem}")
        else:
            data[i] = samples
    if homing is None and reference_sensors(rigs[0], logs):
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
    means = []
    for samples in data:
        counts = np.isfinite(samples.targets).sum(axis=0)
        if counts.any():
            means.append(np.nan_to_num(samples.targets).sum(axis=0) / np.maximum(counts, 1))
    if not means:
        return list(data)
    common = np.mean(means, axis=0)
    common = np.where(np.abs(common) <= limits, common, 0.0)
    return [replace(samples, targets=samples.targets - common) for samples in data]


def reference_sensors(rig: Rig, logs: Sequence[Log]) -> list[Sensor]:
    """Return the angle sensors that give the reference of some logs; none for a reference from
    elsewhere.
    """
    read = any(log.truth_kind is TruthKind.SENSOR for log in logs)
    return list(rig.sensors_of("angle")) if read else []


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
    squares = [np.nanmean(errors**2) for errors in late if np.isfinite(errors).any()]
    return float(np.mean(np.sqrt(squares)))


def reference_std(rig: Rig, logs: Sequence[Log]) -> float:
    """Return the std of the random error of the angle sensor that gives the reference [rad], the
    largest of several; 0 for a reference from elsewhere.

    The sensor's offset is not counted, since it is the same along a log.
    """
    return float(np.sqrt(max((variance(s) for s in reference_sensors(rig, logs)), default=0.0)))


def reference_offset(rig: Rig, logs: Sequence[Log]) -> float:
    """Return the std of the zero of the angle sensor that gives the reference [rad], the largest of
    several; 0 for a reference from elsewhere.
    """
    return max((s.bias.total_std for s in reference_sensors(rig, logs)), default=0.0)


@dataclass(frozen=True)
class MapFit:
    """Learned maps of a rig, one for each independent part, with their scores on logs left out.

    Args:
        kind: ``readings`` or ``filter``, as in `LearnedMaps`.
        maps: the maps.
        start: the original description.
        errors: joint → its errors on each log by what the other logs tell.
    """

    kind: str
    maps: tuple[LearnedMap, ...]
    start: Rig
    errors: Mapping[str, Sequence[HeldOut]] = field(default_factory=dict)

    def held_out(self, log: int) -> list[HeldOut]:
        """Return the errors of each joint on a log, by its index."""
        return [self.errors[joint][log] for joint in self.start.joint_names]


def map_of(
    data: Sequence[Samples],
    rig: Rig,
    kind: str,
    folds: Sequence[int],
    homing: float | None,
) -> MapFit:
    """Return the maps of a kind that logs teach, one for each independent part of the rig.

    Args:
        data: the samples of each log, of all sensors and joints.
        kind: ``readings``: of the angles, by readings alone; ``filter``: of what the angles of
            `adaptive` lack.
        folds: the fold of each log.
        homing: length of the homing window [s], or None.
    """
    channels = channels_of(rig, "regression")
    names = [sensor.name for sensor in channels.proximal]
    maps = []
    errors = dict[str, list[HeldOut]]()
    for part in parts_of(rig, channels):
        samples = [of_part(log, rig, names, part["joints"], part["channels"]) for log in data]
        learned, held_out = learned_map(samples, part, folds, homing)
        maps.append(learned)
        errors.update(zip(part["joints"], held_out))
    return MapFit(kind, tuple(maps), rig, errors)


def with_its_reference_error(of_kind: MapFit, logs: Sequence[Log]) -> MapFit:
    """Return maps with the error of the reference's zero in their band: an encoder that is mounted
    0.2° off is so in all logs, so that no held-out log shows it.
    """
    variances = {
        sensor.of: sensor.bias.total_std**2
        for sensor in reversed(reference_sensors(of_kind.start, logs))
    }
    maps = [
        with_arrays(
            learned,
            noise=learned.arrays["noise"] + [variances.get(j, 0.0) for j in learned.joints],
        )
        for learned in of_kind.maps
    ]
    errors = {
        joint: [
            replace(log, variances=log.variances + variances.get(joint, 0.0)) for log in of_logs
        ]
        for joint, of_logs in of_kind.errors.items()
    }
    return replace(of_kind, maps=tuple(maps), errors=errors)


def pooled(
    beside: MapFit, alone: MapFit, data: Mapping[int, Samples], logs: Sequence[Log]
) -> tuple[MapFit, MapFit]:
    """Return the maps on readings alone, which now share in each angle, and the maps beside a
    filter with the errors of both together, see `distal.regression.pool_of_filter_and_map`.

    Args:
        beside: the maps beside the filter.
        alone: the maps on readings alone.
        data: the filter's samples along the logs, by the index of the log.
        logs: of known angle.
    """
    joints = beside.start.joint_names
    errors = {
        joint: [
            _pooled_errors(of_log, alone.errors[joint][i])
            for i, of_log in zip(data, beside.errors[joint])
        ]
        for joint in joints
    }
    scored = [
        learned.model_copy(update=scores_of([errors[joint] for joint in learned.joints]))
        for learned in beside.maps
    ]
    first = next(iter(data))
    true = samples_of_angles(logs[first], beside.start).targets
    # what is taken for the encoder's own offset is off the targets of the filter's map
    offsets = np.nanmean(true - data[first].angles - data[first].targets, axis=0)
    zeros = dict(zip(joints, offsets.tolist()))
    return answering(alone, zeros), replace(beside, maps=tuple(scored), errors=errors)


def answering(alone: MapFit, zeros: Mapping[str, float]) -> MapFit:
    """Return maps on readings alone that share in the angles.

    Args:
        alone: the maps.
        zeros: joint → angle at the filter's zero [rad], which is taken off.
    """
    maps = []
    for learned in alone.maps:
        mean = learned.arrays["mean"].copy()
        mean[:, 0] -= [zeros.get(joint, 0.0) for joint in learned.joints]
        maps.append(with_arrays(learned, mean=mean).model_copy(update={"answers": True}))
    return replace(alone, maps=tuple(maps))


def _pooled_errors(beside: HeldOut, alone: HeldOut) -> HeldOut:
    """Return the errors of the pool of two maps, with shares by the inverse of their variances."""
    time, at, of_alone = np.intersect1d(beside.time, alone.time, return_indices=True)
    errors = np.array([beside.errors[at], alone.errors[of_alone]])
    variances = np.array([beside.variances[at], alone.variances[of_alone]])
    shares = variances[::-1] / variances.sum(axis=0)
    mean = np.sum(shares * errors, axis=0)
    return HeldOut(time, mean, np.sum(shares * (variances + errors**2), axis=0) - mean**2)


USUAL_SPREAD = 0.4
"""Std over the logs of a rig of the natural logarithm of a log's largest mean of T² [1]. Source:
benchmark (docs/results/reliability.md: 0.52 over a second, 0.27 over 30 s, on ten rigs).
"""

USUAL_FREEDOM = 8
"""Degrees of freedom of that spread as a prior. Source: judgement (these rigs)."""


def efforts_of(logs: Sequence[Log], rig: Rig, folds: Sequence[int]) -> tuple[LearnedMap, ...]:
    """Return what each force and tension is in free motion, by the positions of the drives of its
    part and what these remember; see `distal.run.exchanged_or_late`.

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
        # no variance is asked: the errors on logs left out are what is known of it
        learned = with_arrays(learned, covariance=0.0 * learned.arrays["covariance"])
        whitener = whitening(learned.arrays["correlation"])
        errors = [np.array([log.errors for log in logs]) for logs in zip(*held_out)]
        scaled = [whitener @ (e.T / learned.rms).T for e in errors]
        times = [log.time for log in held_out[0]]
        maps.append(learned.model_copy(update={"normal": _largest_means(times, scaled)}))
    return tuple(maps)


def _of_efforts(log: Log, forces: Sequence[str], positions: Sequence[str]) -> Samples:
    readings, targets = (
        np.column_stack([log.channels[name] for name in names]) for names in (positions, forces)
    )
    targets[~np.isfinite(targets).all(axis=1)] = np.nan  # their errors are asked together
    return Samples.of_readings(log, readings, targets)


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
