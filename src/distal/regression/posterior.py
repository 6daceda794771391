"""What logs tell of a map's weights, by Bayes' rule.

y = φᵀ b + φ₀ᵀ b_l + e: the weights b ~ N(0, P) are shared by all logs, b_l ~ N(0, Ω), of the
constant, the readings and the slips, is drawn anew by each log, and e ~ N(0, σ²). Each posterior is
a solve with sums over logs of φφᵀ, so that leaving a log out is leaving a term out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from distal.arrays import Bools, Floats
from distal.confidence import BAND
from distal.regression.features import Shape, empty_frame, features_along
from distal.regression.samples import Samples

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
    values over many rigs, from which `fitting.map_search` finds each rig's own.

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
class Evidence:
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

    def rows(self, rows: Bools) -> Evidence:
        """Return the samples in a mask."""
        names = ("phi", "doubt", "far", "target", "filter", "time", "given")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


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
        shared, of_log = _variances(shape, prior)
        n = len(of_log)
        information = np.diag(1.0 / shared)
        score = np.zeros(len(shared))
        for log in logs:
            noise = _noise(prior, log.spacing)
            gram, moment = log.gram / noise, log.moment / noise
            inner = np.linalg.inv(np.diag(1.0 / of_log) + gram[:n, :n])
            information = information + gram - gram[:, :n] @ inner @ gram[:n]
            score = score + moment - gram[:, :n] @ (inner @ moment[:n])
        covariance = np.linalg.inv(information)
        covariance = (covariance + covariance.T) / 2
        mean = covariance @ score
        covariance[np.arange(n), np.arange(n)] += of_log
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
        after = self.given(log.rows(log.given)) if log.given.any() else self
        later = log.rows(~log.given)
        # an inverse with rounding errors may be indefinite by a little
        spread = np.maximum(np.sum((later.phi @ after.covariance) * later.phi, axis=1), 0.0)
        noise = np.exp(2 * self.prior.noise)
        return later.target - later.phi @ after.mean, spread + noise + after._variance_beside(later)


def _noise(prior: Prior, spacing: float) -> float:
    """Return the variance of what is left at samples that are `spacing` apart [s], as if they were
    independent.
    """
    return float(np.exp(2 * prior.noise) * (1 + np.exp(prior.error_time) / spacing))


def _variances(shape: Shape, prior: Prior) -> tuple[Floats, Floats]:
    """Return the prior variances of the weights, and of those that each log draws anew."""
    sizes = {
        name: np.ravel(shape.features.view(np.arange(shape.features.size), name)).size
        for name in shape.features.names
    }
    stds = [CONSTANT_STD, *np.exp([prior.readings, prior.slips, prior.lags, prior.radial])]
    shared = np.repeat(np.square(stds), list(sizes.values()))
    of_log = np.repeat(
        np.exp(2 * np.array([prior.log, prior.log_readings, prior.log_slips])),
        [sizes[name] for name in ("constant", "readings", "slips")],
    )
    return shared, of_log


def shape_for(log: Samples, described: Mapping[str, tuple[str, ...]], radial: int) -> Shape:
    """Return the shape of a map with so many `radial` functions that logs like this one teach.

    Args:
        described: the fields of the `LearnedMap` that say which of its channels are positions.
    """
    channels, angles = log.readings.shape[1], log.angles.shape[1]
    moving = [described["channels"].index(name) for name in described["positions"]]
    return Shape(channels, angles, (*moving, *range(channels, channels + angles)), radial)


def framed(shape: Shape, logs: Sequence[Samples], usual: Prior) -> dict[str, Floats]:
    """Return the parameters of the features by name: scales, and points where the logs are, for
    the lengths of the `usual` prior.
    """
    from scipy.cluster.vq import kmeans2  # loaded late: it takes as long as all of distal

    every = np.vstack([log.every for log in logs])
    frame = empty_frame(shape)
    frame["centre"] = np.nanmean(every, axis=0)
    spread = np.nanstd(every, axis=0)
    frame["scale"] = np.where(spread > 1e-9 * np.abs(frame["centre"]) + 1e-12, spread, 1.0)
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
        speeds = np.abs(np.diff(log.every, axis=0)) / np.diff(log.time)[:, None]
        fastest = np.fmax(fastest, np.fmax.reduce(speeds, axis=0, initial=0.0))
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
