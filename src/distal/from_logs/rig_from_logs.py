"""`rig_from_logs`: a rig file from logs alone. Its raw description comes from columns, structure
and sizes, each guess marked.

The tendons of a joint pass over all joints before it. A joint so comes before another one if
tendons of all drives of the latter cross it. Of two joints with the same drives the one whose
column comes first is taken to be the first. Their axes are taken as parallel. Links are point
masses at two thirds of their length: a rod of 4/3 of that mass has the same moments.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from distal.errors import RigError, one_line
from distal.from_logs.column_values import TAKEN_FORCES, ColumnRole
from distal.from_logs.columns import Overrides, column_roles
from distal.from_logs.drafted_parts import (
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
from distal.from_logs.drives_and_joints import (
    check_arms,
    check_explained,
    check_moved,
    drive_in_words,
    drives_of,
    joints_of,
    unexplained,
)
from distal.from_logs.found_parts import FoundDrive, FoundJoint, pulls_of
from distal.from_logs.link_masses import MASS, Links, links_of
from distal.from_logs.mistakes import left_columns, remarks
from distal.from_logs.motion_data import MotionData, motion_data
from distal.from_logs.raw_log import (
    RawLog,
    rates_of,
    read_raw,
    time_unit,
    with_same_columns,
    without_repeats,
)
from distal.from_logs.which_drive_moves_what import EXPLAINED
from distal.logs import Source, name_and_unit
from distal.model import GRAVITY
from distal.rig import Guess, Imported, Rig


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

    def path(j: int) -> tuple[int, ...]:
        follows = joints[j].follows
        before = parents[j] if follows is None else names.index(follows)
        return (j,) if before is None else (*path(before), j)

    return sorted(range(len(joints)), key=path)


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
    rate: float | None = None,
    name: str = "rig from logs",
) -> RigFromLogs:
    """Return the rig that logs show: columns, structure and sizes; no rig file is needed.

    Args:
        logs: paths or frames with the same columns.
        truth: columns of joints' reference angles, where names do not say so.
        drives: column of a drive's position → its unit, or empty.
        ignore: columns that are none of this.
        rate: of evenly spaced rows, where no column holds their time [Hz].
        name: title of the rig.

    Raises:
        LogError: a log cannot be read, or has no time.
        RigError: no drive or no joint can be found; says what would help.
    """
    overrides = Overrides(tuple(truth), dict(drives or {}), tuple(ignore))
    # what names leave open is asked before long logs are read
    _ask(column_roles([read_raw(logs[0], FIRST_ROWS, rate)], overrides))
    raw, lacking = with_same_columns([read_raw(path, rate=rate) for path in logs])
    columns = column_roles(raw, overrides)
    _ask(columns)
    references = [column for column in columns if column.role == "angle"]
    time = next(column for column in columns if column.role == "time")
    unit, notes = time_unit(time, raw)
    notes += left_columns(raw, columns, lacking)
    time = replace(time, unit=unit)
    columns = [time if column.role == "time" else column for column in columns]
    pairs = [without_repeats(log, time.header) for log in raw]
    repeated = next((done for _, done in pairs if done is not None), None)
    if repeated is not None:
        done = "they are spread evenly" if repeated == "spread" else "the first ones are kept"
        count = sum(log.rows - len(np.unique(log.columns[time.header])) for log in raw)
        notes.append(f"{count} rows have the stamp of the row before: {done}")
    raw = [log for log, _ in pairs]
    data = [motion_data(log, columns) for log in raw]
    _ask_others(columns, raw, data)
    notes += remarks(raw, columns, data)
    joints = joints_of(references, data)
    free = [j for j, joint in enumerate(joints) if joint.follows is None]
    moving, untellable, left = drives_of(columns, joints, free, data)
    notes += left
    check_moved(joints, free, moving)
    check_arms(joints, moving)
    asked = [c.header for c in references if {c.header, name_and_unit(c.header)[0]} & {*truth}]
    notes += check_explained(joints, free, data, asked)
    rates = rates_of(raw, time, unit)
    description = raw_description(name, time, rates, joints, moving, data)
    if repeated is not None:
        description["log"] = {"time": {**log_time(time), "repeated": repeated}}
    if rate is not None:
        description["log"] = {"time": {"rate": rate}}
    imported = Imported.of(description, name, "logs", ())
    structure = tuple(drive_in_words(drive, joints) for drive in moving)
    return RigFromLogs(
        imported.rig,
        imported.text,
        tuple(columns),
        structure,
        tuple(untellable),
        tuple(notes),
        imported.missing,
    )


FIRST_ROWS = 2000
"""Rows of the first log by which columns are asked before the others are read. Source: judgement.
"""


def _ask(columns: Sequence[ColumnRole]) -> None:
    """Raise a `RigError` where it is open which columns are drives and which are joints; it
    proposes the options that say so.
    """
    positions = [column for column in columns if column.role == "position"]
    references = [column for column in columns if column.role == "angle"]
    if not positions:
        raise RigError(
            f"no column is taken as a drive's position ({_all(columns)}); name one by --drive"
        )
    if not references:
        raise RigError(
            f"no column is taken as a joint's angle ({_all(columns)}); name one by --truth. "
            "Logs tell how far joints turn only with such a column, from a camera or a temporary "
            "encoder: three logs of 40 s are enough"
        )
    unsure = [c.header for c in (*positions, *references) if c.sureness == "a guess"]
    if unsure:
        options = [part for c in positions for part in ("--drive", c.header)]
        options += ["--truth", ",".join(column.header for column in references)]
        raise RigError(
            f"nothing but its values says what {', '.join(unsure)} is; if this is right, add: "
            f"{shlex.join(options)}"
        )


def _ask_others(
    columns: Sequence[ColumnRole], raw: Sequence[RawLog], logs: Sequence[MotionData]
) -> None:
    """Raise a `RigError` where a column whose name says nothing moves as the drives do, so that it
    may be a joint that was forgotten.
    """
    joints = ",".join(column.header for column in columns if column.role == "angle")
    for column in columns:
        if column.role != "other" or column.sureness != "a guess":
            continue
        as_angle = replace(column, role="angle", unit="", si="")
        moved = [motion_data(log, [*_without_angles(columns), as_angle]) for log in raw]
        left = float(unexplained(moved, range(logs[0].positions.shape[1]))[0])
        if left <= 1.0 - EXPLAINED:
            every = shlex.quote(f"{joints},{column.header}")
            raise RigError(
                f"{column.header} moves as the drives do ({100 * (1 - left):.0f} %), and its name "
                f"does not say what it is. Is it a joint, --truth {every}, or none of this, "
                f"--ignore {shlex.quote(column.header)}?"
            )


def _without_angles(columns: Sequence[ColumnRole]) -> list[ColumnRole]:
    return [column for column in columns if column.role != "angle"]


def _all(columns: Sequence[ColumnRole]) -> str:
    return one_line("; ".join(f"{column.header}: {column.role}" for column in columns), 180)
