"""Where logs hold the readings of a rig file's sensors, whose columns it does not name."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from distal.from_logs.column_names import Role
from distal.from_logs.columns import Overrides, column_roles
from distal.from_logs.drafted_parts import column_of
from distal.from_logs.raw_log import rates_of, read_raw, time_unit, with_same_columns
from distal.logs import Source, name_and_unit
from distal.rig import Rig

ROLES: Mapping[str, Role] = {"position": "position", "force": "effort", "angle": "angle"}
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
    raw, _ = with_same_columns([read_raw(path, rate=rate) for path in logs])
    columns = column_roles(raw, Overrides(tuple(truth), dict(drives or {}), tuple(ignore)))
    time = next(column for column in columns if column.role == "time")
    unit = time_unit(time, raw)[0]
    rates = rates_of(raw, time, unit)
    headers = {name for column in columns for name in (column.header, column_of(column))}
    assignments = list[str]()
    lines = list[str]()
    if rate is not None:
        assignments.append(f"log.time.rate={rate}")
    elif rig.log.time.rate is None and rig.log.time.column not in headers:
        assignments.append(f"log.time={{column={_quoted(column_of(time))},unit='{unit}'}}")
        lines.append(f"the time is in column {time.header}")
    for measures, role in ROLES.items():
        sensors = [sensor for sensor in rig.sensors if sensor.measures == measures]
        alike = [column for column in columns if column.role == role]
        by_part = {_plain(column.part): column for column in alike}
        counts = Counter(_plain(sensor.of) for sensor in sensors)
        for sensor in sensors:
            part = _plain(sensor.of)
            column = by_part.get(part) if counts[part] == 1 else None
            if len(sensors) == len(alike) == 1:
                column = alike[0]
            if column is None or sensor.log_column in headers:
                continue
            name = sensor.name
            assignments.append(f"sensors.{name}.column={_quoted(column_of(column))}")
            assignments.append(f"sensors.{name}.rate={rates[column.header]}")
            if name_and_unit(column.header)[1] is not None:
                assignments.append(f"sensors.{name}.unit='{column.unit}'")
            lines.append(f"{name} is read in column {column.header}")
    return DraftColumns(tuple(assignments), tuple(lines))


def _quoted(text: str) -> str:
    """Return a text as a TOML string, which a quotation mark in it does not end."""
    return json.dumps(text, ensure_ascii=False)


def _plain(name: str) -> str:
    """Return a name without what spellings differ in: motor_1, Motor 1, m1 and 1 are one."""
    letters = "".join(letter for letter in name.lower() if letter.isalnum())
    return re.sub(r"^(motor|servo|drive|m)(?=\d+$)", "", letters)
