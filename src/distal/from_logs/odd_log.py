"""A log that is not like the others: swapped or mirrored columns, another unit, another rig.

All drives are regressed on all joints (`structure`). Where one log is left out and the others then
agree far better, that log is odd. What is tried on it says why: the change that makes it like the
others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import pi

import numpy as np

from distal.arrays import Floats
from distal.from_logs.motion_data import MotionData

ODD = 3.0
"""Ratio of the residuals with a log and without it, from which on it is odd [1]. Source:
judgement.
"""

LIKE_OTHERS = 2.5
"""Ratio of a changed log's residual to the others', up to which the change explains it [1].
Source: judgement.
"""

OF_ANOTHER_RIG = 0.1
"""Residual of a log by the others, per RMS of a drive's motion, from which on nothing is learned
from it [1]. Source: judgement (moment arms that differ by a tenth).
"""

FACTORS = {
    180.0 / pi: "in degrees, where the others are in radians",
    pi / 180.0: "in radians, where the others are in degrees",
    1000.0: "a thousand times as large as in the others",
    0.001: "a thousandth of what it is in the others",
}
"""Factor of a column → what it says. Source: definition (units)."""

FEWEST_LOGS = 2
"""With fewer logs beside it nobody knows which of them is odd. Source: definition."""


@dataclass(frozen=True)
class _Change:
    """A change of a log that might explain it, in words, and the log after it."""

    text: str
    log: MotionData


@dataclass(frozen=True)
class OddLog:
    """A log that is not like the others: a sentence on it, and whether a rig must not be learned
    from all of them.
    """

    text: str
    stops: bool


def odd_log(
    logs: Sequence[MotionData], drives: Sequence[str], joints: Sequence[str]
) -> OddLog | None:
    """Return the log that is not like the others, None where all are alike.

    Args:
        logs: with known angles.
        drives: names of the columns of the drives' positions.
        joints: those of the joints' references.
    """
    usable = [log for log in logs if np.isfinite(log.angles).all(axis=1).sum() > 1]
    if len(usable) <= FEWEST_LOGS:
        return None
    together = _residual(usable, usable)
    alone = []
    for k in range(len(usable)):
        unsuspected = [log for i, log in enumerate(usable) if i != k]
        alone.append(_residual(unsuspected, unsuspected))
    worst = int(np.argmin(np.max(np.array(alone), axis=1)))
    if float(np.max(together / np.maximum(alone[worst], 1e-12))) < ODD:
        return None
    unsuspected = [log for i, log in enumerate(usable) if i != worst]
    for change in _changes(usable[worst], drives, joints):
        if np.all(
            _residual(unsuspected, [change.log]) < LIKE_OTHERS * np.maximum(alone[worst], 1e-12)
        ):
            return OddLog(f"{usable[worst].source}: {change.text}; correct the file", True)
    unlike = float(np.max(_residual(unsuspected, [usable[worst]])))
    if unlike < OF_ANOTHER_RIG:
        return OddLog(
            f"{usable[worst].source} differs from the other logs by {100 * unlike:.0f} % of a "
            "drive's motion: slack, a load, or a changed tendon",
            False,
        )
    return OddLog(
        f"{usable[worst].source} does not agree with the other logs: is it of another rig, or was "
        "a tendon changed? Leave it out",
        True,
    )


def _columns(log: MotionData, drive: int) -> tuple[Floats, Floats]:
    """Return the columns of a drive's regression and the drive, each about its mean."""
    usable = np.isfinite(log.angles).all(axis=1)
    columns = [log.angles[usable], log.directions[usable, drive][:, None]]
    effort = log.efforts[usable, drive]
    if np.isfinite(effort).all():
        columns.append(effort[:, None])
    matrix = np.column_stack(columns)
    target = log.positions[usable, drive]
    return matrix - matrix.mean(axis=0), target - target.mean()


def _residual(training: Sequence[MotionData], tested: Sequence[MotionData]) -> Floats:
    """Return the RMS residual of each drive per RMS of its motion in the training logs."""
    residuals = []
    for drive in range(training[0].positions.shape[1]):
        parts = [_columns(log, drive) for log in training]
        matrix = np.vstack([columns for columns, _ in parts])
        target = np.concatenate([values for _, values in parts])
        size = np.maximum(np.sqrt(np.mean(matrix**2, axis=0)), 1e-300)
        coefficients = np.linalg.lstsq(matrix / size, target, rcond=1e-6)[0] / size
        errors = [
            values - columns @ coefficients
            for columns, values in (_columns(log, drive) for log in tested)
        ]
        scale = max(float(np.std(target)), 1e-300)
        residuals.append(np.sqrt(np.mean(np.concatenate(errors) ** 2)) / scale)
    return np.array(residuals)


def _changes(log: MotionData, drives: Sequence[str], joints: Sequence[str]) -> Iterator[_Change]:
    """Yield what may be wrong with a log, the simplest first."""
    for d, name in enumerate(drives):
        if np.ptp(log.positions[:, d]) == 0.0:
            yield _Change(f"{name} never changes", log)
    for d, name in enumerate(drives):
        yield _Change(f"{name} counts the other way than in the others", _drive(log, d, -1.0))
    for j, name in enumerate(joints):
        yield _Change(f"{name} counts the other way than in the others", _joint(log, j, -1.0))
    for a, b in combinations(range(len(drives)), 2):
        order = _swapped(len(drives), a, b)
        yield _Change(
            f"{drives[a]} and {drives[b]} are swapped",
            replace(log, positions=log.positions[:, order], directions=log.directions[:, order]),
        )
        yield _Change(
            f"all columns of {drives[a]} and {drives[b]} are swapped",
            replace(
                log,
                positions=log.positions[:, order],
                directions=log.directions[:, order],
                efforts=log.efforts[:, order],
            ),
        )
        yield _Change(
            f"the forces beside {drives[a]} and {drives[b]} are swapped",
            replace(log, efforts=log.efforts[:, order]),
        )
    for a, b in combinations(range(len(joints)), 2):
        order = _swapped(len(joints), a, b)
        yield _Change(
            f"{joints[a]} and {joints[b]} are swapped", replace(log, angles=log.angles[:, order])
        )
    for factor, text in FACTORS.items():
        yield _Change(f"{', '.join(joints)}: {text}", replace(log, angles=log.angles / factor))
        for j, name in enumerate(joints):
            yield _Change(f"{name} is {text}", _joint(log, j, 1.0 / factor))
        for d, name in enumerate(drives):
            yield _Change(f"{name} is {text}", _drive(log, d, 1.0 / factor))


def _swapped(n: int, a: int, b: int) -> list[int]:
    order = list(range(n))
    order[a], order[b] = b, a
    return order


def _drive(log: MotionData, drive: int, factor: float) -> MotionData:
    factors = np.ones(log.positions.shape[1])
    factors[drive] = factor
    return replace(
        log, positions=log.positions * factors, directions=log.directions * np.sign(factors)
    )


def _joint(log: MotionData, joint: int, factor: float) -> MotionData:
    factors = np.ones(log.angles.shape[1])
    factors[joint] = factor
    return replace(log, angles=log.angles * factors)
