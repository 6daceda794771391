"""What logs tell of a map's weights, by Bayes' rule; and the map of a log in which targets are
known for a while, such as in a homing move.

y = φᵀ b + φ₀ᵀ b_l + e: the weights b ~ N(0, P) are shared by all logs, b_l ~ N(0, Ω), of the
constant, the readings and the slips, is drawn anew by each log, and e ~ N(0, σ²). Each posterior
is a solve with sums over logs of φφᵀ, so that leaving a log out is leaving a term out. `Samples`
are a log as a map takes it, `Evidence` what one joint's map sees of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property
from typing import Any, Self, TypeAlias

import casadi as ca
import numpy as np

from distal.arrays import Bools, Floats
from distal.confidence import BAND, COVERED
from distal.kernels import Feed, Kernel, advance
from distal.logs import Log
from distal.regression.features import Shape, empty_frame, features_along
from distal.rig import LearnedMap, MapArrays


@dataclass(frozen=True)
class _OfLog:
    """Arrays of which each row is a sample of a log."""

    def part(self, rows: Bools) -> Self:
        """Return the samples that a mask `rows`, (k,), holds."""
        every = {part.name: getattr(self, part.name) for part in fields(self)}
        arrays: dict[str, Any] = {
            name: part[rows] for name, part in every.items() if isinstance(part, np.ndarray)
        }
        return replace(self, **arrays)


@dataclass(frozen=True)
class Samples(_OfLog):
    """A log as the input of a map.

    Args:
        time: time since the first sample [s], (k,).
        readings: readings of the channels, NaN where one is missing [SI], (k, m).
        angles: the filter's angles of the joints [rad], which a map may read, (k, n_joints), or
            none of them, (k, 0).
        targets: the values to be mapped: angles [rad], errors of the filter's angles [rad], or
            external torques [N m]; NaN where not known, (k, n_joints).
        variances: variances of the filter's own angles [rad²], zero where there is no filter, (k,
            n_joints).
    """

    time: Floats
    readings: Floats
    angles: Floats
    targets: Floats
    variances: Floats

    @classmethod
    def of_readings(cls, log: Log, readings: Floats, targets: Floats) -> Samples:
        """Return the samples of a log for a map on readings alone, (k, m), with the targets that it
        is to give, NaN where they are not known, (k, n_joints).
        """
        since = log.time - log.time[0]
        return cls(since, readings, np.zeros((len(log), 0)), targets, np.zeros(targets.shape))

    @property
    def every(self) -> Floats:
        """The readings and angles side by side, (k, m) or (k, m + n_joints)."""
        return np.column_stack([self.readings, self.angles])

    @property
    def held(self) -> Floats:
        """The readings, each missing one replaced by the last before it, at the beginning by the
        first after it.
        """
        columns = []
        for values in self.readings.T:
            is_finite = np.isfinite(values)
            last = np.maximum.accumulate(np.where(is_finite, np.arange(len(values)), -1))
            columns.append(values[np.where(last >= 0, last, int(np.argmax(is_finite)))])
        return np.column_stack(columns)


@cache
def _play() -> Kernel:
    """Return the kernel of a play operator, (z, x, w) → (z⁺, z⁺): its output is also its kernel
    state.
    """
    z, x, w = (ca.SX.sym(name) for name in ("z", "x", "w"))
    after = ca.fmin(ca.fmax(z, x - w), x + w)
    return Kernel(ca.Function("play", [z, x, w], [after, after]))


def played(values: Floats, half: float) -> Floats:
    """Return readings `values` x, (k,), after a play operator of half-width w = `half`: z⁺ =
    min(max(z, x − w), x + w).

    Noise below w does not change the output, it keeps its value while the input rests, and it does
    not depend on the input's rate (Visintin, 1994, ch. III).
    """
    after: Floats = advance(_play(), Feed(values[:1], values[:, None], np.array([half]))).ys[:, 0]
    return after


LEARNED_SAMPLES = 300
"""Number of samples to which a log is thinned for learning. Source: benchmark (python -m
benchmarks.one_map).
"""

FOR_POINTS = 4000
"""Number of samples among which the points of the radial functions are found. Source: judgement."""

JITTER = 1e-6
"""What is added to the diagonal of the radial functions' kernel. Source: rounding (its inverse)."""


@dataclass(frozen=True)
class Prior:
    """Natural logarithms of a map's hyperparameters, with scaled readings and targets; the usual
    values over many rigs, from which `fitting.learned_maps` finds each rig's own. Source: benchmark
    (python -m benchmarks.one_map).

    Args:
        readings: std of the weights of readings.
        slips: of slips.
        lags: of lags.
        radial: std of the radial part.
        log: std of the constant that each log draws anew.
        log_readings: of the weights of readings that each log draws anew.
        log_slips: of those of slips.
        noise: std of what is left.
        error_time: time for which that is correlated [s].
        reading_length: length of the radial functions over readings.
        slip_length: over slips.
        filter: share of the filter's own std.
    """

    readings: float = -0.24
    slips: float = -4.9
    lags: float = -3.6
    radial: float = -4.1
    log: float = -6.4
    log_readings: float = -6.0
    log_slips: float = -6.5
    noise: float = -5.4
    error_time: float = 0.0
    reading_length: float = 1.4
    slip_length: float = 0.4
    filter: float = -1.4


CONSTANT_STD = 3.0
"""Prior std of the constant, in stds of the target [1]. Source: judgement (it is not told)."""


LEAST_SHARE = 1e-12
"""Least factor on a prior's covariance [1]. Source: rounding (nothing of it is left)."""


@dataclass(frozen=True)
class Evidence(_OfLog):
    """One log as a joint's map sees it, thinned; only samples whose target is known.

    Args:
        phi: features, (k, n).
        doubt: half-widths of the intervals in which slips lie, (k, m).
        far: shares of the radial part's variance that nothing explains, (k,).
        target: scaled, (k,).
        filter: variances of the filter's own angle over the square of the target's scale, (k,).
        time: since the beginning of the log [s], (k,).
        given: which of them are known in use too, as in a homing move, (k,).
    """

    phi: Floats
    doubt: Floats
    far: Floats
    target: Floats
    filter: Floats
    time: Floats
    given: Bools

    @cached_property
    def spacing(self) -> float:
        """Usual time between these samples [s]."""
        return float(np.median(np.diff(self.time))) if len(self.time) > 1 else 1.0

    @cached_property
    def gram(self) -> Floats:
        """Σ φφᵀ."""
        return self.phi.T @ self.phi

    @cached_property
    def moment(self) -> Floats:
        """Σ φ y."""
        return self.phi.T @ self.target


@dataclass(frozen=True)
class Weights:
    """The weights of a joint's map with scaled targets: mean, (n,), and covariance, (n, n), in
    which a log's own part is contained.
    """

    shape: Shape
    prior: Prior
    mean: Floats
    covariance: Floats

    @classmethod
    def of(cls, shape: Shape, prior: Prior, logs: Sequence[Evidence]) -> Weights:
        """Return the weights that logs tell; without logs they are those of the prior."""
        return cls._summed(shape, prior, [_terms(shape, prior, log) for log in logs])

    @classmethod
    def without(
        cls, shape: Shape, prior: Prior, logs: Sequence[Evidence], groups: Sequence[int]
    ) -> list[Weights]:
        """Return for each log the weights that the logs of the other `groups` tell."""
        terms = list(zip(groups, [_terms(shape, prior, log) for log in logs]))
        of_group = {
            out: cls._summed(shape, prior, [term for group, term in terms if group != out])
            for out in set(groups)
        }
        return [of_group[group] for group in groups]

    @classmethod
    def _summed(cls, shape: Shape, prior: Prior, terms: Sequence[LogTerms]) -> Weights:
        shared, of_log = _variances(shape, prior)
        information = np.diag(1.0 / shared)
        score = np.zeros(len(shared))
        for of_information, of_score in terms:
            information = information + of_information
            score = score + of_score
        covariance = np.linalg.inv(information)
        covariance = (covariance + covariance.T) / 2
        mean = covariance @ score
        covariance[np.diag_indices(len(of_log))] += of_log
        return cls(shape, prior, mean, covariance)

    def given(self, log: Evidence, offset: float = 0.0) -> Weights:
        """Return the weights of a log in which some targets are known, but for one `offset` of all
        of them, whose variance is given.

        Its zero may have moved as never before: the constant has the variance more with which the
        targets are most likely, (b/a)² − 1/a if that is positive, a = 1ᵀ K⁻¹ 1 and b = 1ᵀ K⁻¹ ν for
        innovations ν of covariance K.
        """
        if not len(log.target):
            return self
        noise = _noise(self.prior, log.spacing) + self._variance_beside(log)
        residual = log.target - log.phi @ self.mean
        inner = log.phi @ self.covariance @ log.phi.T + np.diag(noise) + offset
        ones = np.linalg.solve(inner, np.ones(len(noise)))
        information = np.sum(ones)
        # the likeliest variance of this log's zero beside what other logs tell of it
        zero = max(0.0, (float(ones @ residual) / information) ** 2 - 1.0 / information)
        before = self.covariance.copy()
        before[0, 0] += zero
        cross = log.phi @ before
        gain = np.linalg.solve(inner + zero, cross).T
        covariance = before - gain @ cross
        return replace(
            self,
            mean=self.mean + gain @ residual,
            covariance=(covariance + covariance.T) / 2,
        )

    def likeliest_share(self, log: Evidence, offset: float) -> float:
        """Return the factor, at most 1, on the covariance of a prior of mean zero with which the
        targets of a log are most likely (type-II maximum likelihood; Rasmussen and Williams, 2006,
        §5.2); see `given` for the `offset`.
        """
        # loaded late: they take as long as all of distal
        from scipy.linalg import eigh
        from scipy.optimize import minimize_scalar

        if not len(log.target):
            return 0.0
        noise = _noise(self.prior, log.spacing) + self._variance_beside(log)
        values, axes = eigh(log.phi @ self.covariance @ log.phi.T, np.diag(noise) + offset)
        squares = (axes.T @ log.target) ** 2

        def cost(power: float) -> float:
            variances = 1.0 + np.exp(power) * np.maximum(values, 0.0)
            return float(np.sum(np.log(variances) + squares / variances))

        search = minimize_scalar(cost, bounds=(np.log(LEAST_SHARE), 0.0), method="bounded")
        return float(np.exp(search.x))

    def _variance_beside(self, log: Evidence) -> Floats:
        """Return the variances of radial part, slips' intervals and filter, (k,)."""
        slips = self.mean[self.shape.features["slips"]]
        return np.asarray(
            np.exp(2 * self.prior.radial) * log.far
            + (log.doubt @ np.abs(slips)) ** 2 / 3
            + np.exp(2 * self.prior.filter) * log.filter
        )

    def errors(self, log: Evidence) -> tuple[Floats, Floats]:
        """Return errors and variances on a log that they have not seen, after its `given` samples,
        (k,) each.
        """
        after = self
        later = log
        if log.given.any():
            after = self.given(log.part(log.given))
            later = log.part(~log.given)
        # an inverse with rounding errors may be indefinite by a little
        spread = np.maximum(np.sum((later.phi @ after.covariance) * later.phi, axis=1), 0.0)
        noise = np.exp(2 * self.prior.noise)
        return later.target - later.phi @ after.mean, spread + noise + after._variance_beside(later)


LogTerms: TypeAlias = tuple[Floats, Floats]
"""What a log tells of the shared weights b: its term of their information, (n, n), and that of the
score, (n,).
"""


def _terms(shape: Shape, prior: Prior, log: Evidence) -> LogTerms:
    """Return what a log tells of the shared weights, whatever those are that it draws anew."""
    _, of_log = _variances(shape, prior)
    n = len(of_log)
    noise = _noise(prior, log.spacing)
    gram, moment = log.gram / noise, log.moment / noise
    inner = gram[:, :n] @ np.linalg.inv(np.diag(1.0 / of_log) + gram[:n, :n])
    return gram - inner @ gram[:n], moment - inner @ moment[:n]


def _noise(prior: Prior, spacing: float) -> float:
    """Return the variance of what is left at samples that are `spacing` apart [s], as if they were
    independent.
    """
    return float(np.exp(2 * prior.noise) * (1 + np.exp(prior.error_time) / spacing))


def _variances(shape: Shape, prior: Prior) -> tuple[Floats, Floats]:
    """Return the prior variances of the weights, and of those that each log draws anew."""
    features = shape.features
    sizes = {name: len(np.arange(features.size)[features[name]]) for name in features.names}
    stds = [CONSTANT_STD, *np.exp([prior.readings, prior.slips, prior.lags, prior.radial])]
    shared = np.repeat(np.square(stds), list(sizes.values()))
    of_log = np.repeat(
        np.exp(2 * np.array([prior.log, prior.log_readings, prior.log_slips])),
        [sizes[name] for name in ("constant", "readings", "slips")],
    )
    return shared, of_log


Described: TypeAlias = Mapping[str, tuple[str, ...]]
"""The fields of a `LearnedMap` that say what it speaks of and reads."""


def shape_for(log: Samples, described: Described, radial: int) -> Shape:
    """Return the shape of a map with so many `radial` functions that logs like this one teach."""
    channels, angles = log.readings.shape[1], log.angles.shape[1]
    moving = [described["channels"].index(name) for name in described["positions"]]
    return Shape(channels, angles, (*moving, *range(channels, channels + angles)), radial)


def framed(shape: Shape, logs: Sequence[Samples], play: float = 1.0) -> dict[str, Floats]:
    """Return the parameters of the features by name: scales, and points where the logs are, for the
    lengths of the usual prior, with a factor `play` on the half-widths of plays.
    """
    from scipy.cluster.vq import kmeans2  # loaded late: it takes as long as all of distal

    every = np.vstack([log.every for log in logs])
    frame = empty_frame(shape)
    frame["play"] *= play
    frame["centre"] = np.nanmean(every, axis=0)
    spread = np.nanstd(every, axis=0)
    frame["scale"] = np.where(spread > 1e-9 * np.abs(frame["centre"]) + 1e-12, spread, 1.0)
    usual = Prior()
    lengths = np.exp([usual.reading_length, usual.slip_length])
    frame["lengths"] = np.repeat(lengths, [shape.count, len(shape.moving)])
    if not shape.radial:
        return frame
    flat = shape.flat(frame)
    inputs = np.vstack([features_along(shape, flat, log.time, log.every)["inputs"] for log in logs])
    step = -(-len(inputs) // FOR_POINTS)
    points = kmeans2(inputs[::step], shape.radial, minit="++", seed=1, missing="warn")[0]
    squares = np.sum((points[:, None] - points[None]) ** 2, axis=-1)
    kernel = np.exp(-0.5 * squares) + JITTER * np.eye(shape.radial)
    frame["points"] = points
    frame["root"] = np.linalg.inv(np.linalg.cholesky(kernel))
    return frame


def rates_of(logs: Sequence[Samples], scale: Floats) -> Floats:
    """Return the speed of each reading over its `scale` as a std of which the fastest motion of
    some logs is the 95 % bound [1/s].
    """
    fastest = np.zeros(len(scale))
    for log in logs:
        speeds = np.diff(log.every, axis=0) / np.diff(log.time)[:, None]
        # a wild reading goes there and back: a motion goes on for two samples
        goes_on = speeds[1:] * speeds[:-1] > 0.0
        lasting = np.where(goes_on, np.fmin(np.abs(speeds[1:]), np.abs(speeds[:-1])), 0.0)
        fastest = np.fmax(fastest, np.fmax.reduce(lasting, axis=0, initial=0.0))
    return np.asarray(fastest / scale / BAND)


def evidence_of(
    log: Samples,
    along: Mapping[str, Floats],
    joint: int,
    scale: float,
    centre: float,
    homing: float | None,
) -> Evidence:
    """Return a log as a joint's map sees it.

    Args:
        along: the parts of `features_along` on this log.
        joint: index of the joint.
        scale: of the targets.
        centre: of the targets.
        homing: length of a homing move, whose samples are known in use too [s], or None.
    """
    has_target = np.flatnonzero(np.isfinite(log.targets[:, joint]))
    # maps that begin later on a log learn from some of the same samples
    step = 1
    while len(has_target) > step * LEARNED_SAMPLES:
        step *= 2
    rows = has_target[::-1][::step][::-1]
    time = log.time[rows]
    return Evidence(
        along["features"][rows],
        along["doubt"][rows],
        along["far"][rows, 0],
        (log.targets[rows, joint] - centre) / scale,
        log.variances[rows, joint] / scale**2,
        time,
        np.zeros(len(rows), dtype=bool) if homing is None else time < homing,
    )


def from_prior(log: Samples, described: Described, offsets: Mapping[str, float]) -> LearnedMap:
    """Return the map before anything is known of its weights: those of the prior, with the scales
    of some samples of a log and of what is known of the targets in them, and without radial
    functions; see `learned_map` for what it is `described` by, and `given` for the `offsets`.

    Of an angle the prior's mean is that of the samples; of what a filter's angle lacks it is zero.
    The scale of a reading that is no position, whose zero means none, contains its mean.
    """
    shape = shape_for(log, described, 0)
    angles = shape.angles
    prior = Prior()
    frame = framed(shape, [log])
    efforts = [i for i in range(shape.channels) if i not in shape.moving]
    frame["scale"][efforts] = np.hypot(frame["scale"], frame["centre"])[efforts]
    weights = Weights.of(shape, prior, [])
    targets = [column[np.isfinite(column)] for column in log.targets.T]
    joints = len(targets)
    centres = np.array([np.mean(t) if len(t) and not angles else 0.0 for t in targets])
    squares = np.array([np.mean((t - c) ** 2) if len(t) else 0.0 for t, c in zip(targets, centres)])
    if angles:
        # of an error of the filter, the angle itself is the scale
        zeros = np.array([offsets.get(joint, 0.0) for joint in described["joints"]])
        squares = np.maximum(squares - zeros**2, 0.0) + np.var(log.angles, axis=0)
    squares = np.maximum(squares, SMALLEST_SPREAD**2)
    means = np.zeros((joints, shape.features.size))
    means[:, 0] = centres
    return map_from(
        [log],
        described,
        frame,
        0,
        mean=means,
        covariance=squares[:, None, None] * weights.covariance,
        radial=np.zeros(joints),
        noise=squares * np.exp(2 * prior.noise),
        filter=np.full(joints, float(angles > 0)),
        error_time=np.full(joints, np.exp(prior.error_time)),
        correlation=np.eye(joints),
    )


def map_from(
    logs: Sequence[Samples],
    described: Described,
    frame: Mapping[str, Floats],
    taught: int,
    **arrays: Floats,
) -> LearnedMap:
    """Return the map with some arrays that logs gave, of which so many have `taught` it; see
    `framed` for its `frame`.
    """
    every = np.vstack([log.every for log in logs])
    low, high = (tuple(end(every, axis=0).tolist()) for end in (np.nanmin, np.nanmax))
    beside_filter = logs[0].angles.shape[1] > 0
    rate = rates_of(logs, frame["scale"])
    return LearnedMap(
        **described,
        beside_filter=beside_filter,
        logs=taught,
        low=low,
        high=high,
        arrays=MapArrays(**frame, rate=rate, **arrays),
    )


def with_arrays(learned: LearnedMap, **changed: Floats) -> LearnedMap:
    """Return a map with some of its arrays `changed`, by name."""
    arrays = MapArrays(**{**learned.arrays.by_name, **changed})
    return learned.model_copy(update={"arrays": arrays})


SMALLEST_SPREAD = float(np.deg2rad(0.1))
"""Least std of an angle by which a prior is scaled [rad]. Source: rounding (of a joint at rest)."""


def from_window(
    log: Samples, described: Described, known: Bools, offsets: Mapping[str, float]
) -> LearnedMap:
    """Return the map of a log whose targets are known at some samples, where no other log taught
    any: `given` these, `from_prior`. Its band is widened until it holds the errors on each half of
    them, given the other.

    Args:
        described: see `from_prior`.
        known: mask of these samples, (k,).
        offsets: see `given`.
    """
    before = from_prior(log.part(known), described, offsets)
    after = []
    factors = []
    for weights, evidence, offset in _as_weights(before, log, known, offsets):
        if before.beside_filter:
            share = weights.likeliest_share(evidence, offset)
            weights = replace(weights, covariance=share * weights.covariance)
        early = np.arange(len(evidence.target)) < len(evidence.target) // 2
        halves = [weights.errors(replace(evidence, given=half)) for half in (early, ~early)]
        factors.append(conformal_factor(halves) ** 2)
        after.append(weights.given(evidence, offset))
    widened = [factor * of_joint.covariance for factor, of_joint in zip(factors, after)]
    return with_arrays(
        before,
        mean=np.stack([of_joint.mean for of_joint in after]),
        covariance=np.stack(widened),
        radial=np.array(factors) * before.arrays["radial"],
        noise=np.array(factors) * before.arrays["noise"],
    )


def conformal_factor(held_out: Sequence[tuple[Floats, Floats]]) -> float:
    """Return the factor on the stds with which the band holds 95 % of the errors on logs left out,
    at least 1 (split conformal prediction; Lei et al., JASA 113, 2018).

    Args:
        held_out: errors and their variances on each log.
    """
    ratios = np.concatenate([np.abs(e) / np.sqrt(v) for e, v in held_out])
    return max(1.0, float(np.quantile(ratios, COVERED)) / BAND) if len(ratios) else 1.0


def given(
    learned: LearnedMap, log: Samples, known: Bools, offsets: Mapping[str, float]
) -> LearnedMap:
    """Return the map of a log whose targets are known at some samples, such as those of a homing
    move: weights and this log's part together.

    Args:
        known: mask of these samples, (k,).
        offsets: joint → std of a constant error of what is known, 0 where it is not named.
    """
    after = [
        weights.given(evidence, offset)
        for weights, evidence, offset in _as_weights(learned, log, known, offsets)
    ]
    return with_arrays(
        learned,
        mean=np.stack([weights.mean for weights in after]),
        covariance=np.stack([weights.covariance for weights in after]),
    )


def _as_weights(
    learned: LearnedMap, log: Samples, known: Bools, offsets: Mapping[str, float]
) -> Iterator[tuple[Weights, Evidence, float]]:
    """Yield the weights of each joint of a map, with targets in SI and the factor on the band in
    them, a log as it sees it where targets are `known`, and the variance of their offset.
    """
    arrays = learned.arrays
    shape = Shape.of(learned)
    along = features_along(shape, shape.flat(arrays.by_name), log.time, log.every)
    samples = replace(log, targets=np.where(known[:, None], log.targets, np.nan))
    for j, joint in enumerate(learned.joints):
        prior = Prior(
            radial=float(np.log(arrays["radial"][j] + 1e-300) / 2),
            noise=float(np.log(arrays["noise"][j]) / 2),
            error_time=float(np.log(arrays["error_time"][j])),
            filter=float(np.log(arrays["filter"][j] + 1e-300)),
        )
        weights = Weights(shape, prior, arrays["mean"][j], arrays["covariance"][j])
        evidence = evidence_of(samples, along, j, 1.0, 0.0, None)
        yield weights, evidence, offsets.get(joint, 0.0) ** 2
