"""The raw description of a rig from columns, structure and sizes, each guess marked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from distal.from_logs.column_units import TAKEN_FORCES, ColumnRole
from distal.from_logs.found_parts import FoundDrive, FoundJoint
from distal.from_logs.link_chain import in_series
from distal.from_logs.motion_data import MotionData
from distal.from_logs.raw_parts import (
    Raw,
    column_of,
    drive_sensors,
    raw_drive,
    raw_joint,
    raw_tendons,
    reference,
)

TRUTH = "true_"
"""Beginning of the columns in which a log has its own truth. Source: `distal.logs.Log.columns`."""


def raw_description(
    title: str,
    time: ColumnRole,
    rates: Mapping[str, float],
    joints: Sequence[FoundJoint],
    drives: Sequence[FoundDrive],
    logs: Sequence[MotionData],
) -> Raw:
    """Return the description of a rig; what no log tells is a `Guess` with a wide std.

    Args:
        title: name of the rig.
        time: its column.
        rates: header of a column → its samples per second [Hz].
        joints: in the order of their columns.
        drives: the same.
        logs: all of them.
    """
    taken = []
    if any(not drive.sizes.is_slider for drive in drives):
        taken.append("length")
    if not all(_knows_force(drive.effort) for drive in drives):
        taken.append("force")
    raw: Raw = {
        "name": title,
        "taken": taken,
        "log": {"time": log_time(time)},
        "joints": [raw_joint(j, joint, drives, logs) for j, joint in enumerate(joints)],
        "drives": [raw_drive(drive) for drive in drives],
        "tendons": [tendon for drive in drives for tendon in raw_tendons(drive, joints)],
        "sensors": [
            *(sensor for drive in drives for sensor in drive_sensors(drive, rates)),
            *(reference(joint, rates) for joint in joints if not _is_truth(joint.angle)),
        ],
    }
    return in_series(raw, joints, drives, logs)


def log_time(time: ColumnRole) -> Raw:
    """Return where a log has its time."""
    return {"column": column_of(time), "unit": time.unit}


def _is_truth(column: ColumnRole) -> bool:
    """Return whether a log's own truth is in a column, which a rig file needs not name."""
    return column.header.startswith(TRUTH)


def _knows_force(effort: ColumnRole | None) -> bool:
    """Return whether a column is a force or a torque of a true scale."""
    return effort is not None and effort.si != "A" and effort.unit not in TAKEN_FORCES.values()
