"""What some logs teach with a set of terms, its errors on logs left out, and the size of its band."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from distal.errors import FitError
from distal.estimators import channels_of
from distal.estimators.affine import NORMAL, conformal_factor, random_effects, student
from distal.estimators.discrepancy import Samples, corrected, design, homed
from distal.fitting.discrepancy_terms import Choice
from distal.rig import AffineJoint, Discrepancy, Rig

Floats = NDArray[np.float64]
Errors = list[tuple[Floats, Floats, Floats]]
"""Of each joint: errors [rad], variance of the correction, the filter's own."""

ENOUGH = 5
"""With fewer logs than this the band is widened: what changes from log to log is hardly known."""

MOST_SAMPLES = 2500
"""So many samples of a log are used, evenly taken from it."""

OWNS = (1.0, 0.5, 0.25)
"""Shares of the filter's own std that are tried: beside a band that is learned it may count twice."""

WORTH = 0.9
"""A smaller share is taken where the band comes out below this share of the wider one's."""

LEAST, LARGEST = 0.5, 30.0
"""Errors on left-out logs make the band between this much narrower and this much wider."""


def _frame(data: Sequence[Samples], rig: Rig, choice: Choice) -> Discrepancy:
    """Return a discrepancy with scales and range of some logs, its coefficients zero."""
    every = np.vstack([np.column_stack([one.readings, one.angles]) for one in data])
    channels = channels_of_rig(rig)
    m = len(channels)
    centre, spread = every.mean(axis=0), every.std(axis=0)
    scale = np.where(spread > 1e-12, spread, 1.0)
    z = (every[:, :m] - centre[:m]) / scale[:m]
    distance = np.linalg.pinv(z.T @ z / len(z), rcond=1e-6)
    reach = float(np.sqrt(np.max(np.sum(z @ distance * z, axis=1), initial=1.0)))
    lag = max(1, round(0.1 / data[0].interval))
    speeds = [
        np.mean(((e[lag:] - e[:-lag]) / (lag * one.interval)) ** 2, axis=0)
        for one in data
        for e in [np.column_stack([one.readings, one.angles])]
        if len(e) > lag
    ]
    size = len(choice.terms)
    zero = AffineJoint(joint="joint", coefficients=(0.0,) * size, covariance=((0.0,) * size,) * size, std=1.0)
    return Discrepancy(
        terms=choice.terms,
        channels=channels,
        centre=row_of(centre),
        scale=row_of(scale),
        low=row_of(every.min(axis=0)),
        high=row_of(every.max(axis=0)),
        rate=row_of(np.sqrt(np.mean(speeds, axis=0)) if speeds else np.zeros(len(centre))),
        play=choice.play,
        distance=tuple(row_of(row) for row in distance),
        reach=reach,
        correlation_time=data[0].interval,
        spread=tuple(0.0 for _ in rig.joints),
        logs=len(data),
        joints=tuple(zero.model_copy(update={"joint": joint.name}) for joint in rig.joints),
    )


def row_of(values: Floats) -> tuple[float, ...]:
    """Return an array as plain numbers.

    Args:
        values: (n,).
    """
    return tuple(float(value) for value in values)


def channels_of_rig(rig: Rig) -> tuple[str, ...]:
    """Return the names of the sensors that estimators read.

    Args:
        rig: the description.
    """

    return channels_of(rig, "discrepancy").names


def taught(data: Sequence[Samples], rig: Rig, choice: Choice) -> Discrepancy:
    """Return what some logs teach with a set of terms, its band not yet sized.

    Args:
        data: of the logs.
        rig: the description.
        choice: the terms.
    """
    made = _frame(data, rig, choice)
    designs = [_thinned(design(made, one)) for one in data]
    joints, times, spreads = [], [], []
    for j, joint in enumerate(made.joints):
        parts, squares = [], []
        for one, columns in zip(data, designs):
            left = _thinned(one.truths[:, j] - one.angles[:, j])
            there = np.isfinite(left)
            if there.sum() > len(choice.terms):
                step = one.interval * _step(len(one.time))
                parts.append((columns[there], left[there], step))
                squares.append(float(np.mean(left[there] ** 2)))
        if not parts:
            raise FitError(f"discrepancy: the angle of '{joint.joint}' is known in no log")
        found, time = random_effects(joint, range(len(choice.terms)), parts)
        if not choice.corrects:  # what the angle is off by on average is not known to come again
            square = found.covariance[0][0] + found.coefficients[0] ** 2
            found = found.model_copy(update={"coefficients": (0.0,), "covariance": ((square,),)})
        joints.append(found)
        times.append(time)
        spreads.append(float(np.sqrt(np.mean(squares))))
    return made.model_copy(update={"joints": tuple(joints), "correlation_time": max(times), "spread": tuple(spreads)})


def _step(count: int) -> int:
    return max(1, count // MOST_SAMPLES)


def _thinned(values: Floats) -> Floats:
    return values[:: _step(len(values))]


def _used(made: Discrepancy, out: Samples, homing: float | None) -> tuple[Discrepancy, NDArray[np.bool_]]:
    """Return a discrepancy as it is used on a log, and the part of the log where errors count."""
    if homing is None:
        return made, np.ones(len(out.time), dtype=bool)
    early = out.time < homing
    return homed(made, out, early)[0], ~early


def errors_of(made: Discrepancy, out: Samples, homing: float | None) -> list[tuple[Floats, Floats, Floats]]:
    """Return errors on a left-out log [rad], the variance of the correction, and the filter's own, for each joint.

    Args:
        made: what other logs teach.
        out: the log.
        homing: length of the homing move [s], or None.
    """
    used, late = _used(made, out, homing)
    errors = []
    for j in range(len(made.joints)):
        angles, variance, own = corrected(used, out, j)
        there = late & np.isfinite(out.truths[:, j])
        errors.append(((angles - out.truths[:, j])[there], variance[there], own[there]))
    return errors


def left_out_errors(
    data: Sequence[Samples], rig: Rig, folds: Sequence[int], homing: float | None, choice: Choice
) -> list[list[tuple[Floats, Floats, Floats]]]:
    """Return the errors of each log with what the logs of other folds teach.

    Args:
        data: of the logs.
        rig: the description.
        folds: of the logs.
        homing: length of the homing move [s], or None.
        choice: the terms.
    """
    errors = []
    for fold in sorted(set(folds)):
        made = taught([one for one, own in zip(data, folds) if own != fold], rig, choice)
        errors += [errors_of(made, one, homing) for one, own in zip(data, folds) if own == fold]
    return errors


def sized(data: Sequence[Samples], rig: Rig, folds: Sequence[int], homing: float | None, choice: Choice) -> Discrepancy:
    """Return what logs teach, its band sized by the errors of logs left out.

    Split conformal by log: c, the factor on what the correction does not know, is the 95 % quantile of what the errors
    need. Of `OWNS`, the shares of the filter's own doubt, that is taken with which the sized band is narrowest.

    Args:
        data: of the logs.
        rig: the description.
        folds: of the logs; those of one are left out together.
        homing: length of the homing move [s], or None.
        choice: the terms.
    """
    made, count = taught(data, rig, choice), len(set(folds))
    # what scatters between few logs is known as Student's distribution says
    wider = 1.0 if count >= ENOUGH else student(count - 1)
    if count < 2:
        return scaled(made, [1.0] * len(made.joints), wider)
    errors = left_out_errors(data, rig, folds, homing, choice)
    best, narrowest = made, float("inf")
    for own in OWNS if count >= ENOUGH else [_share_of_few(errors, wider)]:
        parts = [[(e, u, own**2 * v) for e, u, v in (log[j] for log in errors)] for j in range(len(made.joints))]
        factors = [factor_of(logs) for logs in parts]
        width = float(np.mean([np.sqrt(c**2 * u + v).mean() for c, logs in zip(factors, parts) for _, u, v in logs]))
        if width < WORTH * narrowest:
            best, narrowest = scaled(made.model_copy(update={"own": own}), factors, wider), width
    return best


def _share_of_few(errors: Sequence[Errors], wider: float) -> float:
    """Return the share of the filter's own std that the worst of few logs left out needs, times Student's factor."""
    needed = [
        np.quantile(np.abs(e) / np.sqrt(np.maximum(v, 1e-30)), 0.95) for log in errors for e, _, v in log if len(e)
    ]
    return float(min(1.0, wider * max(needed, default=1.0) / NORMAL))


def scaled(made: Discrepancy, factors: Sequence[float], wider: float = 1.0) -> Discrepancy:
    """Return a discrepancy with larger or smaller stds.

    Args:
        made: as learned.
        factors: on all stds, one for each joint.
        wider: on those of the coefficients besides.
    """
    joints = []
    for factor, joint in zip(factors, made.joints):
        covariance = tuple(tuple((factor * wider) ** 2 * value for value in row) for row in joint.covariance)
        joints.append(joint.model_copy(update={"covariance": covariance, "std": factor * joint.std}))
    return made.model_copy(update={"joints": tuple(joints)})


def factor_of(logs: Sequence[tuple[Floats, Floats, Floats]]) -> float:
    """Return the least factor c for which, all logs alike, 95 % of errors have e² ≤ 1.96² (c² u + v).

    Args:
        logs: of each left-out log (errors e [rad], u, v).
    """
    return conformal_factor(logs, LEAST, LARGEST)
