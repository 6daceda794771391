"""The table of a hand, in a spreadsheet's CSV: a line for each joint, and what moves it."""

from __future__ import annotations

import csv
import re
from math import inf, pi
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, model_validator

from distal.errors import RigError, UnitError, did_you_mean
from distal.rig.files import read_text
from distal.rig.quantities import AnyRadians, Description, In, Radians, TorqueConstant
from distal.rig.validation import validated
from distal.units import to_si

COUNTED = ("count", "counts")
"""Units of a `zero` that is given in counts of an encoder, with `counts` in one turn."""

NEEDED = ("joint", "low", "high")
"""Columns that a table must have."""

_HEADER = re.compile(r"^\s*([A-Za-z_ ]+?)\s*(?:[\[(]\s*(.*?)\s*[\])])?\s*$")


def _sign(raw: object) -> object:
    """Return ±1 for a text of it."""
    return {"1": 1, "+1": 1, "-1": -1}.get(raw, raw) if isinstance(raw, str) else raw


Radius = Annotated[float, In("m", within=(1e-4, 0.5))]


class Row(Description):
    """A joint that a motor's tendon moves, or that follows another; None stands for what is not
    known. Each field is a column of a table.

    Args:
        joint: its name.
        low: end of the joint's range [rad].
        high: the other end [rad].
        motor: name or number of the motor; None for a joint that only `follows` another.
        spool_radius: of the motor [m].
        joint_radius: of the pulley at the joint [m].
        direction: +1 where the joint's angle grows as the motor's reading grows.
        back: whether a second "tendon" on the same spool or a "spring" brings the joint back.
        zero: what the motor reads while the joint is at zero [rad].
        zero_std: std of that reading [rad].
        ratio_std: std of the ratio of both radii, as a share.
        unit: of what the motor reads, "rad" or "deg", where it does not log counts.
        counts: of the encoder in one turn; None for a log in `unit`.
        torque_constant: of the motor [N m/A].
        follows: a joint to which it is coupled rigidly.
        ratio: turns of this joint for one turn of the joint that it follows.
        range_std: std of each end of its range [rad].
        position_column: what the motor's reading is called in logs.
        current_column: what its current is called.
        time_column: what the time is called; one for all.
    """

    joint: str
    low: AnyRadians
    high: AnyRadians
    motor: str | None = None
    spool_radius: Radius | None = None
    joint_radius: Radius | None = None
    direction: Annotated[Literal[1, -1], BeforeValidator(_sign)] = 1
    back: Annotated[Literal["tendon", "spring"], BeforeValidator(str.lower)] = "tendon"
    zero: AnyRadians | None = None
    zero_std: Radians | None = None
    ratio_std: Annotated[float, In("", "nonnegative")] | None = None
    unit: Annotated[Literal["rad", "deg"], BeforeValidator(str.lower)] = "rad"
    counts: Annotated[float, In("", within=(2.0, inf))] | None = None
    torque_constant: TorqueConstant | None = None
    follows: str | None = None
    ratio: Annotated[float, In("")] = 1.0
    range_std: Radians | None = None
    position_column: str | None = None
    current_column: str | None = None
    time_column: str | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if not -2 * pi <= self.low < self.high <= 2 * pi:
            raise ValueError(
                f"the range of '{self.joint}' must be from a lower to a higher angle within ±360°, "
                f"{self.low:.4g} to {self.high:.4g} rad came; is the unit right?"
            )
        if (self.motor is None) == (self.follows is None):
            raise ValueError(
                f"'{self.joint}' needs a motor, or the joint that it follows, one of both"
            )
        return self


def read_rows(path: Path) -> list[Row]:
    """Return the lines of a table; units stand behind the names of columns or in the cells.

    Raises:
        RigError: the file is no such table; says which line and what is allowed.
    """
    text = read_text(path, RigError).splitlines()
    names = next((line for line in text if line.strip() and not line.lstrip().startswith("#")), "")
    lines = enumerate(csv.reader(text, delimiter=max(",;\t", key=names.count)), 1)
    filled = [
        (i, line)
        for i, line in lines
        if any(cell.strip() for cell in line) and not line[0].lstrip().startswith("#")
    ]
    if len(filled) < 2:
        raise RigError(
            f"{path}: a table has a line of names and one for each joint; {len(filled)} came"
        )
    columns = _header(path, filled[0][1])
    return [_row(f"{path}: line {i}", columns, line) for i, line in filled[1:]]


def _header(path: Path, cells: list[str]) -> dict[str, str | None]:
    """Return name → unit of each column."""
    columns: dict[str, str | None] = {}
    for cell in cells:
        match = _HEADER.match(cell)
        name = "" if match is None else match[1].lower().replace(" ", "_")
        if match is None or name not in Row.model_fields:
            raise RigError(
                f"{path}: there is no column '{cell}'{did_you_mean(name, Row.model_fields)}"
            )
        if name in columns:
            raise RigError(f"{path}: two columns are called '{name}'")
        if match[2] is not None and Row.model_fields[name].annotation in (str, str | None):
            raise RigError(f"{path}: column '{name}' holds text, '{match[2]}' is no unit of it")
        columns[name] = match[2]
    missing = [name for name in NEEDED if name not in columns]
    if missing:
        raise RigError(
            f"{path}: column '{missing[0]}' is missing; a table needs {', '.join(NEEDED)}"
        )
    return columns


def _row(source: str, units: dict[str, str | None], cells: list[str]) -> Row:
    """Return a line as a row; the `source` begins messages."""
    raw: dict[str, object] = {}
    for (name, unit), cell in zip(units.items(), cells):
        text = cell.strip()
        is_bare = re.fullmatch(r"[-+.\deE]+", text) is not None
        if unit is not None and unit not in COUNTED and is_bare:
            text = f"{text} {unit}"
        if text:
            raw[name] = text
    if "zero" in raw and units["zero"] in COUNTED:
        try:
            raw["zero"] = 2 * pi * to_si(raw["zero"], "") / to_si(raw.get("counts"), "")
        except (UnitError, ZeroDivisionError):
            raise RigError(f"{source}: a zero in counts needs 'counts' of one turn") from None
    return validated(Row, raw, source, RigError)
