"""JSON lines: one object for each row; the number in nested objects is called ``group.name``."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from distal.errors import LogError
from distal.logs.formats.format import Format
from distal.logs.table_cells import Cells, compact, needed
from distal.machine_limits import check_memory


def read_jsonl(path: Path, columns: Sequence[str] | None) -> Cells:
    """Return the columns of a file of JSON lines; a name that a line lacks is a missing cell.

    Args:
        columns: names of the columns that are needed; None needs all.

    Raises:
        LogError: a line is no JSON object.
    """
    check_memory(path.stat().st_size, "it is read as a whole")
    lines = path.read_bytes().split(b"\n")
    rows = list[dict[str, str]]()
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            content = json.loads(line)
        except ValueError as problem:
            if number == len(lines) > 1:
                break  # the recorder was stopped within a line
            raise LogError(f"row {number}: is no JSON ({problem})") from None
        if not isinstance(content, dict):
            raise LogError(f"row {number}: is no JSON object with names, {{...}}")
        rows.append(dict(_flat(content)))
    names = tuple(dict.fromkeys(name for row in rows for name in row))
    held = {
        name: compact([row.get(name, "") for row in rows])
        for name in names
        if needed(name, columns)
    }
    return Cells(held, path, 1, names)


def _flat(content: object, name: str = "") -> Iterator[tuple[str, str]]:
    """Yield name and text of each value in an object; members and positions follow a point."""
    if isinstance(content, list):
        content = dict(enumerate(content))
    if isinstance(content, dict):
        for member, value in content.items():
            yield from _flat(value, f"{name}.{member}" if name else str(member))
    else:
        yield name, "" if content is None else str(content)


JSONL = Format("JSON lines", endings=(".jsonl", ".ndjson"), read=read_jsonl)
