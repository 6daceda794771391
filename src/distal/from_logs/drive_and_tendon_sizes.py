"""The drives and joints that logs show: of each drive, by what it moves, arms, stiffness,
pre-tension and friction, by least squares; and which joints the logs cannot tell.

Friction f, damping b and inertia I between a drive's effort and the joints that it moves:

    e = Σ_j α_j θ_j + β x + f sign(dx/dt) + b dx/dt + I d²x/dt² + c

over all logs while the drive moves, both sides smoothed alike. The tendons' pull is by how far
they are stretched, α and β.

Where logs hold the setpoints of servos, stiffness K and dead band δ follow too (`servos_of`): a
servo with a lag T stands at the position s for which  u − s = F/K + δ d + T ds/dt,  with its
setpoint u, its force F and its last direction of motion d, from −1 to 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import exp
from statistics import median

import numpy as np

from distal.arrays import Bools, Floats
from distal.errors import RigError
from distal.from_logs.column_names import ColumnRole, Columns, of_role
from distal.from_logs.motion_data import (
    BETTER,
    CLEAR,
    THRESHOLDS,
    Equations,
    Logs,
    MotionData,
    factor_of_column,
    rms,
    scaled_solution,
    smoothed,
    stacked,
    with_errors,
)
from distal.from_logs.which_drive_moves_what import (
    EXPLAINED,
    DriveStructure,
    added_error,
    described,
    drive_structure,
)
from distal.logs import Log
from distal.model.tendon_tensions import STEEPEST
from distal.regression.posterior import played
from distal.rig import Capstan, Rig, Slider
from distal.rig.hand_tables import ASSUMED
from distal.rig.plausibility import USUAL
from distal.units import to_si

LOAD_OF_PAIR = 3.0
"""Sum of the tensions of a pair per their usual difference by which its friction is shared out [1].
Source: benchmark (python -m benchmarks.learned plants: with 1 a wrist errs by 1.3 times as much).
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
    logs: Logs,
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
    matrix, efforts = stacked(_rows(log, drive, structure) for log in logs)
    # those of a drive that moves forward are above zero
    efforts *= np.sign(per_speed)
    solution = np.zeros(matrix.shape[1])
    if len(efforts) >= len(solution):
        first, stds = with_errors(matrix, efforts, max(log.window for log in logs))
        shown = np.ones(len(first), dtype=bool)
        shown[-2:] = first[-2:] > CLEAR * stds[-2:]
        shown[-2] &= is_force
        # errors of the tendons' stretch hide some of their pull, which looks like inertia of the
        # drive
        moved = scaled_solution(matrix[:, -3:], efforts)
        shown[-1] &= first[-1] > EXPLAINED * moved[-1]
        solution[shown] = scaled_solution(matrix[:, shown], efforts)
    # half of the difference between both directions, and what grows with speed and acceleration
    back, damping, inertia = solution[-3:].tolist()
    usual = abs(back)
    share = share_std = 0.0
    if structure.growth != 0.0:
        # the stretch is that of e − d f(e), so that g = −b f and h = −∂(b f)/∂e with ∂b/∂e = 2 q
        force = structure.hysteresis / structure.compliance
        grows = structure.growth - 2.0 * structure.curvature * force
        if grows * structure.effort * structure.hysteresis > 0.0:
            share = abs(grows / structure.compliance)
            share_std = abs(structure.growth_std / structure.compliance)
        usual = abs(force)
    return DriveFriction(
        usual=usual * constant,
        share=share,
        share_std=share_std,
        damping=damping * abs(per_speed),
        inertia=inertia * abs(per_speed),
    )


def is_reversed(logs: Logs, drive: int, structure: DriveStructure) -> bool:
    """Return whether a drive's effort clearly falls where it moves forward, at the same angles, so
    that it is read with the other sign: all friction acts against motion.
    """
    matrix, efforts = stacked(_rows(log, drive, structure) for log in logs)
    matrix = np.delete(matrix, len(structure.joints), axis=1)
    if len(efforts) < matrix.shape[1]:
        return False
    solution, stds = with_errors(matrix, efforts, max(log.window for log in logs))
    return bool(solution[-3] < -CLEAR * stds[-3])


def _rows(log: MotionData, drive: int, structure: DriveStructure) -> Equations:
    """Return the columns of a log while the drive moves, and its efforts, both less their mean."""
    usable = log.is_known
    moves = log.moves(drive)[usable]
    if len(moves) < 2 * log.window or not moves.any():
        return np.empty((0, len(structure.joints) + 4)), np.empty(0)
    position = log.positions[usable, drive]
    still = np.column_stack(
        [log.angles[usable][:, structure.joints], position, log.directions[usable, drive]]
    )
    rates = [smoothed(position, log.window, log.step, order) for order in (1, 2)]
    matrix = np.column_stack([smoothed(still, log.window, log.step), *rates])[moves]
    efforts = smoothed(log.efforts[usable, drive], log.window, log.step)[moves]
    return matrix - matrix.mean(axis=0), efforts - efforts.mean()


TWO_SIDED = 0.05
"""Efforts of both signs, the smaller above this share of the larger: two tendons on one spool.
Source: benchmark (`benchmarks.from_logs structure`, seeds 9400 to 9519, 9626, 9645: drives of one
tendon up to 0.02, of two from 0.09 on).
"""


@dataclass(frozen=True)
class FoundDrive:
    """A drive and its tendons in SI, after gear and signs.

    Args:
        name: of the drive.
        index: of its column in the data.
        position: its column.
        effort: that of its effort, None where there is none.
        structure: what it moves.
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
        stiffness_std: as a share; 0 where the logs do not know it.
        tension: usual tension [N].
        pretension: at zero angles and zero position [N]; of a pair, which no log tells it of, the
            least with which both tendons stay taut at their usual difference.
        slack: there [m], 0 where the tendon is taut.
        zero_spread: standard deviation of the drive's zero between logs, at the tendon [m].
        stiffening: of a tendon whose curve the logs show [1/m], else 0.
        friction: between the drive's effort and the joints, in units of that effort; None where
            none is read.
        load: usual pull of the tendons on the drive [N or N m].
    """

    name: str
    index: int
    position: ColumnRole
    effort: ColumnRole | None
    structure: DriveStructure
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
    friction: DriveFriction | None
    load: float


Drives = Sequence[FoundDrive]
"""The drives of one rig."""


def found_drive(
    logs: Logs,
    index: int,
    structure: DriveStructure,
    position: ColumnRole,
    effort: ColumnRole | None,
    is_opposed: bool,
) -> FoundDrive:
    """Return a drive and its tendons with their sizes.

    Args:
        logs: all of them.
        index: of the drive.
        structure: what it moves.
        position: its column.
        effort: that of its effort, None where there is none.
        is_opposed: whether there are more drives than joints, so that each pulls one tendon.
    """
    is_slider = position.si == "m"
    is_current = effort is not None and effort.si == "A"
    ratio = float(np.max(np.abs(structure.ratios)))
    gear = 1.0 if is_slider or ratio <= THRESHOLDS.largest_ratio else float(round(ratio))
    lever = 1.0 if is_slider else ASSUMED.radius
    constant = to_si(ASSUMED.torque_constant.value, "N m/A") if is_current else 1.0
    is_read = effort is not None
    knows = structure.knows_compliance
    falls = structure.compliance < 0.0 if knows else is_read and is_reversed(logs, index, structure)
    effort_sign = -1 if falls else 1
    pulls = effort_sign * constant * np.concatenate([log.efforts[:, index] for log in logs])
    low, high = np.quantile(pulls, [0.05, 0.95])
    both = low < 0.0 < high and min(-low, high) > TWO_SIDED * max(-low, high)
    is_pair = not is_slider and (both if is_read else not is_opposed)
    # a single tendon only pulls: where its pull is negative, positions let it out; a load cell
    # that was tared reads both signs and says nothing of that
    is_negative = high < 0.0 if is_slider else np.mean(pulls) < 0.0
    winding = -1 if is_negative and not is_pair else 1
    stiffness, stiffness_std = to_si(ASSUMED.stiffness, "N/m"), 0.0
    if knows:
        share = 2.0 if is_pair else 1.0
        stiffness = constant * gear / lever**2 / (share * abs(structure.compliance))
        stiffness_std = max(2.0 * abs(structure.compliance_std / structure.compliance), 0.2)
    if knows and is_current:
        # the scale of force is free: it is chosen so that the tendon is a usual one
        usual = float(np.clip(stiffness, *THRESHOLDS.usual_stiffness))
        constant *= usual / stiffness
        pulls = pulls * usual / stiffness
        stiffness = usual
    tension = float(np.quantile(np.abs(pulls), 0.9)) / lever if is_read else 10.0
    per_turn = winding * lever / gear
    zero = per_turn * structure.zero
    pretension = tension / 2.0 if is_pair else max(-zero * stiffness, 0.0)
    usual = abs(structure.effort) * constant / lever if is_read else tension
    load = lever * (LOAD_OF_PAIR * tension if is_pair else max(usual, tension / 2.0))
    friction = None
    if is_read:
        per_speed = effort_sign * constant * gear
        friction = drive_friction(logs, index, structure, constant, per_speed, not is_current)
    stiffening = 0.0
    if knows and not is_pair:
        # a of T = T_pre + k (exp(a δ) − 1)/a, by dδ/dT = 1/K and d²δ/dT² = −a/K², dT/dδ = K
        bend = structure.curvature * np.sign(structure.effort) / structure.compliance
        stiffening = max(float(-2.0 * stiffness * lever / constant * bend), 0.0)
    if stiffening > 0.0:
        loose = max(stiffness - stiffening * usual, exp(-STEEPEST) * stiffness)
        pretension = max(loose * float(np.expm1(-stiffening * zero)) / stiffening, 0.0)
        stiffness = loose + stiffening * pretension
    return FoundDrive(
        name=position.part,
        index=index,
        position=position,
        effort=effort,
        structure=structure,
        is_slider=is_slider,
        gear=gear,
        lever=lever,
        is_pair=is_pair,
        # a slider that lets its tendon out is read with the other sign
        winding=1 if is_slider else winding,
        position_sign=winding if is_slider else 1,
        effort_sign=winding * effort_sign if is_slider else effort_sign,
        torque_constant=constant,
        arms=per_turn * structure.ratios,
        arm_stds=np.maximum(2.0 * np.abs(structure.ratio_stds / structure.ratios), 0.02),
        stiffness=stiffness,
        stiffness_std=stiffness_std,
        tension=tension,
        pretension=pretension,
        zero_spread=abs(per_turn) * structure.zero_spread,
        slack=0.0 if is_pair or not is_read else max(zero, 0.0),
        stiffening=stiffening,
        friction=friction,
        load=load,
    )


@dataclass(frozen=True)
class FoundJoint:
    """A joint with its index and its column; where it follows another rigidly, that and the ratio;
    and the drives that move it, each with its moment arm there [m].
    """

    index: int
    angle: ColumnRole
    follows: FoundJoint | None = None
    ratio: float = 1.0
    pulls: Sequence[tuple[FoundDrive, float]] = ()

    @property
    def name(self) -> str:
        """Its name in a rig file."""
        return self.angle.part

    @property
    def is_read(self) -> bool:
        """Whether the forces of all its tendons are read."""
        return bool(self.pulls) and all(drive.effort is not None for drive, _ in self.pulls)

    @property
    def tension(self) -> float:
        """Usual tension of its tendons [N]."""
        return median(drive.tension for drive, _ in self.pulls)

    @property
    def is_pulled_both_ways(self) -> bool:
        """Whether tendons pull it to both sides, so that it needs no spring."""
        sides = {arm > 0.0 for _, arm in self.pulls}
        return len(sides) > 1 or any(drive.is_pair for drive, _ in self.pulls)

    @property
    def noise(self) -> float:
        """Standard deviation of the random error of its column [rad]."""
        return self.angle.values.noise * factor_of_column(self.angle)


Joints = Sequence[FoundJoint]
"""The joints of one rig, in the order of their columns."""


def with_pulls(joint: FoundJoint, drives: Drives) -> FoundJoint:
    """Return a joint with the drives that move it."""
    pulls = [
        (drive, float(arm))
        for drive in drives
        for j, arm in zip(drive.structure.joints, drive.arms)
        if j == joint.index
    ]
    return replace(joint, pulls=pulls)


def torque_of(joint: FoundJoint, log: MotionData) -> tuple[Floats, Bools]:
    """Return the torque of tendons on a joint while their drives move, Σ r T, (n_samples,) [N m],
    with their moment arms r [m], less what the drives themselves need; and when joint and drives
    move, so that friction acts against their directions, (n_samples,).
    """
    angle = log.angles[:, joint.index]
    moves = log.is_fast(angle) & np.isfinite(angle)
    total = np.zeros(len(log.time))
    for drive, arm in joint.pulls:
        moves &= log.moves(drive.index)
        factor = drive.effort_sign * drive.winding * drive.torque_constant / drive.lever
        efforts = log.efforts[:, drive.index]
        taken = drive.structure.friction(efforts) * log.directions[:, drive.index]
        total += arm * factor * (efforts - taken)
        if drive.friction is not None:
            speed = log.speed_of(log.positions[:, drive.index])
            needed = drive.friction.damping * speed
            needed += drive.friction.inertia * log.speed_of(speed)
            total -= arm * drive.winding * drive.position_sign * needed / drive.gear / drive.lever
    return total, moves


def unexplained(logs: Logs, without: Sequence[int] = ()) -> Floats:
    """Return the share of each joint's variance that least squares on the drives leave, `without`
    some of them.
    """
    parts = []
    for log in logs:
        samples = np.column_stack([log.positions, log.angles])[log.is_known]
        parts.append(samples - samples.mean(axis=0) if len(samples) else samples)
    positions, angles = np.split(np.vstack(parts), [logs[0].positions.shape[1]], axis=1)
    positions = np.delete(positions, without, axis=1)
    left = angles - positions @ np.linalg.lstsq(positions, angles)[0]
    return np.asarray(np.sum(left**2, axis=0) / np.maximum(np.sum(angles**2, axis=0), 1e-300))


def joints_of(references: Columns, logs: Logs) -> list[FoundJoint]:
    """Return the joints; one that is a line of another one before it follows that rigidly."""
    angles = np.vstack([log.angles[log.is_known] for log in logs])
    joints = list[FoundJoint]()
    for j, column in enumerate(references):
        joint = FoundJoint(j, column)
        for before in joints:
            if before.follows is not None or len(angles) < 10:
                continue
            line = np.polynomial.Polynomial.fit(angles[:, before.index], angles[:, j], 1)
            residuals = angles[:, j] - line(angles[:, before.index])
            if rms(residuals) < THRESHOLDS.rigid * np.ptp(angles[:, j]):
                joint = FoundJoint(j, column, before, float(line.convert().coef[1]))
                break
        joints.append(joint)
    return joints


def drives_of(
    columns: Columns,
    joints: Joints,
    free: Sequence[int],
    logs: Logs,
) -> tuple[list[FoundDrive], list[str], list[str]]:
    """Return the drives that move joints, what cannot be told of them, and which were left out.

    Raises:
        RigError: no drive moves a joint that is `free`.
    """
    positions = of_role(columns, "position")
    efforts = {column.part: column for column in of_role(columns, "effort")}
    structures = dict[int, DriveStructure]()
    left = []
    for d, column in enumerate(positions):
        structure = drive_structure(logs, d, free)
        helps = (unexplained(logs) < BETTER**2 * unexplained(logs, [d])).any()
        if structure is not None and (structure.explained >= EXPLAINED or helps):
            structures[d] = structure
        else:
            left.append(f"{column.header} moves none of the joints that are known: left out")
    shared = _move_all(structures, free, logs)
    untellable = [
        _rival(positions[d], structure, joints)
        for d, structure in structures.items()
        if structure.rival
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
    unmoved = [joints[j].angle.header for j in free if j not in moved]
    if unmoved:
        raise RigError(
            f"no drive moves {', '.join(unmoved)}; is that a joint of this rig? If not, leave its "
            "column out by --ignore"
        )
    is_opposed = len(structures) > len(moved)
    drives = [
        found_drive(logs, d, structure, positions[d], efforts.get(positions[d].part), is_opposed)
        for d, structure in structures.items()
    ]
    return drives, untellable, left


def _move_all(
    structures: dict[int, DriveStructure], free: Sequence[int], logs: Logs
) -> list[tuple[int, int]]:
    """Let each joint that none moves be moved by the drive that may as well move it, or else, where
    the drives tell its angle, by the one whose motion it explains best; return joint and drive of
    the latter.
    """
    shared = list[tuple[int, int]]()
    is_explained = unexplained(logs) <= 1.0 - EXPLAINED
    for joint in free:
        if any(joint in structure.joints for structure in structures.values()):
            continue
        rival = _rival_of(joint, structures)
        if rival is not None:
            swapped = structures[rival]
            structures[rival] = described(logs, rival, swapped.rival, swapped.joints)
        elif structures and is_explained[joint]:
            added = {
                d: added_error(logs, d, other.joints, joint) for d, other in structures.items()
            }
            best = min(added, key=lambda d: added[d])
            moved = tuple(sorted((*structures[best].joints, joint)))
            structures[best] = described(logs, best, moved, ())
            shared.append((joint, best))
    return shared


def _rival_of(joint: int, structures: dict[int, DriveStructure]) -> int | None:
    """Return the drive that may as well move a joint, and whose own joints others move too."""
    for d, structure in structures.items():
        elsewhere = {j for e, other in structures.items() if e != d for j in other.joints}
        if joint in structure.rival and set(structure.joints) <= elsewhere:
            return d
    return None


def _rival(column: ColumnRole, structure: DriveStructure, joints: Joints) -> str:
    chosen, rival = (
        " and ".join(joints[j].name for j in indices)
        for indices in (structure.joints, structure.rival)
    )
    return (
        f"{column.header}: cannot be told whether it moves {chosen} or {rival}; a log in which it "
        "moves alone for 5 s would tell"
    )


def check_arms(joints: Joints, drives: Drives) -> None:
    """Raise a `RigError` where the largest moment arm of a drive that is read in metres cannot be;
    about other axes it may be anything, down to none.
    """
    shortest, longest, _ = USUAL["radius"]
    for drive in drives:
        arms = np.abs(drive.arms)
        arm = np.max(arms)
        if drive.is_slider and not shortest <= arm <= longest:
            joint = joints[drive.structure.joints[int(np.argmax(arms))]]
            raise RigError(
                f"{drive.position.header} moves by {1e3 * arm:.4g} mm for each rad of "
                f"{joint.angle.header}; a hand's arms are {1e3 * shortest:g} to "
                f"{1e3 * longest:g} mm. Is the unit of one of them right?"
            )


def check_explained(
    joints: Joints,
    free: Sequence[int],
    logs: Logs,
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
    left = unexplained(logs)
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


def drive_in_words(drive: FoundDrive, joints: Joints) -> str:
    """Return what a drive moves, in a line."""
    structure = drive.structure
    unit, factor = ("mm", 1e3) if drive.is_slider else ("rad", 1.0)
    parts = [
        f"{joints[j].name} ({factor * ratio:+.4g} ± {factor * std:.1g} {unit} for each rad)"
        for j, ratio, std in zip(structure.joints, structure.ratios, structure.ratio_stds)
    ]
    kind = "one tendon"
    if drive.is_pair:
        kind = "two tendons on its spool" if drive.effort else "two tendons on its spool (a guess)"
    return (
        f"{drive.name} moves {', '.join(parts)} by {kind}; this explains "
        f"{100 * structure.explained:.2f} % of its motion"
    )


REVERSAL = 3.0
"""Distance after which a drive has changed its direction, in standard deviations of its sensor's
random error. Source: judgement.
"""

TRIMMED = 4.44
"""Residual beyond which a sample is an outlier and is left out, in medians of absolute residuals.
Source: judgement (three robust standard deviations of 1.48).
"""

LEAST_RATIO = 3.0
"""Ratio of an estimate to its standard error, above which it is written. Source: judgement."""

INDEPENDENT_TIME = 0.25
"""Time after which residuals count as independent [s]. Source: judgement."""

FEWEST_OF_DRIVE = 100
"""Least number of samples of a drive for an estimate. Source: judgement."""


def servos_of(logs: Sequence[Log], rig: Rig) -> dict[str, object]:
    """Return path by names → value of the servos whose setpoints are in the logs: stiffness [N
    m/rad of a capstan, N/m of a slider] and dead band [rad, m].

    A value is left out where it is not clearly above zero.
    """
    servos: dict[str, object] = {}
    for drive in rig.drives:
        parts = [part for log in logs for part in _servo_rows(log, rig, drive)]
        if sum(len(errors) for _, errors in parts) < FEWEST_OF_DRIVE:
            continue
        matrix, errors = stacked(parts)
        window = max(round(INDEPENDENT_TIME / np.mean(np.diff(logs[0].time))), 1)
        kept = np.ones(len(errors), dtype=bool)
        for _ in range(3):
            values, stds = with_errors(matrix[kept], errors[kept], window)
            residuals = np.abs(errors - matrix @ values)
            kept = residuals <= TRIMMED * np.median(residuals[kept]) + 1e-12
        path = f"drives.{drive.name}.servo"
        if values[0] > LEAST_RATIO * stds[0]:
            servos[f"{path}.stiffness"] = float(f"{1.0 / values[0]:.6g}")
        if values[1] > LEAST_RATIO * stds[1]:
            servos[f"{path}.dead_band"] = float(f"{values[1]:.6g}")
    return servos


def _servo_rows(log: Log, rig: Rig, drive: Capstan | Slider) -> Iterator[Equations]:
    """Yield the columns F, d and ds/dt of a drive, (k, 3), and its errors u − s, (k,); nothing
    where the log lacks setpoint, position or force.
    """
    sensors = {s.measures: s for s in rig.sensors if s.of == drive.name and s.name in log.channels}
    if drive.name not in log.goals or not {"position", "force"} <= {*sensors}:
        return
    position, force = (log.channels[sensors[kind].name] for kind in ("position", "force"))
    half = max(REVERSAL * sensors["position"].noise, 1e-9)
    is_read = np.isfinite(position)
    way = np.full(len(log), np.nan)  # the last direction of motion, −1 to 1
    way[is_read] = (position[is_read] - played(position[is_read], half)) / half
    matrix = np.column_stack([force, way, np.gradient(position, log.time)])
    errors = log.goals[drive.name] - position
    known = np.isfinite(matrix).all(axis=1) & np.isfinite(errors)
    yield matrix[known], errors[known]
