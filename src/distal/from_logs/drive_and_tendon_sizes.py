"""Sizes of drives and tendons by what a drive moves: arms, stiffness, pre-tension, friction.

Friction, damping and inertia between a drive's effort and the joints that it moves:

    e = Σ_j α_j θ_j + β x + f sign(dx/dt) + b dx/dt + I d²x/dt² + c

by least squares over all logs while the drive moves, both sides smoothed alike. The tendons' pull
is by how far they are stretched, α and β.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, isfinite

import numpy as np

from distal.arrays import Floats
from distal.from_logs.column_values import ColumnRole
from distal.from_logs.motion_data import (
    CLEAR,
    THRESHOLDS,
    MotionData,
    length_of,
    relative_errors,
    scaled_solution,
    smoothed,
)
from distal.from_logs.which_drive_moves_what import EXPLAINED, DriveStructure
from distal.model.springs import STEEPEST
from distal.rig.hand_tables.rig_of_table import ASSUMED
from distal.units import to_si


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
    return bool(solution[-3] < -CLEAR * left * relative_errors(matrix, _window(logs))[-3])


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
    significant[-2:] = solution[-2:] > CLEAR * left * relative_errors(matrix, _window(logs))[-2:]
    significant[-2] &= damped
    # errors of the tendons' stretch hide some of their pull, which looks like inertia of the drive
    moved = scaled_solution(matrix[:, -3:], efforts)[0]
    significant[-1] &= solution[-1] > EXPLAINED * moved[-1]
    solution = np.zeros(len(significant))
    solution[significant], _ = scaled_solution(matrix[:, significant], efforts)
    return float(abs(solution[-3])), solution[-2:]


def _window(logs: Sequence[MotionData]) -> int:
    """Return the number of samples over which both sides of the equations are smoothed."""
    return max(length_of(THRESHOLDS.of_speed, float(np.median(np.diff(log.time)))) for log in logs)


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
    window = length_of(THRESHOLDS.of_speed, step)
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


TWO_SIDED = 0.05
"""Efforts of both signs, the smaller above this share of the larger: two tendons on one spool.
Source: benchmark (`benchmarks.from_logs structure`, seeds 9400 to 9519, 9626, 9645: drives of one
tendon up to 0.02, of two from 0.09 on).
"""


@dataclass(frozen=True)
class DriveSizes:
    """A drive and its tendons in SI, after gear and signs.

    Args:
        is_slider: whether it moves in a line.
        gear: turns of what is read for one turn of the drive, 1 for a slider.
        lever: radius of the spool, 1 for a slider [m].
        is_pair: whether two tendons on one spool pull to both sides.
        winding: +1 where its tendon is wound by positive positions.
        position_sign: of its column.
        effort_sign: of its column.
        torque_constant: of a current [N m/A], 1 where force or torque are read.
        arms: moment arms, positive where the tendon pulls to a positive angle [m], (n_joints,).
        arm_stds: standard errors as shares, (n_joints,).
        stiffness: of a tendon [N/m].
        stiffness_std: as a share; NaN where the logs do not know it.
        tension: usual tension [N].
        pretension: at zero angles and zero position [N].
        slack: there [m], 0 where the tendon is taut.
        zero_spread: standard deviation of the drive's zero between logs, at the tendon [m].
        stiffening: of a tendon whose curve the logs show [1/m], else 0.
        stiffening_std: its standard error.
        friction: between the drive's effort and the joints, in units of that effort; None where
            none is read.
        load: usual pull of the tendons on the drive [N or N m].
    """

    is_slider: bool
    gear: float
    lever: float
    is_pair: bool
    winding: int
    position_sign: int
    effort_sign: int
    torque_constant: float
    arms: Floats
    arm_stds: Floats
    stiffness: float
    stiffness_std: float
    tension: float
    pretension: float
    slack: float
    zero_spread: float
    stiffening: float
    stiffening_std: float
    friction: DriveFriction | None
    load: float


def drive_sizes(
    logs: Sequence[MotionData],
    drive: int,
    structure: DriveStructure,
    position: ColumnRole,
    effort: ColumnRole | None,
    is_opposed: bool,
) -> DriveSizes:
    """Return the sizes of a drive and its tendons.

    Args:
        logs: all of them.
        drive: index of the drive.
        structure: what it moves.
        position: its column.
        effort: that of its effort, None where there is none.
        is_opposed: whether there are more drives than joints, so that each pulls one tendon.
    """
    is_slider = position.si == "m"
    ratio = float(np.max(np.abs(structure.ratios)))
    gear = 1.0
    if not is_slider and ratio > THRESHOLDS.largest_ratio:
        gear = float(round(ratio))
    lever = 1.0 if is_slider else ASSUMED.radius
    efforts = np.concatenate([log.efforts[:, drive] for log in logs])
    is_read = effort is not None and bool(np.isfinite(efforts).all())
    knows = is_read and structure.knows_compliance
    constant = 1.0
    if effort is not None and effort.si == "A":
        constant = to_si(ASSUMED.torque_constant.value, "N m/A")
    falls = structure.compliance < 0.0 if knows else is_read and is_reversed(logs, drive, structure)
    reversed_effort = -1 if falls else 1
    pulls = reversed_effort * efforts * constant
    low, high = np.quantile(pulls, [0.05, 0.95]) if is_read else (float("nan"), float("nan"))
    smaller, larger = sorted([abs(low), abs(high)])
    both = is_read and low < 0.0 < high and smaller > TWO_SIDED * larger
    is_pair = not is_slider and (both if is_read else not is_opposed)
    mean = float(np.mean(pulls)) if is_read else 1.0
    # a single tendon only pulls: where its pull is negative, positions let it out; a load cell
    # that was tared reads both signs and says nothing of that
    is_negative = high < 0.0 if is_slider else mean < 0.0
    winding = -1 if is_read and is_negative and not is_pair else 1
    position_sign = 1
    effort_sign = reversed_effort
    if is_slider:
        position_sign = winding
        effort_sign = winding * reversed_effort
        winding = 1
    share = 2.0 if is_pair else 1.0
    stiffness = float("nan")
    if knows:
        stiffness = constant * gear / (share * abs(structure.compliance) * lever**2)
    stiffness_std = (
        max(2.0 * abs(structure.compliance_std / structure.compliance), 0.2) if knows else 0.0
    )
    if knows and effort is not None and effort.si == "A":
        # the scale of force is free: it is chosen so that the tendon is a usual one
        usual = float(np.clip(stiffness, *THRESHOLDS.usual_stiffness))
        constant *= usual / stiffness
        pulls = pulls * usual / stiffness
        stiffness = usual
    if not isfinite(stiffness):
        stiffness = to_si(ASSUMED.stiffness, "N/m")
        stiffness_std = float("nan")
    tension = float(np.quantile(np.abs(pulls), 0.9)) / lever if is_read else 10.0
    arms = position_sign * winding * structure.ratios / gear * lever
    zero = position_sign * winding * structure.zero / gear * lever
    pretension = THRESHOLDS.share_of_pair * tension if is_pair else max(-zero * stiffness, 0.0)
    usual = abs(structure.effort) * constant / lever if is_read else tension
    load = lever * (2.0 * pretension if is_pair else max(usual, tension / 2.0))
    friction = None
    if is_read:
        per_speed = reversed_effort * constant * gear
        is_force = effort is not None and effort.si != "A"
        friction = drive_friction(logs, drive, structure, constant, per_speed, is_force)
    stiffening = 0.0
    stiffening_std = 0.0
    if knows and not is_pair and structure.curvature != 0.0:
        # of T = T_pre + k (exp(a δ) − 1)/a with dT/dδ = K: dδ/dT = 1/K and d²δ/dT² = −a/K²
        per_curvature = 2.0 * stiffness * lever / (constant * structure.compliance)
        stiffening = -per_curvature * structure.curvature * np.sign(structure.effort)
        stiffening_std = abs(per_curvature) * structure.curvature_std
    if stiffening > 0.0:
        loose = max(stiffness - stiffening * usual, exp(-STEEPEST) * stiffness)
        pretension = max(loose * float(np.expm1(-stiffening * zero)) / float(stiffening), 0.0)
        stiffness = loose + stiffening * pretension
    return DriveSizes(
        is_slider=is_slider,
        gear=gear,
        lever=lever,
        is_pair=is_pair,
        winding=winding,
        position_sign=position_sign,
        effort_sign=effort_sign,
        torque_constant=constant,
        arms=arms,
        arm_stds=np.maximum(2.0 * np.abs(structure.ratio_stds / structure.ratios), 0.02),
        stiffness=stiffness,
        stiffness_std=stiffness_std,
        tension=tension,
        pretension=pretension,
        zero_spread=structure.zero_spread / gear * lever,
        slack=0.0 if is_pair or not is_read else max(zero, 0.0),
        stiffening=max(float(stiffening), 0.0),
        stiffening_std=float(stiffening_std),
        friction=friction,
        load=load,
    )
