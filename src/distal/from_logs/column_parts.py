"""Which drive or joint each column is of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from distal.from_logs.column_names import CLEAR, NameEvidence, Role
from distal.from_logs.column_role import ColumnRole
from distal.rig import name_of


def named_columns(
    columns: Sequence[ColumnRole], names: Mapping[str, NameEvidence]
) -> list[ColumnRole]:
    """Return columns with the drive or joint that each is of."""
    parts = dict[str, str]()
    counts = dict.fromkeys(CLEAR, 0)
    taken: dict[Role, list[str]] = {role: [] for role in CLEAR}
    for column in columns:
        counts[column.role] += 1
        kind = "joint" if column.role == "angle" else "m"
        subject = names[column.header].subject
        text = subject if subject else ("joint" if kind == "joint" else "motor")
        text = f"{kind}{text}" if text[:1].isdigit() else text
        name = name_of(text, kind)
        if name in taken[column.role] or (not subject and counts[column.role] > 1):
            name = f"{name}_{counts[column.role]}"
        taken[column.role].append(name)
        parts[column.header] = name
    drives = [c for c in columns if c.role == "position"]
    result = []
    for column in columns:
        part = parts[column.header]
        if column.role in ("effort", "command"):
            part = _drive_of(column, part, columns, parts, [parts[d.header] for d in drives])
        result.append(replace(column, part="" if column.role in ("time", "other") else part))
    return result


def _drive_of(
    column: ColumnRole,
    part: str,
    columns: Sequence[ColumnRole],
    parts: Mapping[str, str],
    drives: Sequence[str],
) -> str:
    """Return the drive of an effort or a command: that of its name, else the next in order."""
    if part in drives:
        return part
    alike = [c for c in columns if c.role == column.role]
    unmatched_drives = [d for d in drives if d not in [parts[c.header] for c in alike]]
    unmatched = [c for c in alike if parts[c.header] not in drives]
    at = [c.header for c in unmatched].index(column.header)
    return unmatched_drives[at] if at < len(unmatched_drives) else part
