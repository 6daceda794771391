"""Drives and joints as logs show them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distal.arrays import Bools, Floats
from distal.from_logs.column_values import ColumnRole
from distal.from_logs.drive_and_tendon_sizes import DriveSizes
from distal.from_logs.motion_data import THRESHOLDS, MotionData, factor_of_column, speed_of
from distal.from_logs.which_drive_moves_what import DriveStructure


@dataclass(frozen=True)
class FoundDrive:
    """A drive with its columns, what it moves, and its sizes; `index` is its column in the data."""

    name: str
    index: int
    position: ColumnRole
    effort: ColumnRole | None
    structure: DriveStructure
    sizes: DriveSizes


@dataclass(frozen=True)
class FoundJoint:
    """A joint with its column; where it follows another rigidly, that and the ratio."""

    name: str
    angle: ColumnRole
    follows: str | None = None
    ratio: float = 1.0

    @property
    def noise(self) -> float:
        """Standard deviation of the random error of its column [rad]."""
        return self.angle.values.noise * factor_of_column(self.angle)


def pulls_of(joint: int, drives: Sequence[FoundDrive]) -> list[tuple[FoundDrive, float]]:
    """Return the drives that move a joint, each with its moment arm there [m]."""
    return [
        (drive, float(drive.sizes.arms[drive.structure.joints.index(joint)]))
        for drive in drives
        if joint in drive.structure.joints
    ]


def pulled_both_ways(pulls: Sequence[tuple[FoundDrive, float]]) -> bool:
    """Return whether tendons pull a joint to both sides, so that it needs no spring; `pulls` are
    the drives that move it with their moment arms.
    """
    sides = {arm > 0.0 for _, arm in pulls}
    return len(sides) > 1 or any(drive.sizes.is_pair for drive, _ in pulls)


def sliding(joint: int, pulls: Sequence[tuple[FoundDrive, float]], log: MotionData) -> Bools:
    """Return when a joint and all drives of `pulls` move, so that friction acts against their
    directions, (n_samples,).
    """
    angle = log.angles[:, joint]
    speed = np.abs(speed_of(angle, log.time))
    moves = speed > THRESHOLDS.slow * np.sqrt(np.mean(speed**2))
    for drive, _ in pulls:
        moves &= log.moves(drive.index)
    return np.asarray(moves & np.isfinite(angle))


def torque_of(pulls: Sequence[tuple[FoundDrive, float]], log: MotionData) -> Floats:
    """Return the torque of tendons on a joint while their drives move, Σ r T, (n_samples,) [N m],
    by the drives of `pulls` with their moment arms r [m], less what the drives themselves need.
    """
    total = np.zeros(len(log.time))
    for drive, arm in pulls:
        sizes = drive.sizes
        factor = sizes.effort_sign * sizes.winding * sizes.torque_constant / sizes.lever
        efforts = log.efforts[:, drive.index]
        taken = drive.structure.friction(efforts) * log.directions[:, drive.index]
        total += arm * factor * (efforts - taken)
        if sizes.friction is not None:
            speed = speed_of(log.positions[:, drive.index], log.time)
            needed = sizes.friction.damping * speed
            needed += sizes.friction.inertia * speed_of(speed, log.time)
            total -= arm * sizes.winding * sizes.position_sign * needed / sizes.gear / sizes.lever
    return total
