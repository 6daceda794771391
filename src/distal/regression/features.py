"""The terms of a learned map over a log, and how far a log is outside the range that it was learned
in.

`variables` and `columns` build terms of symbols and of arrays alike, so that kernel and learning
have one form.
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
from distal.rig import CONSTANT, LearnedMap, factors

Value = TypeVar("Value", Floats, ca.SX)
"""Values of a term over a log, (k,), or its symbol."""

SMALLEST_HALF = 1e-12
"""Half of a learned range is not taken as smaller than this [SI]."""


@dataclass(frozen=True)
class Samples:
    """A log as input of a map.

    Args:
        time: since its first sample [s], (k,).
        readings: of the channels, missing ones held, (k, m).
        angles: of the joints by the filter, which a map may use, (k, n_joints), or none of them,
            (k, 0) [rad].
        targets: what is mapped: angles, errors of the filter's angles, or torques, NaN where not
            known, (k, n_joints).
        variances: of the filter's own angles, zero where there is no filter, (k, n_joints).
        interval: between samples [s].
        reference_std: std of the error of the targets' reference; 0 where that is not known.
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
        """Return some of the samples, by a mask of `rows`, (k,)."""
        names = ("time", "readings", "angles", "targets", "variances")
        usable = None if self.usable is None else self.usable[rows]
        return replace(self, usable=usable, **{name: getattr(self, name)[rows] for name in names})

    def window(self, homing: float) -> Bools:
        """Return which samples a homing move of so long [s] may use, (k,)."""
        early: Bools = self.time < homing
        return early if self.usable is None else early & self.usable

    @property
    def every(self) -> Floats:
        """Readings and angles, (k, m) or (k, m + n_joints)."""
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
    """Return the limits within which the terms follow each reading and angle [SI]."""
    half = half_ranges(learned)
    return np.asarray(learned.low) - learned.margin * half, np.asarray(
        learned.high
    ) + learned.margin * half


def drawn_in(learned: LearnedMap, samples: Samples) -> Floats:
    """Return the share s of their way from the middle of the range at which readings and angles
    enter the terms, (k,).

    s = min(1, (1 + MARGIN) / max_i |x_i − m_i| / h_i) with m_i in the middle of a range of
    half-length h_i: the terms stay as they are where the straight line to the middle leaves the
    range. Readings and angles depend on each other; were each held at the end of its own range,
    large coefficients that cancel inside would no longer do so outside.
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
    plays: Mapping[int, Value],
    widths: Sequence[Scalar],
    magnitude: Callable[[Value], Value] = np.abs,
) -> dict[str, Value]:
    """Return name → value of what terms are products of: numbers, symbols or arrays, of which
    `magnitude` is |·|.

    They are made of `scaled` readings, then angles by the filter, and of `plays`, by the index of
    the channel whose scaled reading has gone through it, with half-widths `widths`, (m,).
    """
    m = len(learned.channels)
    values = dict[str, Value]()
    for i, name in enumerate(learned.channels):
        values[name] = scaled[i]
        values[f"abs({name})"] = magnitude(scaled[i])
        if i in plays:
            values[f"play({name})"] = plays[i]
            values[f"slip({name})"] = (scaled[i] - plays[i]) / widths[i]
    for joint, angle in zip(learned.joints, scaled[m:]):
        values[f"angle({joint.joint})"] = angle
    return values


def columns(terms: Sequence[str], values: Mapping[str, Value], constant: Value) -> list[Value]:
    """Return the terms' values, products of the `constant` 1 and of `values` from `variables`."""
    return [reduce(mul, (values[factor] for factor in factors(term)), constant) for term in terms]


@cache
def _play() -> Kernel:
    """Return (z, x, w) → z⁺, twice: what the play passes on is its memory."""
    z, x, w = (ca.SX.sym(name) for name in ("z", "x", "w"))
    after = ca.fmin(ca.fmax(z, x - w), x + w)
    return Kernel(ca.Function("play", [z, x, w], [after, after]))


def played(values: Floats, half: float) -> Floats:
    """Return readings `values` x, (k,), after a play of a half-width w: z⁺ = min(max(z, x − w), x +
    w).

    Noise below w = `half` does not change it, a rest keeps it, and it does not depend on the rate
    (Visintin, 1994, ch. III).
    """
    after: Floats = advance(_play(), Feed(values[:1], values[:, None], np.array([half]))).ys[:, 0]
    return after


def design(learned: LearnedMap, samples: Samples) -> Floats:
    """Return the terms over a whole log (plays remember), all but the constant faded outside the
    learned range, (k, n).
    """
    middle = middles(learned)
    inner = middle + drawn_in(learned, samples)[:, None] * (
        samples.every[:, : len(learned.centre)] - middle
    )
    scaled = (inner - np.asarray(learned.centre)) / np.asarray(learned.scale)
    plays = {i: played(scaled[:, i], learned.width[i]) for i in learned.played}
    values = variables(learned, list(scaled.T), plays, learned.width)
    phi = np.column_stack(columns(learned.terms, values, np.ones(len(scaled))))
    if np.isfinite(learned.fades_over):
        fading = np.array([term != CONSTANT for term in learned.terms])
        phi[:, fading] *= fade(learned, outside(learned, samples))[:, None]
    return phi


def fade(learned: LearnedMap, far: Value) -> Value:
    """Return the weight of the terms at d = `far` outside the learned range, 1 / (1 + (d / d½)²):
    numbers or symbols.

    Nothing constrains a curve where there are no logs, and there the filter alone errs less. Lines
    do not fade.
    """
    return 1.0 / (1.0 + (far / learned.fades_over) ** 2)


def outside(learned: LearnedMap, samples: Samples) -> Floats:
    """Return how far a log is outside the learned range, 0 within; 1 is half a range beyond its
    end, (k,).

    It is the larger of a single reading's excess and that of the Mahalanobis distance, which
    detects new combinations.
    """
    every = samples.every[:, : len(learned.centre)]
    beyond = np.maximum(
        np.asarray(learned.low) - every, every - np.asarray(learned.high)
    ) / half_ranges(learned)
    far = np.sqrt(np.maximum(squared_distances(learned, samples), 0.0)) / learned.reach - 1.0
    excess: Floats = np.maximum(0.0, np.maximum(beyond.max(axis=1), far))
    return excess


def squared_distances(learned: LearnedMap, samples: Samples) -> Floats:
    """Return the squared Mahalanobis distances of readings from the middle of those that were
    learned from, (k,).
    """
    m = len(learned.channels)
    z = (samples.readings - np.asarray(learned.centre)[:m]) / np.asarray(learned.scale)[:m]
    squared: Floats = np.sum(z @ np.asarray(learned.distance) * z, axis=1)
    return squared


def beyond_homing(learned: LearnedMap, samples: Samples, joint: int, values: Floats) -> Floats:
    """Return how far the corrected angle of a joint is beyond what a homing move covered [rad],
    (k,).

    Before the move nothing is beyond. The map's `values`, (k,), are added to the filter's own
    angle.
    """
    if not learned.homed:
        return np.zeros(len(samples.time))
    (low, high), angles = (
        learned.homed[joint],
        values + (samples.angles[:, joint] if learned.uses_angles else 0.0),
    )
    beyond: Floats = np.maximum(0.0, np.maximum(low - angles, angles - high))
    return beyond


def own_slope(learned: LearnedMap, samples: Samples, joint: int) -> Floats:
    """Return the slope of a map over the filter's own angle of a joint, ∂(map)/∂θ, over a log,
    (k,); 0 where it is held.
    """
    name = f"angle({learned.joints[joint].joint})"
    column = len(learned.channels) + joint
    if name not in learned.terms:
        return np.zeros(len(samples.time))
    low, high = (limit[column] for limit in limits(learned))
    angles = samples.angles[:, joint]
    slope = learned.joints[joint].coefficients[learned.terms.index(name)] / learned.scale[column]
    follows = np.where((angles > low) & (angles < high), drawn_in(learned, samples), 0.0)
    shown: Floats = follows * slope * fade(learned, outside(learned, samples))
    return shown


@dataclass(frozen=True)
class Predicted:
    """The values of a map over a log and their variances, and the part of the filter's own that
    counts, (k,) each.
    """

    values: Floats
    variances: Floats
    filter_variances: Floats


def predict(learned: LearnedMap, samples: Samples, joint: int = 0) -> Predicted:
    """Return a map's value for a joint over a log, φᵀ b, and its variance c² (φᵀ C φ + s²) + d² (s²
    + spread²) + (κ h)².

    d is from `outside`, h from `beyond_homing`, κ is `LearnedMap.extrapolation`; of the filter's
    own variance own² (1 + ∂(map)/∂θ)² counts.
    """
    fit = learned.joints[joint]
    phi = design(learned, samples)
    far = outside(learned, samples)
    values = phi @ np.asarray(fit.coefficients)
    leverage = np.sum(phi @ np.asarray(fit.covariance) * phi, axis=1)
    beyond = far**2 * (fit.std**2 + learned.spread[joint] ** 2)
    if learned.extrapolation:
        beyond = (
            beyond
            + (learned.extrapolation[joint] * beyond_homing(learned, samples, joint, values)) ** 2
        )
    weight = learned.own * (1.0 + own_slope(learned, samples, joint))
    variances = learned.band[joint] ** 2 * (leverage + fit.std**2) + beyond
    return Predicted(values, variances, weight**2 * samples.variances[:, joint])
