"""`rig_from_logs`: a rig file from logs alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from distal.errors import RigError, one_line
from distal.from_logs.column_units import ColumnRole
from distal.from_logs.columns import Overrides, column_roles
from distal.from_logs.description import log_time, raw_description
from distal.from_logs.mistakes import left_columns, mistakes, remarks
from distal.from_logs.motion_data import motion_data
from distal.from_logs.moving_parts import (
    check_arms,
    check_efforts,
    check_moved,
    drive_in_words,
    drives_of,
    joints_of,
)
from distal.from_logs.raw_log import (
    rates_of,
    read_raw,
    time_unit,
    with_same_columns,
    without_repeats,
)
from distal.logs import Source
from distal.rig import Imported, Rig


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
    raw, lacking = with_same_columns([read_raw(path) for path in logs])
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
            "Logs tell how far joints turn only with such a column, from a camera or a temporary "
            "encoder: three logs of 40 s are enough"
        )
    unsure = [c.header for c in (*positions, *references) if c.sureness == "a guess"]
    if unsure:
        raise RigError(
            f"nothing but its values says what {', '.join(unsure)} is ({_all(columns)}); say which "
            "are drives and which are joints by --drive and --truth, or rename the columns"
        )
    time = next(column for column in columns if column.role == "time")
    unit, notes = time_unit(time, raw)
    notes += left_columns(raw, columns, lacking)
    time = replace(time, unit=unit)
    columns = [time if column.role == "time" else column for column in columns]
    distinct = [without_repeats(log, time.header) for log in raw]
    repeats = sum(log.rows for log in raw) - sum(log.rows for log in distinct)
    if repeats:
        notes.append(f"{repeats} rows have the stamp of the row before: they are left out")
    raw = distinct
    data = [motion_data(log, columns) for log in raw]
    wrong = mistakes(raw, columns, data)
    if wrong:
        raise RigError("; ".join(wrong))
    notes += remarks(raw, columns, data)
    joints = joints_of(references, data)
    free = [j for j, joint in enumerate(joints) if joint.follows is None]
    moving, untellable, left = drives_of(columns, joints, free, data)
    notes += left
    check_moved(joints, free, moving)
    check_arms(joints, moving)
    check_efforts(moving, data)
    rates = rates_of(raw, time, unit)
    description = raw_description(name, time, rates, joints, moving, data)
    if repeats:
        description["log"] = {"time": {**log_time(time), "repeated": "first"}}
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


def _all(columns: Sequence[ColumnRole]) -> str:
    return one_line("; ".join(f"{column.header}: {column.role}" for column in columns), 180)
