"""The one driver: an estimator, run over a whole log."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.errors import EstimationError
from distal.estimators.adaptive import AdaptiveFilter
from distal.estimators.contract import LARGEST_ANGLE, Belief, KernelEstimator
from distal.estimators.full_state import FullStateFilter
from distal.estimators.reference import check_homing, homed, with_reference
from distal.estimators.registry import DEFAULT, make_estimator
from distal.estimators.result import Estimate
from distal.logs import Log, frozen, read_log
from distal.rig import Rig, load_rig

Floats = NDArray[np.float64]


def samples_of(log: Log, channels: Sequence[str], name: str = "estimator") -> Floats:
    """Return the values of some channels of a log, (k, n_channels).

    Args:
        log: the log.
        channels: names of sensors.
        name: of the estimator, for messages.

    Raises:
        EstimationError: a channel is not in the log, has no value at all, or the log has fewer than two samples.
    """
    if len(log) < 2:
        raise EstimationError(f"{log.source}: {len(log)} sample came; an estimate over time needs at least two")
    columns = []
    for channel in channels:
        if channel not in log.channels:
            known = ", ".join(log.channels) or "none"
            raise EstimationError(
                f"{log.source}: {name} needs the sensor '{channel}', which is not in the log (it has {known})"
            )
        if not np.any(np.isfinite(log.channels[channel])):
            raise EstimationError(
                f"{log.source}: sensor '{channel}' has no value at all; remove it from the rig, or mend the log"
            )
        columns.append(log.channels[channel])
    return np.column_stack(columns)


def first_values(samples: Floats) -> Floats:
    """Return the first value of each channel that is not missing, (n_channels,)."""
    there = np.isfinite(samples)
    values: Floats = samples[there.argmax(axis=0), np.arange(samples.shape[1])]
    return values


def estimate(
    log: Any,
    rig: Rig | str | Path,
    estimator: str | KernelEstimator = DEFAULT,
    passes: int = 1,
    truth: str | Path | None = None,
    compiled: bool = True,
    homing: float | None = None,
) -> Estimate:
    """Estimate the joint angle over a log.

    Offline and online are the same calls: this is `Estimator.initial` with the first value of each channel, then
    `Estimator.step` for every sample, in one loop.

    Args:
        log: sensors over time: a `Log`, the path of a CSV or Parquet file, or a polars or pandas frame (see `read_log`).
        rig: the description, or a shipped rig's name, or a path.
        estimator: a name (see `ESTIMATORS`) or a ready one.
        passes: how often to filter; each pass starts with the last covariance of the one before, as in the 2008 paper.
        truth: where `log` is no `Log`: the true angle's column or file.
        compiled: compile kernels where possible.
        homing: for how long the truth is a reference that is used [s]; afterwards it is only compared with. Filters of
            the displacement-driven kind read it as a sensor, the others are shifted by their mean error.

    Raises:
        EstimationError: the log lacks a sensor, the estimator cannot run on this rig, or there is nothing to home by.
        LogError: the file cannot be read.
        RigError: the rig is unknown or wrong.
    """
    rig = rig if isinstance(rig, Rig) else load_rig(rig)
    if isinstance(log, Log) and truth is not None:
        raise EstimationError("truth is for logs that are read; a Log has its own (Log(…, truth={'theta': …}))")
    log = log if isinstance(log, Log) else read_log(log, rig, truth)
    if not isinstance(estimator, (str, KernelEstimator)):
        raise EstimationError(f"an estimator is a name or one from make_estimator, {estimator!r} came")
    if homing is not None:
        rig, reference = with_reference(rig, log)
        check_homing(homing, log)
    if homing is not None and estimator in HOMED:
        runner: KernelEstimator = AdaptiveFilter(
            rig, compiled, updates=HOMED[str(estimator)], name=str(estimator), reference=reference
        )
    else:
        runner = make_estimator(estimator, rig, compiled) if isinstance(estimator, str) else estimator
    if not isinstance(passes, int) or passes < 1:
        raise EstimationError(f"passes must be at least 1, {passes!r} came")
    if passes > 1 and not isinstance(runner, FullStateFilter):
        raise EstimationError(
            f"{runner.name} takes one pass; --passes is for the filters of the paper's kind (ekf-2008, ekf)"
        )
    known = log.truth.get("theta")
    if homing is not None and known is not None:
        early = log.time - log.time[0] < homing
        if estimator in HOMED:
            log = with_channel(log, reference.name, np.where(early, known, np.nan))
        known = np.where(early, np.nan, known)
    samples = samples_of(log, runner.channels, runner.name)
    belief = runner.initial(log.time[0], first_values(samples))
    for number in range(passes):
        means, covariances, innovations, variances = runner.scan(belief, log.time, samples)
        bad = out_of_bounds(means, covariances)
        if len(bad):
            row = int(bad[0])
            raise EstimationError(
                f"{log.source}: {runner.name} left all bounds at {log.time[row]:g} s; check the units of the log and "
                "the rig's stiffness and masses, or shorten stepping.largest_step"
            )
        if number < passes - 1:
            belief = with_covariance(belief, covariances[-1])
    if homing is not None and estimator not in HOMED:
        means = means.copy()
        means[:, 0] = homed(means[:, 0], log, homing)
    # the reference is no sensor of the estimate: what it told is in the states
    measured = runner.measured if homing is None or estimator not in HOMED else runner.measured[:-1]
    return Estimate(
        runner.name,
        rig.name,
        log.time,
        runner.state_names,
        frozen(means),
        frozen(covariances),
        measured,
        frozen(innovations[:, : len(measured)]),
        frozen(variances[:, : len(measured)]),
        known,
    )


HOMED = {"adaptive": 1, "iterated": 3}
"""Estimators that read a reference as a sensor, and how often they linearise an update."""


def with_channel(log: Log, name: str, values: Floats) -> Log:
    """Return the log with one more channel, or another one in its place.

    Args:
        log: the log.
        name: of the channel.
        values: SI, (k,).
    """
    return Log(log.time, {**log.channels, name: values}, log.truth, log.source, log.truth_source)


def out_of_bounds(means: Floats, covariances: Floats) -> NDArray[np.intp]:
    """Return the rows that are not finite, have a negative variance, or an angle that no joint has.

    Args:
        means: (k, n).
        covariances: (k, n, n).
    """
    spreads = np.diagonal(covariances, axis1=1, axis2=2)
    fine = np.isfinite(means).all(axis=1) & np.isfinite(covariances).all(axis=(1, 2)) & (spreads >= 0.0).all(axis=1)
    return np.flatnonzero(~(fine & (np.abs(means[:, 0]) <= LARGEST_ANGLE)))


def with_covariance(belief: Belief, covariance: Floats) -> Belief:
    """Return the belief with another covariance, (n, n)."""
    carry = np.array(belief.carry)
    carry[belief.size : belief.size + belief.size**2] = covariance.ravel()
    return Belief(belief.time, frozen(carry), belief.size, belief.samples)
