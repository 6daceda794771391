"""Learned maps of a log in which targets are known for a while, such as in a homing move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from distal.arrays import Bools, Floats
from distal.confidence import BAND, COVERED
from distal.regression.features import Shape, features_along
from distal.regression.posterior import (
    Evidence,
    Prior,
    Weights,
    evidence_of,
    framed,
    rates_of,
    shape_for,
)
from distal.regression.samples import Samples
from distal.rig import LearnedMap, MapArrays


def from_prior(
    log: Samples, described: Mapping[str, tuple[str, ...]], offsets: Mapping[str, float]
) -> LearnedMap:
    """Return the map before anything is known of its weights: those of the prior, with the scales
    of some samples of a log and of what is known of the targets in them, and without radial
    functions; see `learned_map` for what it is `described` by, and `given` for the `offsets`.

    Of an angle the prior's mean is that of the samples; of what a filter's angle lacks it is zero.
    The scale of a reading that is no position, whose zero means none, contains its mean.
    """
    shape = shape_for(log, described, 0)
    angles = shape.angles
    prior = Prior()
    frame = framed(shape, [log], prior)
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
    fields = {
        **described,
        "beside_filter": angles > 0,
        "logs": 0,
        "low": tuple(np.nanmin(log.every, axis=0).tolist()),
        "high": tuple(np.nanmax(log.every, axis=0).tolist()),
    }
    return LearnedMap(
        **fields,
        arrays=MapArrays(
            **frame,
            rate=rates_of([log], frame["scale"]),
            mean=means,
            covariance=squares[:, None, None] * weights.covariance,
            radial=np.zeros(joints),
            noise=squares * np.exp(2 * prior.noise),
            filter=np.full(joints, float(angles > 0)),
            error_time=np.full(joints, np.exp(prior.error_time)),
            correlation=np.eye(joints),
        ),
    )


SMALLEST_SPREAD = float(np.deg2rad(0.1))
"""Least std of an angle by which a prior is scaled [rad]. Source: rounding (of a joint at rest)."""


def from_window(
    log: Samples,
    described: Mapping[str, tuple[str, ...]],
    known: Bools,
    offsets: Mapping[str, float],
) -> LearnedMap:
    """Return the map of a log whose targets are known at some samples, where no other log taught
    any: `given` these, `from_prior`. Its band is widened until it holds the errors on each half of
    them, given the other.

    Args:
        described: see `from_prior`.
        known: mask of these samples, (k,).
        offsets: see `given`.
    """
    samples = replace(log, targets=np.where(known[:, None], log.targets, np.nan))
    before = from_prior(log.part(known), described, offsets)
    after = []
    factors = []
    for joint, (weights, evidence) in zip(before.joints, _as_weights(before, samples)):
        offset = offsets.get(joint, 0.0) ** 2
        if before.beside_filter:
            share = weights.likeliest_share(evidence, offset)
            weights = replace(weights, covariance=share * weights.covariance)
        early = np.arange(len(evidence.target)) < len(evidence.target) // 2
        halves = [weights.errors(replace(evidence, given=half)) for half in (early, ~early)]
        factors.append(conformal_factor(halves) ** 2)
        after.append(weights.given(evidence, offset))
    arrays = dict(_with_weights(before, after).arrays.by_name)
    for name in ("covariance", "radial", "noise"):
        arrays[name] = np.stack([f * array for f, array in zip(factors, arrays[name])])
    return before.model_copy(update={"arrays": MapArrays(**arrays)})


def _with_weights(learned: LearnedMap, weights: Sequence[Weights]) -> LearnedMap:
    """Return a map with other weights of each joint."""
    arrays = {
        **learned.arrays.by_name,
        "mean": np.stack([of_joint.mean for of_joint in weights]),
        "covariance": np.stack([of_joint.covariance for of_joint in weights]),
    }
    return learned.model_copy(update={"arrays": MapArrays(**arrays)})


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
    samples = replace(log, targets=np.where(known[:, None], log.targets, np.nan))
    after = [
        weights.given(evidence, offsets.get(joint, 0.0) ** 2)
        for joint, (weights, evidence) in zip(learned.joints, _as_weights(learned, samples))
    ]
    return _with_weights(learned, after)


def _as_weights(learned: LearnedMap, log: Samples) -> list[tuple[Weights, Evidence]]:
    """Return the weights of each joint of a map, with targets in SI and the factor on the band in
    them, and a log as it sees it.
    """
    arrays = learned.arrays
    shape = Shape.of(learned)
    along = features_along(shape, shape.flat(arrays.by_name), log.time, log.every)
    pairs = []
    for j in range(len(learned.joints)):
        prior = Prior(
            radial=float(np.log(arrays["radial"][j] + 1e-300) / 2),
            noise=float(np.log(arrays["noise"][j]) / 2),
            error_time=float(np.log(arrays["error_time"][j])),
            filter=float(np.log(arrays["filter"][j] + 1e-300)),
        )
        weights = Weights(shape, prior, arrays["mean"][j], arrays["covariance"][j])
        pairs.append((weights, evidence_of(log, along, j, 1.0, 0.0, None)))
    return pairs
