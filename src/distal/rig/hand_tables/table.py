"""The table of a hand: a line for each joint that a motor moves, in a spreadsheet's CSV."""

from __future__ import annotations

import csv
import re
from math import pi
from pathlib import Path

from distal.errors import RigError, UnitError
from distal.rig.files import Imported, read_text
from distal.rig.hand_tables.described import hand_of
from distal.rig.hand_tables.row import Row
from distal.suggestions import did_you_mean
from distal.units import to_si, unit_factor

COLUMNS: dict[str, str] = {
    "joint": "text",
    "motor": "text",
    "spool_radius": "m",
    "joint_radius": "m",
    "direction": "sign",
    "low": "rad",
    "high": "rad",
    "back": "back",
    "unit": "unit",
    "zero": "rad",
    "counts": "",
    "torque_constant": "N m/A",
    "follows": "text",
    "ratio": "",
    "range_std": "rad",
    "position_column": "text",
    "current_column": "text",
    "time_column": "text",
}
"""Column → its SI unit, or what else stands in it."""

WORDS = {"back": ("tendon", "spring"), "unit": ("rad", "deg")}
"""Words that may stand in a column."""

COUNTED = ("count", "counts")
"""Units of a `zero` that is given in counts of an encoder, with `counts` in one turn."""

NEEDED = ("joint", "low", "high")
"""Columns that a table must have."""

_HEADER = re.compile(r"^\s*([A-Za-z_ ]+?)\s*(?:[\[(]\s*(.*?)\s*[\])])?\s*$")
MOST_ROWS = 200
"""Largest number of lines in a table, with the line of names [1]. Source: judgement."""


def from_table(path: str | Path) -> Imported:
    """Return the rig of a hand whose joints and motors stand in a table.

    A line is a joint that a motor moves: `joint`, `motor`, `spool_radius`, `joint_radius`,
    `direction` (+1 where the joint's angle grows as the motor's reading grows), `low` and `high`.
    Units stand behind the names, ``low [deg]``, or in the cells. A motor whose tendon crosses
    several joints has a line for each. What is left out is guessed: see `Row`.

    Raises:
        RigError: the file is no such table; says which line and what is allowed.
    """
    path = Path(path)
    text = read_text(path, RigError).splitlines()
    names = next((line for line in text if line.strip() and not line.lstrip().startswith("#")), "")
    lines = list(csv.reader(text, delimiter=max(",;\t", key=names.count)))
    filled = [(i, line) for i, line in enumerate(lines, 1) if any(cell.strip() for cell in line)]
    filled = [(i, line) for i, line in filled if not line[0].lstrip().startswith("#")]
    if len(filled) < 2:
        raise RigError(
            f"{path}: a table has a line of names and one for each joint; {len(filled)} came"
        )
    if len(filled) > MOST_ROWS:
        raise RigError(f"{path}: {len(filled) - 1} lines; a hand has at most {MOST_ROWS - 1}")
    columns = _header(path, filled[0][1])
    cells = [dict(zip(columns, line)) for _, line in filled[1:]]
    rows = [_row(path, i, of_line) for (i, _), of_line in zip(filled[1:], cells)]
    identified = [of_line.get(("direction", None), "").strip() for of_line in cells]
    unidentified = [
        row.joint for row, way in zip(rows, identified) if not way and row.follows is None
    ]
    note = (
        f"no direction of {', '.join(unidentified)}: each angle is taken to grow with its motor's "
        "reading; look once"
    )
    return hand_of(rows, path.stem, "table", [note] if unidentified else [])


def _header(path: Path, cells: list[str]) -> list[tuple[str, str | None]]:
    """Return name and unit of each column."""
    names = list[tuple[str, str | None]]()
    for cell in cells:
        match = _HEADER.match(cell)
        name = "" if match is None else match[1].lower().replace(" ", "_")
        if match is None or name not in COLUMNS:
            raise RigError(f"{path}: there is no column '{cell}'{did_you_mean(name, COLUMNS)}")
        if name in [other for other, _ in names]:
            raise RigError(f"{path}: two columns are called '{name}'")
        try:
            if match[2] is not None and not (name == "zero" and match[2] in COUNTED):
                unit_factor(match[2], COLUMNS[name])
        except UnitError as error:
            raise RigError(f"{path}: column '{name}': {error}") from None
        names.append((name, match[2]))
    missing = [name for name in NEEDED if name not in [other for other, _ in names]]
    if missing:
        raise RigError(
            f"{path}: column '{missing[0]}' is missing; a table needs {', '.join(NEEDED)}"
        )
    return names


def _row(path: Path, line: int, cells: dict[tuple[str, str | None], str]) -> Row:
    """Return a line as a row."""
    values: dict[str, object] = {}
    in_counts: float | None = None
    for (name, unit), cell in cells.items():
        text = cell.strip()
        if not text:
            continue
        try:
            if name == "zero" and unit in COUNTED:
                in_counts = to_si(float(text), "")
                continue
            values[name] = _value(COLUMNS[name], text, unit)
        except (UnitError, ValueError) as error:
            raise RigError(f"{path}: line {line}, '{name}': {error}") from None
    missing = [name for name in NEEDED if name not in values]
    if missing:
        raise RigError(f"{path}: line {line}: '{missing[0]}' is empty")
    if in_counts is not None:
        counts = values.get("counts")
        if not isinstance(counts, float) or counts <= 0.0:
            raise RigError(f"{path}: line {line}: a zero in counts needs 'counts' of one turn")
        values["zero"] = in_counts / counts * 2 * pi
    try:
        return Row(**values)  # type: ignore[arg-type]
    except RigError as error:
        raise RigError(f"{path}: line {line}: {error}") from None


def _value(kind: str, text: str, unit: str | None) -> object:
    if kind == "text":
        return text
    if kind in WORDS:
        if text.lower() not in WORDS[kind]:
            raise ValueError(f"must be one of {', '.join(WORDS[kind])}, '{text}' came")
        return text.lower()
    if kind == "sign":
        if text not in ("1", "+1", "-1"):
            raise ValueError(f"must be 1 or -1, '{text}' came")
        return int(text)
    if unit is not None and re.fullmatch(r"[-+.\deE]+", text):
        text = f"{text} {unit}"
    return to_si(text, kind) if kind else float(to_si(text, ""))
