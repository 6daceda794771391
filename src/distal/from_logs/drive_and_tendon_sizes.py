"""Sizes of drives and tendons by what a drive moves: arms, stiffness, pre-tension, friction.

Friction, damping and inertia between a drive's effort and the joints that it moves:

    e = Σ_j α_j θ_j + β x + f sign(dx/dt) + b dx/dt + I d²x/dt² + c

by least squares over all logs while the drive moves, both sides smoothed alike. The tendons' pull
is by how far they are stretched, α and β.

Drives and joints as logs show them.

The joints and drives that logs show, and what they cannot tell of them.

What the drives' positions tell of the joints, by least squares: more than the joints tell of them
in a soft body, or where several joints share few drives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, isfinite

import numpy as np

from distal.arrays import Bools, Floats
from distal.errors import RigError
from distal.from_logs.column_names import ColumnRole
from distal.from_logs.motion_data import (
    BETTER,
    CLEAR,
    THRESHOLDS,
    MotionData,
    factor_of_column,
    length_of,
    relative_errors,
    scaled_solution,
    smoothed,
    speed_of,
)
from distal.from_logs.which_drive_moves_what import (
    EXPLAINED,
    DriveStructure,
    as_rival,
    drive_structure,
    with_joint,
)
from distal.model.tendon_tensions import STEEPEST
from distal.rig.hand_tables import ASSUMED
from distal.rig.plausibility import USUAL
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


def unexplained(logs: Sequence[MotionData], drives: Sequence[int]) -> Floats:
    """Return the share of each joint's variance that least squares on some drives leave."""
    parts = []
    for log in logs:
        columns = np.column_stack([log.positions[:, list(drives)], log.angles])
        known = columns[np.isfinite(log.angles).all(axis=1)]
        parts.append(known - known.mean(axis=0) if len(known) else known)
    positions, angles = np.split(np.vstack(parts), [len(drives)], axis=1)
    left = angles - positions @ np.linalg.lstsq(positions, angles)[0]
    return np.asarray(np.sum(left**2, axis=0) / np.maximum(np.sum(angles**2, axis=0), 1e-300))


def joints_of(references: Sequence[ColumnRole], logs: Sequence[MotionData]) -> list[FoundJoint]:
    """Return the joints; one that is a line of another one before it follows that rigidly."""
    angles = np.vstack([log.angles for log in logs])
    angles = angles[np.isfinite(angles).all(axis=1)]
    joints = list[FoundJoint]()
    for j, column in enumerate(references):
        follows = None
        for i, before in enumerate(joints):
            if before.follows is not None or len(angles) < 10:
                continue
            slope, offset = np.polyfit(angles[:, i], angles[:, j], 1)
            residuals = angles[:, j] - slope * angles[:, i] - offset
            if np.sqrt(np.mean(residuals**2)) < THRESHOLDS.rigid * np.ptp(angles[:, j]):
                follows = FoundJoint(column.part, column, before.name, float(slope))
                break
        joints.append(follows or FoundJoint(column.part, column))
    return joints


def drives_of(
    columns: Sequence[ColumnRole],
    joints: Sequence[FoundJoint],
    free: Sequence[int],
    logs: Sequence[MotionData],
) -> tuple[list[FoundDrive], list[str], list[str]]:
    """Return the drives that move joints, what cannot be told of them, and which were left out."""
    positions = [column for column in columns if column.role == "position"]
    efforts = {column.part: column for column in columns if column.role == "effort"}
    structures = dict[int, DriveStructure]()
    left = []
    indices = range(len(positions))
    for d, column in enumerate(positions):
        structure = drive_structure(logs, d, free)
        moves = structure is not None and structure.explained >= EXPLAINED
        without = unexplained(logs, [other for other in indices if other != d])
        helps = (unexplained(logs, indices) < BETTER**2 * without).any()
        if structure is None or not (moves or helps):
            left.append(f"{column.header} moves none of the joints that are known: left out")
            continue
        structures[d] = structure
    shared = _move_all(structures, free, logs)
    untellable = [
        _rival(positions[d], structure, joints)
        for d, structure in structures.items()
        if structure.rival is not None
    ]
    untellable += [
        f"{joints[joint].name} moves with the other joints: cannot be told which drive moves it, "
        f"{positions[d].header} is a guess; a log in which it is held, or moved by hand for 5 s "
        "while the others rest, would tell"
        for joint, d in shared
    ]
    if not structures:
        raise RigError(
            "no drive moves with the joints that are known; are these logs of one rig, and the "
            "columns right?"
        )
    moved = {j for structure in structures.values() for j in structure.joints}
    is_opposed = len(structures) > len(moved)
    drives = [
        FoundDrive(
            positions[d].part,
            d,
            positions[d],
            efforts.get(positions[d].part),
            structure,
            drive_sizes(
                logs, d, structure, positions[d], efforts.get(positions[d].part), is_opposed
            ),
        )
        for d, structure in structures.items()
    ]
    return drives, untellable, left


def _move_all(
    structures: dict[int, DriveStructure], free: Sequence[int], logs: Sequence[MotionData]
) -> list[tuple[int, int]]:
    """Let each joint that none moves be moved by the drive that may as well move it, or else, where
    the drives tell its angle, by the one whose motion it explains best; return joint and drive of
    the latter.
    """
    shared = list[tuple[int, int]]()
    is_explained = unexplained(logs, range(logs[0].positions.shape[1])) <= 1.0 - EXPLAINED
    for joint in free:
        if any(joint in structure.joints for structure in structures.values()):
            continue
        rival = _rival_of(joint, structures)
        if rival is not None:
            structures[rival] = as_rival(logs, rival, structures[rival])
        elif structures and is_explained[joint]:
            ways = {d: with_joint(logs, d, moved, joint) for d, moved in structures.items()}
            best = min(ways, key=lambda d: ways[d][1])
            structures[best] = ways[best][0]
            shared.append((joint, best))
    return shared


def _rival_of(joint: int, structures: dict[int, DriveStructure]) -> int | None:
    """Return the drive that may as well move a joint, and whose own joints others move too."""
    for d, structure in structures.items():
        elsewhere = {j for e, other in structures.items() if e != d for j in other.joints}
        is_free = set(structure.joints) <= elsewhere
        if structure.rival is not None and joint in structure.rival and is_free:
            return d
    return None


def _rival(column: ColumnRole, structure: DriveStructure, joints: Sequence[FoundJoint]) -> str:
    assert structure.rival is not None
    chosen, rival = (
        " and ".join(joints[j].name for j in indices)
        for indices in (structure.joints, structure.rival)
    )
    return (
        f"{column.header}: cannot be told whether it moves {chosen} or {rival}; a log in which it "
        "moves alone for 5 s would tell"
    )


def check_arms(joints: Sequence[FoundJoint], drives: Sequence[FoundDrive]) -> None:
    """Raise a `RigError` where the largest moment arm of a drive that is read in metres cannot be;
    about other axes it may be anything, down to none.
    """
    shortest, longest, _ = USUAL["radius"]
    for drive in drives:
        if not drive.sizes.is_slider:
            continue
        arms = np.abs(drive.sizes.arms)
        arm = float(np.max(arms))
        if not shortest <= arm <= longest:
            joint = joints[drive.structure.joints[int(np.argmax(arms))]]
            raise RigError(
                f"{drive.position.header} moves by {1e3 * arm:.4g} mm for each rad of "
                f"{joint.angle.header}; a hand's arms are {1e3 * shortest:g} to "
                f"{1e3 * longest:g} mm. Is the unit of one of them right?"
            )


def check_explained(
    joints: Sequence[FoundJoint],
    free: Sequence[int],
    logs: Sequence[MotionData],
    asked: Sequence[str],
) -> list[str]:
    """Return a sentence on each joint of whose motion the drives explain less than half.

    Args:
        joints: all of them.
        free: indices of those that follow no other.
        logs: all of them.
        asked: headers of the joints that a user named.

    Raises:
        RigError: no user named such a joint.
    """
    left = unexplained(logs, range(logs[0].positions.shape[1]))
    lines = []
    for j in free:
        if left[j] <= 1.0 - EXPLAINED:
            continue
        header = joints[j].angle.header
        line = f"the drives explain only {100 * (1 - left[j]):.0f} % of the motion of {header}"
        if header not in asked:
            every = ",".join(joint.angle.header for joint in joints)
            raise RigError(
                f"{line}: is its reference right, and is it moved by these drives? If so, "
                f"add --truth {every}; else leave it out, --ignore {header}"
            )
        lines.append(line)
    return lines


def check_moved(
    joints: Sequence[FoundJoint], free: Sequence[int], drives: Sequence[FoundDrive]
) -> None:
    """Raise a `RigError` where no drive moves a joint that is free."""
    moved = {j for drive in drives for j in drive.structure.joints}
    unmoved = [joints[j].angle.header for j in free if j not in moved]
    if unmoved:
        raise RigError(
            f"no drive moves {', '.join(unmoved)}; is that a joint of this rig? If not, leave its "
            "column out by --ignore"
        )


def drive_in_words(drive: FoundDrive, joints: Sequence[FoundJoint]) -> str:
    """Return what a drive moves, in a line."""
    structure = drive.structure
    sizes = drive.sizes
    unit, factor = ("mm", 1e3) if sizes.is_slider else ("rad", 1.0)
    parts = [
        f"{joints[j].name} ({factor * ratio:+.4g} ± {factor * std:.1g} {unit} for each rad)"
        for j, ratio, std in zip(structure.joints, structure.ratios, structure.ratio_stds)
    ]
    kind = "one tendon"
    if sizes.is_pair:
        kind = "two tendons on its spool" if drive.effort else "two tendons on its spool (a guess)"
    return (
        f"{drive.name} moves {', '.join(parts)} by {kind}; this explains "
        f"{100 * structure.explained:.2f} % of its motion"
    )
