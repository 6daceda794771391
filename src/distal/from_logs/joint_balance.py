"""What a joint needs of its tendons: a spring, a weight as far as a spring is like it, damping and
inertia.

    Σ r T = K (θ − θ₀) + b dθ/dt + I d²θ/dt² + f sign(dθ/dt)

by least squares over all logs in which all forces are read, less the friction of the drives. Both
sides are smoothed alike, since else the inertia of fast motions would come out too large. Samples
in which the joint or a drive rests are left out, since friction may then have any value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distal.arrays import Floats
from distal.from_logs.found_parts import FoundDrive, sliding, torque_of
from distal.from_logs.least_squares import (
    CLEAR,
    WITHIN,
    relative_errors,
    scaled_solution,
    smoothed,
    window_of,
)
from distal.from_logs.motion_data import MotionData


@dataclass(frozen=True)
class JointBalance:
    """Stiffness K [N m/rad], the torque at zero angle −K θ₀ [N m], damping b [N m s/rad], inertia I
    [kg m²] and friction f [N m] of a joint; the last three are 0 where the logs do not show them.
    The logs show that inertia is at most `most_inertia`.
    """

    stiffness: float
    offset: float
    damping: float
    inertia: float
    friction: float
    most_inertia: float


def joint_balance(
    joint: int,
    noise: float,
    pulls: Sequence[tuple[FoundDrive, float]],
    logs: Sequence[MotionData],
) -> JointBalance | None:
    """Return what a joint needs of its tendons; None where a force is not read.

    Args:
        joint: index of the joint.
        noise: standard deviation of its reference [rad].
        pulls: the drives that move it, each with its moment arm [m].
        logs: all of them.
    """
    if not pulls or any(drive.effort is None for drive, _ in pulls):
        return None
    parts = [_rows(joint, pulls, log, noise) for log in logs]
    matrix = np.vstack([columns for columns, _, _ in parts])
    torques = np.concatenate([values for _, values, _ in parts])
    if len(torques) < matrix.shape[1]:
        return None
    coefficients, left = scaled_solution(matrix, torques)
    stds = left * relative_errors(matrix, max(window for _, _, window in parts))
    clear = coefficients > CLEAR * stds
    shown = np.where(clear, coefficients, 0.0)
    plain = scaled_solution(matrix[:, [0, 1, 4]], torques)[0]
    stiffness, offset = coefficients[:2] if clear[2:4].any() else plain[:2]
    return JointBalance(
        stiffness=float(stiffness),
        offset=float(offset),
        damping=float(shown[2]),
        inertia=float(shown[3]),
        friction=float(shown[4]),
        most_inertia=float(max(coefficients[3], 0.0) + WITHIN * stds[3]),
    )


def _rows(
    joint: int, pulls: Sequence[tuple[FoundDrive, float]], log: MotionData, noise: float
) -> tuple[Floats, Floats, int]:
    """Return the columns θ, 1, dθ/dt, d²θ/dt² and sign(dθ/dt) of a log, the torques, and the number
    of samples over which both are smoothed.
    """
    angle = log.angles[:, joint]
    usable = np.isfinite(angle)
    step = float(np.median(np.diff(log.time)))
    angles = angle[usable]
    window = window_of(angles, step, noise)
    if len(angles) < 2 * window:
        return np.empty((0, 5)), np.empty(0), window
    smooth, speed, acceleration = (smoothed(angles, window, step, order) for order in range(3))
    ways = smoothed(np.sign(speed), window, step)
    columns = [smooth, np.ones(len(smooth)), speed, acceleration, ways]
    torques = smoothed(torque_of(pulls, log)[usable], window, step)
    read = np.isfinite(torques) & sliding(joint, pulls, log)[usable]
    return np.column_stack(columns)[read], torques[read], window
