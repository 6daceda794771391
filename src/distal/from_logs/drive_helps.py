"""What the drives' positions tell of the joints, by least squares on logs that were left out: more
than the joints tell of them in a soft body, or where several joints share few drives.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.arrays import Floats
from distal.from_logs.least_squares import scaled_solution
from distal.from_logs.motion_data import MotionData

HELPS = 1.1
"""Ratio of a joint's error on logs left out without a drive to that with it, from which on the
drive is kept [1]. Source: judgement.
"""


def drive_helps(logs: Sequence[MotionData], drive: int) -> bool:
    """Return whether least squares of some joint on the drives errs clearly more without a drive,
    on logs that were left out.
    """
    every = range(logs[0].positions.shape[1])
    remaining = [d for d in every if d != drive]
    usable = _usable(logs, len(every))
    if len(usable) < 2 or not remaining:
        return False
    ratios = _errors(usable, remaining) / np.maximum(_errors(usable, list(every)), 1e-12)
    return bool(np.max(ratios) > HELPS)


def explained_by_drives(logs: Sequence[MotionData], joint: int) -> float:
    """Return the share of a joint's variance that all drives explain on logs left out, 0 where it
    cannot be said.
    """
    every = list(range(logs[0].positions.shape[1]))
    usable = _usable(logs, len(every))
    if len(usable) < 2:
        return 0.0
    total = np.mean([np.var(_centred(log, every)[1][:, joint]) for log in usable])
    return float(1.0 - _errors(usable, every)[joint] ** 2 / max(float(total), 1e-300))


def _usable(logs: Sequence[MotionData], drives: int) -> list[MotionData]:
    return [log for log in logs if np.isfinite(log.angles).all(axis=1).sum() > drives]


def _errors(logs: Sequence[MotionData], drives: list[int]) -> Floats:
    """Return the RMS error of each joint by least squares on some drives, each log left out once
    [rad].
    """
    parts = [_centred(log, drives) for log in logs]
    squares = []
    for k, (columns, angles) in enumerate(parts):
        training = [part for i, part in enumerate(parts) if i != k]
        matrix = np.vstack([part for part, _ in training])
        targets = np.vstack([part for _, part in training])
        solved = [scaled_solution(matrix, target)[0] for target in targets.T]
        squares.append(np.mean((angles - columns @ np.column_stack(solved)) ** 2, axis=0))
    return np.asarray(np.sqrt(np.mean(squares, axis=0)))


def _centred(log: MotionData, drives: list[int]) -> tuple[Floats, Floats]:
    known = np.isfinite(log.angles).all(axis=1)
    columns = log.positions[known][:, drives]
    angles = log.angles[known]
    return columns - columns.mean(axis=0), angles - angles.mean(axis=0)
