"""`rig_from_logs`: a rig file from logs alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from distal.errors import RigError
from distal.from_logs.column_role import ColumnRole, Overrides
from distal.from_logs.columns import column_roles
from distal.from_logs.description import raw_description
from distal.from_logs.found_parts import FoundDrive, FoundJoint
from distal.from_logs.mistakes import mistakes, remarks
from distal.from_logs.motion_data import MotionData, motion_data
from distal.from_logs.raw_log import RawLog, read_raw
from distal.from_logs.sizes import drive_sizes
from distal.from_logs.structure import EXPLAINED, DriveStructure, as_rival, drive_structure
from distal.logs import Source
from distal.rig import Imported, Rig

RIGID = 0.01
"""A joint follows another rigidly if what a line leaves is below this share of its range. Source:
judgement.
"""

SLOWEST = 0.5
"""Least rate of a log [Hz]. Source: judgement."""

FASTEST = 2e4
"""Largest rate of a log [Hz]. Source: judgement."""

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of time in a log [s]. Source: definition."""


@dataclass(frozen=True)
class RigFromLogs:
    """What logs say of a rig.

    Args:
        rig: the rig.
        text: its file, with a comment where a value is a guess.
        columns: what each column is.
        structure: a line for each drive: what it moves and how that is known.
        untellable: what the logs cannot tell, with the motion that would, a line each.
        notes: what was noticed besides.
        guesses: what no log says.
    """

    rig: Rig
    text: str
    columns: tuple[ColumnRole, ...]
    structure: tuple[str, ...]
    untellable: tuple[str, ...]
    notes: tuple[str, ...]
    guesses: tuple[str, ...]


def rig_from_logs(
    logs: Sequence[Source],
    *,
    truth: Sequence[str] = (),
    drives: Mapping[str, str] | None = None,
    ignore: Sequence[str] = (),
    name: str = "rig from logs",
) -> RigFromLogs:
    """Return the rig that logs show: columns, structure and sizes; no rig file is needed.

    Args:
        logs: paths or frames with the same columns.
        truth: columns of joints' reference angles, where names do not say so.
        drives: column of a drive's position → its unit, or empty.
        ignore: columns that are none of this.
        name: title of the rig.

    Raises:
        LogError: a log cannot be read, or has no time.
        RigError: no drive or no joint can be found; says what would help.
    """
    raw = [read_raw(path) for path in logs]
    overrides = Overrides(tuple(truth), dict(drives or {}), tuple(ignore))
    columns = column_roles(raw, overrides)
    positions = [column for column in columns if column.role == "position"]
    references = [column for column in columns if column.role == "angle"]
    if not positions:
        raise RigError(
            f"no column is taken as a drive's position ({_all(columns)}); name one by --drive"
        )
    if not references:
        raise RigError(
            f"no column is taken as a joint's angle ({_all(columns)}); name one by --truth. "
            "Without an angle from a camera or a temporary encoder no log tells which joints there "
            "are"
        )
    time = next(column for column in columns if column.role == "time")
    unit, notes = _time_unit(time, raw)
    data = [motion_data(log, columns) for log in raw]
    wrong = mistakes(raw, columns, data)
    if wrong:
        raise RigError("; ".join(wrong))
    notes += remarks(raw, columns, data)
    joints = _joints(references, data)
    free = [j for j, joint in enumerate(joints) if joint.follows is None]
    moving, untellable, left = _drives(columns, joints, free, data)
    notes += left
    notes += _unmoved(joints, free, moving)
    rates = _rates(raw, time, unit)
    description = raw_description(name, time, unit, rates, joints, moving, data)
    imported = Imported.of(description, name, "logs", ())
    structure = tuple(_in_words(drive, joints) for drive in moving)
    return RigFromLogs(
        imported.rig,
        imported.text,
        tuple(columns),
        structure,
        tuple(untellable),
        tuple(notes),
        imported.missing,
    )


def _all(columns: Sequence[ColumnRole]) -> str:
    return "; ".join(f"{column.header}: {column.role}" for column in columns)


def _time_unit(time: ColumnRole, logs: Sequence[RawLog]) -> tuple[str, list[str]]:
    """Return the unit of time: that of the header where the rate is possible, else by the steps."""
    step = float(np.median(np.concatenate([np.diff(log.columns[time.header]) for log in logs])))
    unit = time.unit if time.unit in TIME_UNITS else "s"
    if SLOWEST <= 1.0 / max(step * TIME_UNITS[unit], 1e-300) <= FASTEST:
        return unit, []
    possible = [
        unit for unit, size in TIME_UNITS.items() if SLOWEST <= 1.0 / (step * size) <= FASTEST
    ]
    if not possible:
        raise RigError(f"{time.header} steps by {step:g}: no unit makes a rate of that")
    note = (
        f"{time.header} steps by {step:g}: taken as {possible[0]}, since in {unit} there would be "
        f"{1.0 / (step * TIME_UNITS[unit]):.3g} samples in a second"
    )
    return possible[0], [note] if time.unit_sureness == "sure" else []


def _rates(logs: Sequence[RawLog], time: ColumnRole, unit: str) -> dict[str, float]:
    """Return how often each column has a new sample [Hz]."""
    log = max(logs, key=lambda log: log.rows)
    stamps = log.columns[time.header] * TIME_UNITS[unit]
    rates = {}
    for name, values in log.columns.items():
        moving = np.isfinite(values)
        rate = max(moving.sum() - 1, 1) / max(float(np.ptp(stamps[moving])), 1e-9)
        rates[name] = float(f"{rate:.3g}")
    return rates


def _joints(references: Sequence[ColumnRole], logs: Sequence[MotionData]) -> list[FoundJoint]:
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
            if np.sqrt(np.mean(residuals**2)) < RIGID * np.ptp(angles[:, j]):
                follows = FoundJoint(column.part, column, before.name, float(slope))
                break
        joints.append(follows or FoundJoint(column.part, column))
    return joints


def _drives(
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
    for d, column in enumerate(positions):
        structure = drive_structure(logs, d, free)
        if structure is None or structure.explained < EXPLAINED:
            left.append(f"{column.header} moves none of the joints that are known: left out")
            continue
        structures[d] = structure
    _move_all(structures, free, logs)
    untellable = [
        _rival(positions[d], structure, joints)
        for d, structure in structures.items()
        if structure.rival is not None
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
) -> None:
    """Let a drive that may as well move a joint which none moves be the one that moves it."""
    for joint in free:
        if any(joint in structure.joints for structure in structures.values()):
            continue
        for d, structure in structures.items():
            elsewhere = {j for e, other in structures.items() if e != d for j in other.joints}
            is_free = set(structure.joints) <= elsewhere
            if structure.rival is not None and joint in structure.rival and is_free:
                structures[d] = as_rival(logs, d, structure)
                break


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


def _unmoved(
    joints: Sequence[FoundJoint], free: Sequence[int], drives: Sequence[FoundDrive]
) -> list[str]:
    moved = {j for drive in drives for j in drive.structure.joints}
    unmoved = [joints[j].name for j in free if j not in moved]
    if unmoved:
        raise RigError(
            f"no drive moves {', '.join(unmoved)}; is that a joint of this rig? If not, leave its "
            "column out by --ignore"
        )
    return []


def _in_words(drive: FoundDrive, joints: Sequence[FoundJoint]) -> str:
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
