"""Homing of a filter: while the angle is known, the filter reads it, and its maps are conditioned
on what it lacks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from distal.arrays import Bools, Floats
from distal.estimators import (
    LARGEST_ANGLE,
    AdaptiveFilter,
    Belief,
    channels_of,
    of_part,
    offsets_of,
    parts_of,
)
from distal.homing.reference import TRUTH_NOISE
from distal.kernels import covariance_of, mean_of, variances_of
from distal.logs import Log, frozen
from distal.parallel import one_blas_thread
from distal.regression import Samples, from_prior, from_window, given
from distal.rig import LearnedMap, Rig


@dataclass(frozen=True)
class Homed:
    """A run after its homing move.

    Args:
        estimator: the filter with the maps of this run.
        start: its first belief.
        samples: values of its channels, (k, n_channels).
    """

    estimator: AdaptiveFilter
    start: Belief
    samples: Floats


@one_blas_thread()
def home(
    estimator: AdaptiveFilter,
    start: Belief,
    log: Log,
    samples: Floats,
    truths: Floats,
    homing: float,
) -> Homed:
    """Return filter, first belief and samples of a run, adapted by its homing move.

    The run itself reads no reference. Where no log has taught a map, the filter first reads the
    reference in the window, and the run begins with the parameters that it then has, if it stays
    bounded with them. What its angle lacks in the window conditions the maps.

    Args:
        estimator: the filter, whose channels contain the reference, with maps (see
            `with_prior_maps`).
        start: its belief before the first sample.
        log: the whole run.
        samples: values of its channels, with the reference only in the window, (k, n_channels).
        truths: true angles [rad], NaN where not known, (k, n_joints).
        homing: length of the window [s].
    """
    early = log.time - log.time[0] < homing
    unaided = samples.copy()
    unaided[:, len(estimator.positions) :] = np.nan
    offsets = offsets_of(log, estimator.rig)
    begun = start
    if not all(learned.logs for learned in estimator.maps.filter):
        start = _anchored(start, truths[early], estimator.rig.joint_names, offsets)
        begun = _with_parameters(estimator, start, log.time[early], samples[early])
    plain = plain_samples(estimator, begun, log, unaided, truths)
    if not _is_bounded(plain):
        begun = start
        plain = plain_samples(estimator, start, log, unaided, truths)
    if not _is_bounded(plain):
        return Homed(estimator, start, unaided)
    names = estimator.channels[: len(estimator.positions)]

    def conditioned(maps: Sequence[LearnedMap], of: Samples) -> tuple[LearnedMap, ...]:
        parts = [
            of_part(of, estimator.rig, names, learned.joints, learned.channels) for learned in maps
        ]
        return tuple(
            _conditioned(learned, part, early, offsets) for learned, part in zip(maps, parts)
        )

    changed = {"filter": conditioned(estimator.maps.filter, plain)}
    of_angles = samples_of_readings(log, samples[:, : len(names)], truths)
    changed["readings"] = conditioned(estimator.maps.readings, of_angles)
    homed = estimator.with_maps(estimator.maps.model_copy(update=changed))
    return Homed(homed, begun, unaided)


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
        maps.append(from_prior(Samples("", np.arange(2.0), rest, none, none, none), part, {}))
    return rig.with_map(filter=maps)


def _is_bounded(samples: Samples) -> bool:
    """Return whether the filter's angles are bounded all along."""
    return bool(np.all(np.abs(samples.angles) <= LARGEST_ANGLE))  # NaN is not below it either


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
    return Samples(log.source, since, np.column_stack(readings), angles, truths - angles, variances)


def samples_of_readings(log: Log, readings: Floats, targets: Floats) -> Samples:
    """Return the samples of a map on readings alone over a log.

    Args:
        log: with its stamps.
        readings: of the sensors, NaN where missing, (k, m).
        targets: true angles, NaN where not known, (k, n_joints).
    """
    none = np.zeros((len(log), 0))
    since = log.time - log.time[0]
    return Samples(log.source, since, readings, none, targets, np.zeros(targets.shape))
