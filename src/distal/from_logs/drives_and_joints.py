"""The joints and drives that logs show, and what they cannot tell of them.

What the drives' positions tell of the joints, by least squares: more than the joints tell of them
in a soft body, or where several joints share few drives.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.arrays import Floats
from distal.errors import RigError
from distal.from_logs.column_values import ColumnRole
from distal.from_logs.drive_and_tendon_sizes import drive_sizes
from distal.from_logs.found_parts import FoundDrive, FoundJoint
from distal.from_logs.motion_data import BETTER, THRESHOLDS, MotionData
from distal.from_logs.which_drive_moves_what import (
    EXPLAINED,
    DriveStructure,
    as_rival,
    drive_structure,
    with_joint,
)
from distal.rig.plausibility import USUAL


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
