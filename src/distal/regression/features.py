"""The terms of a learned map over a log, and how far a log is outside the map's learned range.

`variables` and `columns` take CasADi symbols and arrays alike, so that the kernel and the learning
use the same formulas.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, reduce
from operator import mul
from typing import TypeVar

import casadi as ca
import numpy as np

from distal.arrays import Bools, Floats
from distal.expressions import Scalar
from distal.kernels import Feed, Kernel, advance
from distal.rig import LAGS, PLAYS, LearnedMap, factors

Value = TypeVar("Value", Floats, ca.SX)
"""The values of a term over a log, (k,), or its CasADi symbol."""

SMALLEST_HALF = 1e-12
"""Least half-width of a learned range [SI]. Source: rounding (division by a range of zero)."""


@dataclass(frozen=True)
class Samples:
    """A log as the input of a map.

    Args:
        source: name of the log.
        time: time since the first sample [s], (k,).
        readings: readings of the channels, the last one where one is missing [SI], (k, m).
        angles: the filter's angles of the joints [rad], which a map may use, (k, n_joints), or none
            of them, (k, 0).
        targets: the values to be mapped: angles [rad], errors of the filter's angles [rad], or
            external torques [N m]; NaN where not known, (k, n_joints).
        variances: variances of the filter's own angles [rad²], zero where there is no filter, (k,
            n_joints).
        interval: time between samples [s].
        reference_std: std of the random error of the targets' reference; 0 where it is not known.
        usable: which samples a homing move may use, (k,); None for all before its end.
    """

    source: str
    time: Floats
    readings: Floats
    angles: Floats
    targets: Floats
    variances: Floats
    interval: float
    reference_std: float = 0.0
    usable: Bools | None = None

    def part(self, rows: Bools) -> Samples:
        """Return the samples that a mask `rows`, (k,), holds."""
        names = ("time", "readings", "angles", "targets", "variances")
        usable = None if self.usable is None else self.usable[rows]
        return replace(self, usable=usable, **{name: getattr(self, name)[rows] for name in names})

    def window(self, homing: float) -> Bools:
        """Return which samples a homing move of length `homing` [s] may use, (k,)."""
        early: Bools = self.time < homing
        return early if self.usable is None else early & self.usable

    @property
    def every(self) -> Floats:
        """The readings and angles side by side, (k, m) or (k, m + n_joints)."""
        return np.column_stack([self.readings, self.angles])


def half_ranges(learned: LearnedMap) -> Floats:
    """Return half of the learned range of each reading and angle [SI]."""
    halves: Floats = np.maximum(
        (np.asarray(learned.high) - np.asarray(learned.low)) / 2.0, SMALLEST_HALF
    )
    return halves


def middles(learned: LearnedMap) -> Floats:
    """Return the middle of the learned range of each reading and angle [SI]."""
    middle: Floats = (np.asarray(learned.high) + np.asarray(learned.low)) / 2.0
    return middle


def limits(learned: LearnedMap) -> tuple[Floats, Floats]:
    """Return the lower and upper limits of each reading and angle [SI], between which the terms
    change with it.
    """
    half = half_ranges(learned)
    return np.asarray(learned.low) - learned.margin * half, np.asarray(
        learned.high
    ) + learned.margin * half


PASSED = 0.1
"""Half-width of the play that follows a moving reading, in halves of its range, so that noise is
no way. Source: judgement.
"""


def drawn_in(learned: LearnedMap, samples: Samples) -> Floats:
    """Return the factor s by which the distance of readings and angles from the middle of the
    learned range is shortened before they enter the terms, (k,).

    s = min(1, (1 + margin) / max_i |x_i − m_i| / h_i), where m_i is the middle and h_i half of the
    range of x_i. Outside the range the terms so keep the values of the point where the straight
    line to the middle leaves it. All readings and angles get the same factor because they depend on
    each other: limited each by its own range, they would form combinations that the logs lack,
    where large coefficients no longer cancel.
    """
    used = list(learned.used)
    if np.isinf(learned.margin) or not used:
        return np.ones(len(samples.time))
    away = np.abs(samples.every[:, : len(learned.centre)] - middles(learned)) / half_ranges(learned)
    share: Floats = np.minimum(
        1.0, (1.0 + learned.margin) / np.maximum(away[:, used].max(axis=1), 1.0)
    )
    return share


def variables(
    learned: LearnedMap,
    scaled: Sequence[Value],
    plays: Mapping[tuple[int, float], Value],
    lags: Mapping[tuple[int, float], Value],
    widths: Sequence[Scalar],
    magnitude: Callable[[Value], Value] = np.abs,
) -> dict[str, Value]:
    """Return name → value of the variables whose products are the terms, as symbols or arrays.

    Args:
        learned: the map.
        scaled: the scaled readings, then the scaled angles of the filter.
        plays: index of a channel and half-width → its scaled reading after that play operator.
        lags: index of a channel and time constant [s] → its scaled reading after that lag.
        widths: half-widths of these play operators, (m,).
        magnitude: the function |·| of such values.
    """
    m = len(learned.channels)
    values = dict[str, Value]()
    for i, name in enumerate(learned.channels):
        values[name] = scaled[i]
        values[f"abs({name})"] = magnitude(scaled[i])
        for play, ratio in PLAYS.items():
            if (i, ratio) in plays:
                values[f"{play}({name})"] = plays[i, ratio]
        for lag, constant in LAGS.items():
            if (i, constant) in lags:
                values[f"{lag}({name})"] = lags[i, constant]
        if (i, 1.0) in plays:
            values[f"slip({name})"] = (scaled[i] - plays[i, 1.0]) / widths[i]
    for joint, angle in zip(learned.joints, scaled[m:]):
        values[f"angle({joint.joint})"] = angle
    return values


def columns(terms: Sequence[str], values: Mapping[str, Value], constant: Value) -> list[Value]:
    """Return the values of the terms: products of the `constant` 1 and of `values`, which are from
    `variables`.
    """
    return [reduce(mul, (values[factor] for factor in factors(term)), constant) for term in terms]


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


@cache
def _lag() -> Kernel:
    """Return the kernel of a first-order lag, (z, (dt, x), T) → (z⁺, z⁺)."""
    z, constant = (ca.SX.sym(name) for name in ("z", "T"))
    x = ca.SX.sym("x", 2)
    after = z + (1.0 - ca.exp(-x[0] / constant)) * (x[1] - z)
    return Kernel(ca.Function("lag", [z, x, constant], [after, after]))


def lagged(values: Floats, time: Floats, constant: float) -> Floats:
    """Return readings `values` x, (k,), after a first-order lag: z⁺ = z + (1 − e^{−dt/T}) (x − z)
    with T = `constant` [s] and dt between stamps of `time` [s], (k,).
    """
    steps = np.diff(time, prepend=time[:1])
    feed = Feed(values[:1], np.column_stack([steps, values]), np.array([constant]))
    after: Floats = advance(_lag(), feed).ys[:, 0]
    return after


def design(learned: LearnedMap, samples: Samples) -> Floats:
    """Return the values of the terms over a whole log, (k, n).

    Outside the learned range the terms that are `LearnedMap.fading` fade, see `fade`. The log must
    be whole, because plays remember earlier samples.
    """
    middle = middles(learned)
    inner = middle + drawn_in(learned, samples)[:, None] * (
        samples.every[:, : len(learned.centre)] - middle
    )
    scaled = (inner - np.asarray(learned.centre)) / np.asarray(learned.scale)
    plays = {
        (i, ratio): played(scaled[:, i], ratio * learned.width[i]) for i, ratio in learned.played
    }
    lags = {
        (i, constant): lagged(scaled[:, i], samples.time, constant)
        for i, constant in learned.lagged
    }
    values = variables(learned, list(scaled.T), plays, lags, learned.width)
    phi = np.column_stack(columns(learned.terms, values, np.ones(len(scaled))))
    if np.isfinite(learned.fades_over):
        phi[:, np.flatnonzero(learned.fading)] *= fade(learned, outside(learned, samples))[:, None]
    return phi


def fade(learned: LearnedMap, far: Value) -> Value:
    """Return the weight of the terms at d = `far` outside the learned range, 1/(1 + (d/d½)²), if
    they fade; d is a number, an array or a symbol.

    d½ is `LearnedMap.fades_over`. No log constrains a curve there, and the filter alone errs less.
    Linear terms without products beside them do not fade.
    """
    return 1.0 / (1.0 + (far / learned.fades_over) ** 2)


def outside(learned: LearnedMap, samples: Samples) -> Floats:
    """Return how far the samples of a log are outside the learned range, (k,): 0 within, 1 at half
    a range beyond its end.

    It is the larger of two excesses: the largest of a single reading or angle, and that of the
    Mahalanobis distance, which also detects new combinations.
    """
    every = samples.every[:, : len(learned.centre)]
    beyond = np.maximum(
        np.asarray(learned.low) - every, every - np.asarray(learned.high)
    ) / half_ranges(learned)
    far = np.sqrt(np.maximum(squared_distances(learned, samples), 0.0)) / learned.reach - 1.0
    excess: Floats = np.maximum(0.0, np.maximum(beyond.max(axis=1), far))
    return excess


def squared_distances(learned: LearnedMap, samples: Samples) -> Floats:
    """Return the squared Mahalanobis distance of each sample's readings from the mean of the
    readings that the map was learned from, (k,).
    """
    m = len(learned.channels)
    z = (samples.readings - np.asarray(learned.centre)[:m]) / np.asarray(learned.scale)[:m]
    squared: Floats = np.sum(z @ np.asarray(learned.distance) * z, axis=1)
    return squared


@cache
def _fading() -> Kernel:
    """Return the kernel of what fades along a way, (z, (d, way)) → (z⁺, z⁺)."""
    z = ca.SX.sym("z")
    x = ca.SX.sym("x", 2)
    after = ca.fmax(x[0], z * ca.exp(-x[1]))
    return Kernel(ca.Function("fading", [z, x, ca.SX.sym("none", 0)], [after, after]))


def remembered(learned: LearnedMap, samples: Samples) -> Floats:
    """Return how far readings were outside the learned range, as friction remembers it, (k,):
    z⁺ = max(d, z e^{−s}).

    d is from `outside`. The way s is the longest among the readings `LearnedMap.moves`, in whole
    learned ranges: within the range, and at most at the speed `LearnedMap.rate`, since only slow
    motion brings back the friction that the logs know (docs/results/from-logs.md).
    """
    steps = np.diff(samples.time, prepend=samples.time[:1])
    way = np.zeros(len(steps))
    for name in learned.moves:
        i = learned.channels.index(name)
        half = half_ranges(learned)[i]
        inner = np.clip(samples.readings[:, i], learned.low[i], learned.high[i])
        moved = np.abs(np.diff(played(inner, PASSED * half), prepend=inner[:1]))
        way = np.maximum(way, np.minimum(moved, learned.rate[i] * steps) / (2.0 * half))
    inputs = np.column_stack([outside(learned, samples), way])
    after: Floats = advance(_fading(), Feed(np.zeros(1), inputs, np.zeros(0))).ys[:, 0]
    return after


def beyond_homing(learned: LearnedMap, samples: Samples, joint: int, values: Floats) -> Floats:
    """Return how far the corrected angle of a joint is beyond the range that a homing move covered
    [rad], (k,).

    It is 0 for a map that was not updated by a homing move. The map's `values`, (k,), are added to
    the filter's own angle where the map uses that.
    """
    if not learned.homed:
        return np.zeros(len(samples.time))
    low, high = learned.homed[joint]
    angles = values + (samples.angles[:, joint] if learned.uses_angles else 0.0)
    beyond: Floats = np.maximum(0.0, np.maximum(low - angles, angles - high))
    return beyond


def own_slope(learned: LearnedMap, samples: Samples, joint: int) -> Floats:
    """Return the slope of a map over the filter's own angle of a joint, ∂(map)/∂θ, along a log,
    (k,).

    It is 0 where the angle is beyond its `limits`.
    """
    name = f"angle({learned.joints[joint].joint})"
    column = len(learned.channels) + joint
    if name not in learned.terms:
        return np.zeros(len(samples.time))
    term = learned.terms.index(name)
    low, high = (limit[column] for limit in limits(learned))
    angles = samples.angles[:, joint]
    slope = learned.joints[joint].coefficients[term] / learned.scale[column]
    follows = np.where((angles > low) & (angles < high), drawn_in(learned, samples), 0.0)
    shown: Floats = follows * slope
    return shown * fade(learned, outside(learned, samples)) if learned.fading[term] else shown


@dataclass(frozen=True)
class Predicted:
    """The values of a map for one joint over a log, the variances of the map, and the share of the
    filter's own variances that counts beside them, (k,) each.
    """

    values: Floats
    variances: Floats
    filter_variances: Floats


def predict(learned: LearnedMap, samples: Samples, joint: int = 0) -> Predicted:
    """Return a map's values for a joint over a log, φᵀ b, and their variances, c² (g² φᵀ C φ + s²)
    + d² (s² + spread²) + (z r)² + (κ h)².

    g is `LearnedMap.between`, d is from `outside`, z from `remembered`, r is `LearnedMap.stays`, h
    is from `beyond_homing`, and κ is `LearnedMap.extrapolation`. Of the filter's own variance,
    own² (1 + ∂(map)/∂θ)² counts beside them.
    """
    fit = learned.joints[joint]
    phi = design(learned, samples)
    far = outside(learned, samples)
    values = phi @ np.asarray(fit.coefficients)
    leverage = learned.between**2 * np.sum(phi @ np.asarray(fit.covariance) * phi, axis=1)
    beyond = far**2 * (fit.std**2 + learned.spread[joint] ** 2)
    if learned.stays:
        beyond = beyond + (remembered(learned, samples) * learned.stays[joint]) ** 2
    if learned.extrapolation:
        beyond = (
            beyond
            + (learned.extrapolation[joint] * beyond_homing(learned, samples, joint, values)) ** 2
        )
    weight = learned.own * (1.0 + own_slope(learned, samples, joint))
    variances = learned.band[joint] ** 2 * (leverage + fit.std**2) + beyond
    return Predicted(values, variances, weight**2 * samples.variances[:, joint])
