"""Friction, damping and inertia between a drive's effort and the joints that it moves:

    e = Σ_j α_j θ_j + β x + f sign(dx/dt) + b dx/dt + I d²x/dt² + c

by least squares over all logs while the drive moves, both sides smoothed alike. The tendons' pull
is by how far they are stretched, α and β.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distal.arrays import Floats
from distal.from_logs.derivatives import OF_SPEED, length_of, smoothed
from distal.from_logs.least_squares import CLEAR, relative_errors, scaled_solution
from distal.from_logs.motion_data import MotionData
from distal.from_logs.structure import DriveStructure

DRIVE_SHARE = 0.4
"""Least share of a drive's own in the inertia of all that it moves, since errors of the tendons'
stretch hide 5 to 10 % of their pull, which looks like it [1]. Source: judgement.
"""


FEWEST_LOGS = 3
"""With fewer logs nobody knows which of them is odd. Source: definition."""

TURNED = 0.8
"""RMS of what is left of efforts with the other sign in one log per that as it is, below which that
log is odd [1]. Source: judgement (0.24 and 0.64 where one is; 0.93 to 6 where none is).
"""


@dataclass(frozen=True)
class DriveFriction:
    """Friction of a drive and its tendons.

    Args:
        usual: at the usual effort [N or N m].
        share: by how much it grows per pull of the tendons [1]; 0 where the logs do not show it.
        share_std: its standard error [1].
        damping: what grows with speed [N s/m or N m s/rad]; 0 where the logs do not show it.
        inertia: of the drive [kg or kg m²]; 0 where the logs do not show it.
    """

    usual: float
    share: float
    share_std: float
    damping: float
    inertia: float


def drive_friction(
    logs: Sequence[MotionData],
    drive: int,
    structure: DriveStructure,
    constant: float,
    per_speed: float,
    is_force: bool,
) -> DriveFriction:
    """Return the friction of a drive.

    Args:
        logs: all of them.
        drive: index of the drive, whose effort all logs have.
        structure: what it moves.
        constant: force or torque per effort.
        per_speed: the same, signed, with the gear between what is read and the drive.
        is_force: whether the effort is a force or a torque. Damping is taken from these alone: what
            a current shows is also along the path, and is left to the joints.
    """
    usual, of_motion = _by_effort(logs, drive, structure, np.sign(per_speed), is_force)
    share = 0.0
    share_std = 0.0
    if structure.growth != 0.0:
        # the stretch is that of e − d f(e), so that g = −b f and h = −∂(b f)/∂e with ∂b/∂e = 2 q
        force = structure.hysteresis / structure.compliance
        grows = structure.growth - 2.0 * structure.curvature * force
        is_growing = grows * structure.effort * structure.hysteresis > 0.0
        share = abs(grows / structure.compliance) if is_growing else 0.0
        share_std = abs(structure.growth_std / structure.compliance)
        usual = abs(force)
    return DriveFriction(
        usual=usual * constant,
        share=share,
        share_std=share_std,
        damping=float(of_motion[0] * abs(per_speed)),
        inertia=float(of_motion[1] * abs(per_speed)),
    )


def is_reversed(logs: Sequence[MotionData], drive: int, structure: DriveStructure) -> bool:
    """Return whether a drive's effort clearly falls where it moves forward, at the same angles, so
    that it is read with the other sign: all friction acts against motion.
    """
    matrix, efforts = _system(logs, drive, structure)
    matrix = np.delete(matrix, len(structure.joints), axis=1)
    if len(efforts) < matrix.shape[1]:
        return False
    solution, left = scaled_solution(matrix, efforts)
    return bool(solution[-3] < -CLEAR * left * relative_errors(matrix)[-3])


def odd_sign(logs: Sequence[MotionData], drive: int, structure: DriveStructure) -> int | None:
    """Return the index of the log in which a drive's effort is read with another sign than in the
    others, so that all efforts together are explained clearly better with the other sign there;
    None where there is no such log, or too few to tell.
    """
    if len(logs) < FEWEST_LOGS:
        return None
    parts = [_rows(log, drive, structure) for log in logs]
    matrix = np.delete(np.vstack([rows for rows, _ in parts]), len(structure.joints), axis=1)
    if len(matrix) < matrix.shape[1]:
        return None

    def left(odd: int | None) -> float:
        efforts = [-effort if k == odd else effort for k, (_, effort) in enumerate(parts)]
        return scaled_solution(matrix, np.concatenate(efforts))[1]

    changed = [left(k) for k in range(len(logs))]
    best = int(np.argmin(changed))
    return best if changed[best] < TURNED * left(None) else None


def _by_effort(
    logs: Sequence[MotionData],
    drive: int,
    structure: DriveStructure,
    sign: float,
    damped: bool,
) -> tuple[float, Floats]:
    """Return half of the difference of efforts between both directions, and how much they grow with
    speed and acceleration, (2,), all else equal; 0 where the logs do not show that.

    The efforts of a drive that moves forward have a `sign`. They grow with speed only if `damped`.
    """
    matrix, efforts = _system(logs, drive, structure)
    efforts = sign * efforts
    if len(efforts) < matrix.shape[1]:
        return 0.0, np.zeros(2)
    solution, left = scaled_solution(matrix, efforts)
    significant = np.ones(matrix.shape[1], dtype=bool)
    significant[-2:] = solution[-2:] > CLEAR * left * relative_errors(matrix)[-2:]
    significant[-2] &= damped
    moved = scaled_solution(matrix[:, -3:], efforts)[0]
    significant[-1] &= solution[-1] > DRIVE_SHARE * moved[-1]
    solution = np.zeros(len(significant))
    solution[significant], _ = scaled_solution(matrix[:, significant], efforts)
    return float(abs(solution[-3])), solution[-2:]


def _system(
    logs: Sequence[MotionData], drive: int, structure: DriveStructure
) -> tuple[Floats, Floats]:
    """Return the columns and efforts of all logs."""
    parts = [_rows(log, drive, structure) for log in logs]
    return np.vstack([columns for columns, _ in parts]), np.concatenate(
        [efforts for _, efforts in parts]
    )


def _rows(log: MotionData, drive: int, structure: DriveStructure) -> tuple[Floats, Floats]:
    """Return the columns of a log while the drive moves, and its efforts, both less their mean."""
    usable = np.isfinite(log.angles).all(axis=1)
    step = float(np.median(np.diff(log.time)))
    window = length_of(OF_SPEED, step)
    moves = log.moves(drive)[usable]
    if len(moves) < 2 * window or not moves.any():
        return np.empty((0, len(structure.joints) + 4)), np.empty(0)
    position = log.positions[usable, drive]
    still = np.column_stack(
        [log.angles[usable][:, list(structure.joints)], position, log.directions[usable, drive]]
    )
    rates = [smoothed(position, window, step, order) for order in (1, 2)]
    matrix = np.column_stack([smoothed(still, window, step), *rates])[moves]
    efforts = smoothed(log.efforts[usable, drive], window, step)[moves]
    return matrix - matrix.mean(axis=0), efforts - efforts.mean()
