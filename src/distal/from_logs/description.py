"""The raw description of a rig from columns, structure and sizes, each guess marked.

Joints that carry one another.

The tendons of a joint pass over all joints before it. A joint so comes before another one if
tendons of all drives of the latter cross it. Of two joints with the same drives the one whose
column comes first is taken to be the first. Their axes are taken as parallel. Links are point
masses at two thirds of their length: a rod of 4/3 of that mass has the same moments.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import cast

from distal.from_logs.column_units import TAKEN_FORCES, ColumnRole
from distal.from_logs.found_parts import FoundDrive, FoundJoint, pulls_of
from distal.from_logs.link_masses import MASS, Links, links_of
from distal.from_logs.motion_data import MotionData
from distal.from_logs.raw_parts import (
    Raw,
    about,
    column_of,
    drive_sensors,
    number,
    raw_drive,
    raw_joint,
    raw_tendons,
    reference,
)
from distal.model import GRAVITY
from distal.rig import Guess, Imported


def parents_of(joints: Sequence[FoundJoint], drives: Sequence[FoundDrive]) -> list[int | None]:
    """Return the joint on whose link each joint sits, None for the base.

    Joints whose tendons' forces are not read, or that follow others, are on the base: no log shows
    the weight of what they carry.
    """
    crossing = [{drive.index for drive, _ in pulls_of(j, drives)} for j in range(len(joints))]
    read = {drive.index for drive in drives if drive.effort is not None}
    able = [bool(indices) and indices <= read for indices in crossing]
    order = sorted(range(len(joints)), key=lambda j: (-len(crossing[j]), j))
    parents: list[int | None] = [None] * len(joints)
    for rank, j in enumerate(order):
        before = [i for i in order[:rank] if able[i] and crossing[j] <= crossing[i]]
        if able[j] and before:
            parents[j] = before[-1]
    return parents


def in_series(
    raw: Raw,
    joints: Sequence[FoundJoint],
    drives: Sequence[FoundDrive],
    logs: Sequence[MotionData],
) -> Raw:
    """Return a raw description in which joints in series carry links, if logs tell that they do.

    Args:
        raw: the description, in which each joint sits on the base.
        joints: in the order of their columns.
        drives: all of them.
        logs: all of them.
    """
    parents = parents_of(joints, drives)
    carrying = [j for j in range(len(joints)) if parents[j] is not None or j in parents]
    if not carrying:
        return raw
    usual = Links(True, ((MASS, MASS),) * len(carrying), (GRAVITY, GRAVITY))
    rig = Imported.of(_with_links(raw, joints, parents, carrying, usual), "links", "logs", ()).rig
    links = links_of(rig, carrying, joints, drives, logs)
    if not links.joined:
        return raw
    return _with_links(raw, joints, parents, carrying, links)


def _with_links(
    raw: Raw,
    joints: Sequence[FoundJoint],
    parents: Sequence[int | None],
    carrying: Sequence[int],
    links: Links,
) -> Raw:
    """Return a description in which the joints that are `carrying` have such links."""
    described = deepcopy(cast(list[Raw], raw["joints"]))
    length = number(LENGTH, "mm")
    for j, (mass, std) in zip(carrying, links.masses):
        parent = parents[j]
        described[j]["inertia"] = Guess("2e-6 kg m^2", "inertia of joints")
        described[j]["link"] = {
            "mass": about(mass, std / mass, "g"),
            "centre": [number(2.0 * LENGTH / 3.0, "mm"), "0 mm", "0 mm"],
        }
        if parent is not None:
            described[j]["parent"] = joints[parent].name
            described[j]["offset"] = Guess([length, "0 mm", "0 mm"], "lengths of links")
    along_x, along_z = (number(part, "m/s^2") for part in links.gravity)
    gravity: object = [along_x, "0 m/s^2", along_z]
    if links.gravity == (0.0, 0.0):
        gravity = Guess(gravity, "which way gravity points")
    order = _in_order(joints, parents)
    return {**raw, "base": {"gravity": gravity}, "joints": [described[j] for j in order]}


def _in_order(joints: Sequence[FoundJoint], parents: Sequence[int | None]) -> list[int]:
    """Return the joints, each behind the one that carries it and the one that it follows."""
    names = [joint.name for joint in joints]
    order = list[int]()

    def append(j: int) -> None:
        follows = joints[j].follows
        for before in (parents[j], None if follows is None else names.index(follows)):
            if before is not None:
                append(before)
        if j not in order:
            order.append(j)

    for j in range(len(joints)):
        append(j)
    return order


LENGTH = 40.0
"""Length of a link [mm]. Source: reference (proximal phalanx of an index finger, 39.8 mm; Buryanov
and Kotiuk 2010).
"""

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
