"""`rig_from_logs`: a rig file from logs alone. Its raw description comes from columns, structure
and sizes, each guess marked. `draft_columns` finds the readings of a given rig file, whose
columns it does not name.

The tendons of a joint pass over all joints before it. A joint so comes before another one if
tendons of all drives of the latter cross it. Of two joints with the same drives the one whose
column comes first is taken to be the first. Their axes are taken as parallel. Links are point
masses at two thirds of their length: a rod of 4/3 of that mass has the same moments.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np

from distal.errors import LogError, RigError, did_you_mean, one_line
from distal.from_logs.column_names import (
    LIKELY,
    ROLES,
    SURE,
    TAKEN_FORCES,
    ColumnRole,
    Columns,
    NameEvidence,
    Names,
    Role,
    Sureness,
    ValueEvidence,
    best_role,
    name_evidence,
    of_role,
    value_evidence,
    with_families,
    with_units,
)
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
from distal.from_logs.drive_and_tendon_sizes import (
    Drives,
    Joints,
    check_arms,
    check_explained,
    drive_in_words,
    drives_of,
    joints_of,
    unexplained,
    with_pulls,
)
from distal.from_logs.link_masses_and_stops import MASS, Links, links_of
from distal.from_logs.motion_data import (
    Logs,
    RawLog,
    motion_data,
    read_raw,
    time_column,
    with_rates,
    with_same_columns,
    with_values,
    without_repeats,
)
from distal.from_logs.which_drive_moves_what import EXPLAINED, left_columns, remarks
from distal.logs import Source, name_and_unit, says_nothing
from distal.model import GRAVITY
from distal.rig import Guess, Imported, Rig, name_of

CERTAIN = 99.0
"""How much a user's word speaks for a role [1]. Source: definition (more than any name)."""


@dataclass(frozen=True)
class Overrides:
    """What a user says of columns.

    Args:
        truth: headers of joints' reference angles.
        drives: header of a drive's position → its unit, or empty.
        ignore: headers that are none of this.
    """

    truth: Sequence[str] = ()
    drives: Mapping[str, str] = field(default_factory=dict)
    ignore: Sequence[str] = ()


def column_roles(logs: Sequence[RawLog], overrides: Overrides) -> list[ColumnRole]:
    """Return what each column of some logs is, which have the same columns, in their order.

    Raises:
        LogError: none is a time, a unit is not known, or an override names a column that is not
            there, or the time.
    """
    headers = list(logs[0].columns)
    drives = {_header(name, headers): unit for name, unit in overrides.drives.items()}
    given: Mapping[Role, Iterable[str]] = {
        "angle": overrides.truth,
        "position": drives,
        "other": overrides.ignore,
    }
    roles_by_name = {_header(name, headers): role for role in given for name in given[role]}
    alone = {header: name_evidence(header, headers) for header in headers}
    time = time_column(logs, alone)
    names = with_families(with_values(alone, logs, time))
    values = {header: value_evidence([log.columns[header] for log in logs]) for header in headers}
    if time in roles_by_name:
        raise LogError(f"'{time}' is the only column that increases: it is the time")
    # nothing else is a second time
    scores = {header: {**names[header].scores, "time": -CERTAIN} for header in headers}
    unused = [h for h in headers if values[h].is_constant or names[h].best == "time"]
    known: dict[str, Role] = {**dict.fromkeys(unused, "other"), time: "time", **roles_by_name}
    for header, role in known.items():
        scores[header][role] = CERTAIN
    open_headers = [header for header in headers if header not in known]
    # where a user names some, a column whose name does not say so is none
    for asked in ("position", "angle"):
        for header in open_headers if given[asked] else ():
            if names[header].scores[asked] < SURE:
                scores[header][asked] = -CERTAIN
    _tell_joints(scores, open_headers, names)
    found = []
    for header in headers:
        column = _role(header, scores[header], names[header], values[header])
        if column.role not in ("other", "command") and names[header].unknown_unit:
            raise LogError(
                f"column '{header}': the unit '{names[header].unknown_unit}' is not known; rename "
                "the column with one like mm, deg, N, N mm, mA or counts, or leave it out by "
                "--ignore"
            )
        if column.role == "effort":
            why = says_nothing(np.concatenate([log.columns[header] for log in logs]))
            if why is not None:
                column = replace(column, role="other", evidence=why)
        found.append(column)
    return with_rates(with_units(_with_parts(found, names), names, drives), logs)


def _header(name: str, headers: Sequence[str]) -> str:
    """Return the header of a column by that, or by its name without the unit.

    Raises:
        LogError: no column is called so.
    """
    for header in headers:
        if name in (header, name_and_unit(header)[0]):
            return header
    raise LogError(f"there is no column '{name}' in these logs{did_you_mean(name, headers)}")


def _tell_joints(
    scores: Mapping[str, dict[Role, float]],
    headers: Sequence[str],
    names: Names,
) -> None:
    """Take columns that may be drives or joints for the ones where names tell only the others.
    Where names or units tell others, those whose names say nothing are passed over; where they tell
    neither, the last one may be a joint's. `scores` are changed in place.
    """
    movers = [h for h in headers if best_role(scores[h]) in ("position", "angle")]
    unclear = [header for header in movers if abs(names[header].margin) < LIKELY]
    named = {names[header].best for header in {*movers} - {*unclear}}
    others_say = len(named) > 1 or not all(names[header].says_nothing for header in unclear)
    for header in unclear:
        if others_say and names[header].says_nothing:
            scores[header]["other"] += LIKELY
        elif len(named) == 1:
            scores[header]["angle" if "position" in named else "position"] += 2.0 * LIKELY
    if unclear and not named:
        scores[unclear[-1]]["angle"] += LIKELY / 2.0


def _role(
    header: str, scores: Mapping[Role, float], name: NameEvidence, values: ValueEvidence
) -> ColumnRole:
    """Return the best role of a column, with how sure it is."""
    best = best_role(scores)
    role: Role = best if scores[best] > 0.0 or name.says_nothing else "other"
    margin = scores[best] - max(0.0, *(scores[each] for each in scores if each != best))
    sureness: Sureness = "a guess"
    if scores[best] >= CERTAIN or name.scores[role] > 0.0:
        sureness = "sure" if margin >= SURE else "likely" if margin >= LIKELY else "a guess"
    reasons = ["its name says so"] if name.scores[role] >= LIKELY else []
    if values.is_constant:
        reasons.append("its value never changes")
    else:
        reasons.append(f"values from {values.low:.4g} to {values.high:.4g}")
    if values.turn is not None and role in ("position", "angle"):
        reasons.append(f"wraps after {values.turn:.6g}")
    elif values.step > 0.0:
        reasons.append(f"in steps of {values.step:.3g}")
    elif values.noise > 0.0:
        reasons.append(f"noise {values.noise:.2g}")
    return ColumnRole(header, role, "", "", "", sureness, "a guess", ", ".join(reasons), values)


def _with_parts(columns: Columns, names: Names) -> list[ColumnRole]:
    """Return columns with the drive or joint that each is of. An effort or a command is of the
    drive of its name, else of the next one in order.
    """
    parts: dict[Role, dict[str, str]] = {role: {} for role in ROLES}
    for column in columns:
        alike = parts[column.role]
        kind, otherwise = ("joint", "joint") if column.role == "angle" else ("m", "motor")
        subject = names[column.header].subject
        name = name_of(f"{kind}{subject}" if subject[:1].isdigit() else subject or otherwise, kind)
        if name in alike.values() or (not subject and alike):
            name = f"{name}_{len(alike) + 1}"
        alike[column.header] = name
    parts["time"] = parts["other"] = {}
    drives = list(parts["position"].values())
    for role in ("effort", "command"):
        left = [drive for drive in drives if drive not in parts[role].values()]
        unmatched = [header for header, name in parts[role].items() if name not in drives]
        parts[role] |= dict(zip(unmatched, left))
    return [replace(c, part=parts[c.role].get(c.header, "")) for c in columns]


ROLE_OF: Mapping[str, Role] = {"position": "position", "force": "effort", "angle": "angle"}
"""What a sensor measures → the role of its column."""


@dataclass(frozen=True)
class DraftColumns:
    """Where logs hold what a rig file's sensors read.

    Args:
        assignments: what to set in the rig file, ``path=value``.
        in_words: a line for each column that was found.
    """

    assignments: tuple[str, ...]
    in_words: tuple[str, ...]


def draft_columns(
    rig: Rig,
    logs: Sequence[Source],
    *,
    truth: Sequence[str] = (),
    drives: Mapping[str, str] | None = None,
    ignore: Sequence[str] = (),
    rate: float | None = None,
) -> DraftColumns:
    """Return the columns of sensors whose own the logs do not have.

    A column is a sensor's if it is that drive's position or effort, or that joint's angle, by its
    name; or if the rig has one sensor and the logs have one column of a kind.

    Args:
        rig: the draft, which is a rig file already.
        logs: paths or frames with the same columns.
        truth: columns of joints' reference angles, where names do not say so.
        drives: column of a drive's position → its unit, or empty.
        ignore: columns that are none of this.
        rate: of evenly spaced rows, where no column holds their time [Hz].

    Raises:
        LogError: a log cannot be read, or has no time.
    """
    raw, _ = with_same_columns([read_raw(path, rate) for path in logs])
    columns = column_roles(raw, Overrides(truth, drives or {}, ignore))
    (time,) = of_role(columns, "time")
    headers = {name for column in columns for name in (column.header, column_of(column))}
    assignments = list[str]()
    lines = list[str]()
    if rate is not None:
        assignments.append(f"log.time.rate={rate}")
    elif rig.log.time.rate is None and rig.log.time.column not in headers:
        assignments.append(f"log.time={{column={_quoted(time)},unit='{time.unit}'}}")
        lines.append(f"the time is in column {time.header}")
    for measures, role in ROLE_OF.items():
        sensors = [sensor for sensor in rig.sensors if sensor.measures == measures]
        alike = of_role(columns, role)
        by_part = {_plain(column.part): column for column in alike}
        parts = [_plain(sensor.of) for sensor in sensors]
        for sensor, part in zip(sensors, parts):
            column = by_part.get(part) if parts.count(part) == 1 else None
            if len(sensors) == len(alike) == 1:
                column = alike[0]
            if column is None or sensor.log_column in headers:
                continue
            name = sensor.name
            assignments.append(f"sensors.{name}.column={_quoted(column)}")
            assignments.append(f"sensors.{name}.rate={column.rate}")
            if name_and_unit(column.header)[1] is not None:
                assignments.append(f"sensors.{name}.unit='{column.unit}'")
            lines.append(f"{name} is read in column {column.header}")
    return DraftColumns(tuple(assignments), tuple(lines))


def _quoted(column: ColumnRole) -> str:
    """Return a column's name as a TOML string, which a quotation mark in it does not end."""
    return json.dumps(column_of(column), ensure_ascii=False)


def _plain(name: str) -> str:
    """Return a name without what spellings differ in: motor_1, Motor 1, m1 and 1 are one."""
    letters = "".join(letter for letter in name.lower() if letter.isalnum())
    return re.sub(r"^(motor|servo|drive|m)(?=\d+$)", "", letters)


def parents_of(joints: Joints) -> list[int | None]:
    """Return the joint on whose link each joint sits, None for the base.

    Joints whose tendons' forces are not read, or that follow others, are on the base: no log shows
    the weight of what they carry.
    """
    crossing = [{drive.index for drive, _ in joint.pulls if joint.is_read} for joint in joints]
    order = sorted(range(len(joints)), key=lambda j: (-len(crossing[j]), j))
    parents: list[int | None] = [None] * len(joints)
    for rank, j in enumerate(order):
        before = [i for i in order[:rank] if crossing[j] <= crossing[i]]
        if crossing[j] and before:
            parents[j] = before[-1]
    return parents


def in_series(raw: Raw, joints: Joints, logs: Logs) -> Raw:
    """Return a raw description, in which each joint sits on the base, with links that joints in
    series carry, if logs tell that they do.
    """
    parents = parents_of(joints)
    carrying = [j for j in range(len(joints)) if parents[j] is not None or j in parents]
    if not carrying:
        return raw
    usual = Links(dict.fromkeys(carrying, (MASS, MASS)), (GRAVITY, GRAVITY))
    rig = Imported.of(_with_links(raw, joints, parents, usual), "links", "logs", ()).rig
    links = links_of(rig, carrying, joints, logs)
    return raw if links is None else _with_links(raw, joints, parents, links)


def _with_links(raw: Raw, joints: Joints, parents: Sequence[int | None], links: Links) -> Raw:
    """Return a description in which joints have such links."""
    described = [{**joint} for joint in cast(list[Raw], raw["joints"])]
    for j, (mass, std) in links.masses.items():
        parent = parents[j]
        described[j]["inertia"] = Guess("2e-6 kg m^2", "inertia of joints")
        described[j]["link"] = {
            "mass": about(mass, std / mass, "g"),
            "centre": [number(2.0 * LENGTH / 3.0, "mm"), "0 mm", "0 mm"],
        }
        if parent is not None:
            offset = [number(LENGTH, "mm"), "0 mm", "0 mm"]
            described[j]["parent"] = joints[parent].name
            described[j]["offset"] = Guess(offset, "lengths of links")
    along_x, along_z = (number(part, "m/s^2") for part in links.gravity)
    gravity: object = [along_x, "0 m/s^2", along_z]
    if links.gravity == (0.0, 0.0):
        gravity = Guess(gravity, "which way gravity points")
    order = _in_order(joints, parents)
    return {**raw, "base": {"gravity": gravity}, "joints": [described[j] for j in order]}


def _in_order(joints: Joints, parents: Sequence[int | None]) -> list[int]:
    """Return the joints, each behind the one that carries it and the one that it follows."""

    def path(j: int) -> tuple[int, ...]:
        follows = joints[j].follows
        before = parents[j] if follows is None else follows.index
        return (j,) if before is None else (*path(before), j)

    return sorted(range(len(joints)), key=path)


LENGTH = 40.0
"""Length of a link [mm]. Source: reference (proximal phalanx of an index finger, 39.8 mm; Buryanov
and Kotiuk 2010).
"""

TRUTH = "true_"
"""Beginning of the columns in which a log has its own truth, which a rig file needs not name.
Source: `distal.logs.Log.columns`.
"""


def raw_description(
    title: str,
    time: Raw,
    joints: Joints,
    drives: Drives,
    logs: Logs,
) -> Raw:
    """Return the description of a rig; what no log tells is a `Guess` with a wide std.

    Args:
        title: name of the rig.
        time: where a log has it.
        joints: in the order of their columns.
        drives: the same.
        logs: all of them.
    """
    taken = []
    if any(not drive.is_slider for drive in drives):
        taken.append("length")
    efforts = [drive.effort for drive in drives]
    # none is read, or it is no force or torque of a true scale
    if any(e is None or e.si == "A" or e.unit in TAKEN_FORCES.values() for e in efforts):
        taken.append("force")
    raw: Raw = {
        "name": title,
        "taken": taken,
        "log": {"time": time},
        "joints": [raw_joint(joint, logs) for joint in joints],
        "drives": [raw_drive(drive) for drive in drives],
        "tendons": [tendon for drive in drives for tendon in raw_tendons(drive, joints)],
        "sensors": [
            *(sensor for drive in drives for sensor in drive_sensors(drive)),
            *(reference(joint) for joint in joints if not joint.angle.header.startswith(TRUTH)),
        ],
    }
    return in_series(raw, joints, logs)


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
    overrides = Overrides(truth, drives or {}, ignore)
    raw, lacking = with_same_columns([read_raw(path, rate) for path in logs])
    columns = column_roles(raw, overrides)
    _ask(columns)
    (time,) = of_role(columns, "time")
    notes = left_columns(raw, columns, lacking)
    rows = np.concatenate([np.diff(log.columns[time.header]) for log in raw])
    raw, repeated = without_repeats(raw, time.header)
    if repeated:
        done = "they are spread evenly" if repeated == "spread" else "the first ones are kept"
        notes.append(f"{np.sum(rows == 0.0)} rows have the stamp of the row before: {done}")
    data = [motion_data(log, columns) for log in raw]
    _ask_others(columns, raw)
    notes += remarks(raw, columns, data)
    joints = joints_of(of_role(columns, "angle"), data)
    free = [j for j, joint in enumerate(joints) if joint.follows is None]
    moving, untellable, left = drives_of(columns, joints, free, data)
    notes += left
    joints = [with_pulls(joint, moving) for joint in joints]
    check_arms(joints, moving)
    headers = [column.header for column in columns]
    notes += check_explained(joints, free, data, [_header(name, headers) for name in truth])
    log_time: Raw = {"column": column_of(time), "unit": time.unit}
    if repeated:
        log_time["repeated"] = repeated
    if rate is not None:
        log_time = {"rate": rate}
    description = raw_description(name, log_time, joints, moving, data)
    imported = Imported.of(description, name, "logs", ())
    return RigFromLogs(
        imported.rig,
        imported.text,
        tuple(columns),
        tuple(drive_in_words(drive, joints) for drive in moving),
        tuple(untellable),
        tuple(notes),
        imported.missing,
    )


def _ask(columns: Columns) -> None:
    """Raise a `RigError` where it is open which columns are drives and which are joints; it
    proposes the options that say so.
    """
    positions = of_role(columns, "position")
    references = of_role(columns, "angle")
    every = one_line("; ".join(f"{column.header}: {column.role}" for column in columns), 180)
    if not positions:
        raise RigError(f"no column is taken as a drive's position ({every}); name one by --drive")
    if not references:
        raise RigError(
            f"no column is taken as a joint's angle ({every}); name one by --truth. "
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


def _ask_others(columns: Columns, raw: Sequence[RawLog]) -> None:
    """Raise a `RigError` where a column whose name says nothing moves as the drives do, so that it
    may be a joint that was forgotten.
    """
    joints = ",".join(column.header for column in of_role(columns, "angle"))
    others = of_role(columns, "time", "position")
    for column in of_role(columns, "other"):
        if column.sureness != "a guess":
            continue
        as_angle = replace(column, role="angle", unit="", si="")
        moved = [motion_data(log, [*others, as_angle]) for log in raw]
        left = unexplained(moved)[0]
        if left <= 1.0 - EXPLAINED:
            every = shlex.quote(f"{joints},{column.header}")
            raise RigError(
                f"{column.header} moves as the drives do ({100 * (1 - left):.0f} %), and its name "
                f"does not say what it is. Is it a joint, --truth {every}, or none of this, "
                f"--ignore {shlex.quote(column.header)}?"
            )
