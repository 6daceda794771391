"""Friction and damping between a drive's effort and the joints that it moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distal.arrays import Floats
from distal.from_logs.least_squares import SHOWN, scaled_solution
from distal.from_logs.motion_data import MotionData
from distal.from_logs.structure import DriveStructure


@dataclass(frozen=True)
class DriveFriction:
    """Friction of a drive and its tendons.

    Args:
        usual: at the usual effort [N or N m].
        share: by how much it grows per pull of the tendons [1]; 0 where the logs do not show it.
        share_std: its standard error [1].
        damping: what grows with speed [N s/m or N m s/rad].
    """

    usual: float
    share: float
    share_std: float
    damping: float


def drive_friction(
    logs: Sequence[MotionData],
    drive: int,
    structure: DriveStructure,
    constant: float,
    per_speed: float,
) -> DriveFriction:
    """Return the friction of a drive.

    Args:
        logs: all of them.
        drive: index of the drive, whose effort all logs have.
        structure: what it moves.
        constant: force or torque per effort.
        per_speed: the same, signed, with the gear between what is read and the drive.
    """
    usual, damping = _by_effort(logs, drive, structure)
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
        damping=damping * per_speed,
    )


def _by_effort(
    logs: Sequence[MotionData], drive: int, structure: DriveStructure
) -> tuple[float, float]:
    """Return half of the difference of efforts between both directions, and what grows with speed,
    all else equal.
    """
    columns = list[Floats]()
    target = list[Floats]()
    for log in logs:
        usable = np.isfinite(log.angles).all(axis=1)
        if (usable & log.moves(drive)).any():
            usable &= log.moves(drive)
        if not usable.any():
            continue
        matrix = np.column_stack(
            [
                log.angles[usable][:, list(structure.joints)],
                log.positions[usable, drive],
                log.directions[usable, drive],
                np.gradient(log.positions[:, drive], log.time)[usable],
            ]
        )
        effort = log.efforts[usable, drive]
        columns.append(matrix - matrix.mean(axis=0))
        target.append(effort - effort.mean())
    matrix = np.vstack(columns)
    efforts = np.concatenate(target)
    still, left_still = scaled_solution(matrix[:, :-1], efforts)
    moving, left_moving = scaled_solution(matrix, efforts)
    if left_moving > SHOWN * left_still:
        return float(abs(still[-1])), 0.0
    return float(abs(moving[-2])), float(moving[-1])
