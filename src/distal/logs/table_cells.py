"""The cells of a table as the file holds them (numbers, dates or text), and how text becomes
numbers; headers that give a unit, such as ``theta [rad]``, and the factor to SI; and columns
that hold vectors, as in robot-learning datasets, which become one column for each number.
"""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.errors import DistalWarning, LogError, UnitError, did_you_mean
from distal.rig import COUNTS, Rig, Role, Sensor, log_factor, measurand_of
from distal.units import unit_factor


def say(text: str) -> None:
    """Warn of something in a log."""
    warnings.warn(text, DistalWarning, stacklevel=4)


_UNIT = re.compile(
    r"(.*\S)(?:\s+\[([^\[\]]+)\]|\[(?!\d+\])([^\[\]]+)\]|\s*\((?!\d+\))([^()]+)\)"
    r"|[_.]+([^\W\d_]+)[_.])"
)


PERCENT = ("%", "pct", "percent")
"""Units of a load whose scale no log tells: the rig says what its numbers are taken for."""


def header(name: str, unit: str) -> str:
    """Return the header of a column, such as ``theta [rad]``; without a unit it is the name
    alone.
    """
    return f"{name} [{unit}]" if unit else name


def name_and_unit(text: str) -> tuple[str, str | None]:
    """Return the name and the unit of a header; the unit is None in ``theta`` and in
    ``position[0]``.
    """
    match = _UNIT.fullmatch(text)
    return (text, None) if match is None else (match[1], match[match.lastindex or 1])


def needed(text: str, columns: Collection[str] | None) -> bool:
    """Return whether the column with the header `text` is needed.

    Args:
        columns: whole headers, or names without units; None needs all.
    """
    return columns is None or text in columns or any(_is_called(text, name) for name in columns)


WORDS = re.compile(r"[A-Z]?[^\W\d_A-Z]+|[A-Z]+(?![a-z])|\d+")
"""The words of a name: `m1_pos`, `M1 Pos` and `m1Pos` are of m, 1, pos."""


def _is_called(text: str, name: str) -> bool:
    """Return whether the words of a header, without its unit, end with those of a name, in any case
    and with any signs between.
    """
    words = _words(name_and_unit(text)[0])
    last = _words(name)
    return bool(last) and words[-len(last) :] == last


@lru_cache
def _words(name: str) -> list[str]:
    return [word.lower() for word in WORDS.findall(name)]


STATE = "observation.state."
"""What stands before the name of a motor in the columns of a dataset's readings."""


def headers_of(headers: Sequence[str], desired: Collection[str], source: str) -> dict[str, str]:
    """Return header → desired name, for the columns that are called otherwise: with a unit, in
    other letters (`Flexor Pos`), or in a path (`/hand/flexor_pos`).

    Args:
        desired: names without units.
        source: what the table is called in messages.

    Raises:
        LogError: two headers give the same name with a unit.
    """
    name_of = dict[str, str]()
    for name in desired:
        if name in headers:
            continue
        by_unit = [text for text in headers if name_and_unit(text)[0] == name]
        if len(by_unit) > 1:
            raise LogError(
                f"{source}: column '{name}' is there twice, as '{by_unit[0]}' and '{by_unit[1]}'; "
                "remove one"
            )
        alike = by_unit or [t for t in headers if t not in desired and _is_called(t, name)]
        # what a dataset measured comes before what it commanded
        measured = [text for text in alike if text.startswith(STATE)] or alike
        if len(measured) == 1:
            name_of[measured[0]] = name
    return name_of


def units_of(name_of: Mapping[str, str]) -> dict[str, str]:
    """Return name → unit, for the headers that give one; see `headers_of`."""
    units = {name: name_and_unit(text)[1] for text, name in name_of.items()}
    return {name: unit for name, unit in units.items() if unit is not None}


def factor_of(sensor: Sensor, units: Mapping[str, str], source: str) -> float:
    """Return the factor that turns a column's numbers into SI, with the sensor's sign.

    Args:
        units: name → unit, of the columns whose headers give one. It counts before the rig's.
        source: what the log is called in messages.

    Raises:
        LogError: the header's unit is no unit of what the sensor measures.
    """
    unit = units.get(sensor.log_column)
    if unit is None or (unit in PERCENT and measurand_of(sensor).role is Role.EFFORT):
        return sensor.sign * log_factor(sensor)
    try:
        if (unit in COUNTS) != (sensor.unit in COUNTS):
            raise UnitError('counts need unit = "count" and counts_per_turn in the rig file')
        return sensor.sign * log_factor(sensor.model_copy(update={"unit": unit}))
    except UnitError as problem:
        name = header(sensor.log_column, unit)
        raise LogError(f"{source}: column '{name}': {problem}") from None


def time_factor(rig: Rig, units: Mapping[str, str], source: str) -> float:
    """Return the factor that turns a log's stamps into seconds.

    Args:
        units: name → unit, of the columns whose headers give one. It counts before the rig's.
        source: what the log is called in messages.

    Raises:
        LogError: the header's unit is no unit of time.
    """
    time = rig.log.time
    return scale({time.column: time.unit, **units}, time.column, "s", source)


def scale(units: Mapping[str, str], name: str, si: str, source: str) -> float:
    """Return the factor from a column's unit to the SI unit `si`; it is 1 where it has no unit.

    Args:
        units: name → unit, of the columns that have one.
        source: what the log is called in messages.

    Raises:
        LogError: the unit has another dimension, or is none.
    """
    unit = units.get(name, si)
    try:
        return unit_factor(unit, si)
    except UnitError as problem:
        raise LogError(f"{source}: column '{header(name, unit)}': {problem}") from None


INFO = Path("meta") / "info.json"
"""Path of a LeRobot dataset's description in its folder; it names the numbers of vectors."""

WIDEST_VECTOR = 256
"""Longest vector per row of a table that is read as columns; a longer one is an image or the like.
Source: judgement.
"""

ABOVE = 4
"""How many folders above a file its dataset is looked for. Source: judgement."""


def numbered(path: Path, column: str, length: int) -> list[str]:
    """Return the names of the columns for the numbers of a vector.

    They are, for example, ``observation.state.NAME``; where the dataset that holds the file gives
    no names that fit, a position from 0 stands for each.

    Args:
        length: how many numbers the vector has.

    Raises:
        LogError: the dataset's description is no JSON object.
    """
    names = _names_in_dataset(path, column)
    is_fitting = len(names) == len(set(names)) == length
    return [f"{column}.{name}" for name in (names if is_fitting else range(length))]


def _names_in_dataset(path: Path, column: str) -> Sequence[object]:
    """Return the names of the numbers of a vector, from the description of the dataset that holds
    the file; none where there is no dataset, or it gives none.
    """
    folder = next(
        (parent for parent in list(path.absolute().parents)[:ABOVE] if (parent / INFO).is_file()),
        None,
    )
    if folder is None:
        return []
    names: object = dataset_info(folder)
    for key in ("features", column, "names"):
        names = names.get(key) if isinstance(names, dict) else None
    if isinstance(names, dict):  # by group, {"motors": [...]}, or each with its position
        names = [name if isinstance(of, int) else of for name, of in names.items()]
    if not isinstance(names, list):
        return []
    return [str(name) for of in names for name in (of if isinstance(of, list) else [of])]


def dataset_info(folder: Path) -> dict[str, object]:
    """Return the description of a dataset, the content of its `INFO`.

    Raises:
        LogError: the description cannot be read, or is no JSON object.
    """
    try:
        identified = json.loads((folder / INFO).read_text(encoding="utf-8"))
    except (OSError, ValueError) as problem:
        raise LogError(
            f"{folder / INFO}: cannot be read ({str(problem)[:120]}); is the dataset half written?"
        ) from None
    if not isinstance(identified, dict):
        raise LogError(f"{folder / INFO}: does not describe a dataset")
    return identified


Column = NDArray[Any] | list[str]
"""The cells of one column: an array of numbers or dates (``datetime64``), or a list of texts."""


def as_column(values: NDArray[np.generic]) -> Column:
    """Return an array as cells: what is neither number nor date becomes text."""
    if values.dtype.kind in "OUT":
        return ["" if cell is None else str(cell) for cell in values.tolist()]
    return values


MISSING = frozenset({"", "nan", "na", "n/a", "<na>", "null", "none", "-"})
"""Texts of a cell that mean a missing value, in lower case; a cell may be in any case."""


@dataclass(frozen=True)
class Cells:
    """A table whose cells are as the file holds them.

    Args:
        columns: name → cells, of the columns that were read.
        first_row: row number of the first value in the file, as a text editor counts.
        names: names of all columns of the file, as `renamed` calls them.
        units: name → unit, for columns whose header gave a unit beside a name that was asked for.
    """

    columns: Mapping[str, Column]
    path: Path
    first_row: int
    names: tuple[str, ...]
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def source(self) -> str:
        """What the table is called in messages."""
        return str(self.path)

    @property
    def rows(self) -> int:
        """Number of rows below the header."""
        return len(next(iter(self.columns.values()), ()))

    def renamed(self, name_of: Mapping[str, str]) -> Cells:
        """Return the same table with columns called by other names.

        Args:
            name_of: header → name, as `headers_of` returns them.
        """
        return replace(
            self,
            columns={name_of.get(name, name): cells for name, cells in self.columns.items()},
            names=tuple(name_of.get(header, header) for header in self.names),
            units=units_of(name_of),
        )

    def values(self, name: str) -> Floats:
        """Return a column as numbers, with NaN for missing cells.

        Raises:
            LogError: a cell is not a finite number; the message says where it is.
        """
        column = self.columns[name]
        words = list[int]()
        if isinstance(column, list):
            values = _values_of(column)
            words = [k for k in np.flatnonzero(np.isinf(values)).tolist() if _is_word(column[k])]
            values[words] = nan
        elif column.dtype.kind in "iuf":
            values = column.astype(np.float64, copy=False)
        else:
            raise LogError(
                f"{self.path}: column '{name}' holds {column.dtype}; numbers are expected"
            )
        if np.isinf(values).any():
            raise self._no_number(name, int(np.isinf(values).argmax()))
        if words and np.isnan(values).all():
            raise self._no_number(name, words[0])
        if words:
            say(
                f"{self.path}: row {words[0] + self.first_row}, column '{name}': "
                f"'{column[words[0]].strip()}' is no number: taken as missing, {len(words)} in all"
            )
        return values

    def _no_number(self, name: str, k: int) -> LogError:
        """Return what is wrong with the cell number `k` of a column."""
        came = str(self.columns[name][k]).strip("\r")
        if LIST.fullmatch(came.strip()):
            return LogError(
                f"{self.path}: column '{name}' holds lists as text, such as '{came[:40]}'; read "
                "the bag itself, or write each of their numbers into a column of its own"
            )
        hint = ""
        if "," in came:
            hint = "; write a decimal point, not a comma, and no mark between thousands"
        elif HEXADECIMAL.fullmatch(came.strip()):
            hint = "; write it in decimal digits, not in hexadecimal ones"
        return LogError(
            f"{self.path}: row {k + self.first_row}, column '{name}': '{came}' is not a finite "
            f"number{hint} (an empty cell is a missing value)"
        )

    def in_si(self, name: str, si: str) -> Floats:
        """Return a column in SI, by the unit in its header; without a unit there, it is unchanged.

        Args:
            si: SI unit of the quantity.
        """
        return self.values(name) * scale(self.units, name, si, self.source)

    def parsed(self, names: Sequence[str]) -> Cells:
        """Return the table of some columns, as numbers.

        Raises:
            LogError: a column is missing, a cell is no number, or there is no row.
        """
        self.check(names)
        return replace(self, columns={name: self.values(name) for name in names})

    def check(self, names: Iterable[str]) -> None:
        """Raise a `LogError` where the table lacks one of these columns, or has no row."""
        for name in names:
            if name not in self.names:
                for other, column in self.columns.items():
                    if isinstance(column, list) and column and LIST.fullmatch(column[0].strip()):
                        raise self._no_number(other, 0)
                raise LogError(
                    f"{self.path}: column '{name}' is missing{did_you_mean(name, self.names)}"
                )
        if self.rows == 0:
            raise LogError(f"{self.path}: has a header but no rows")


def compact(cells: list[str]) -> Column:
    """Return cells as numbers, whole ones where all are; unchanged where one is no number."""
    whole = whole_values(cells)
    if whole is not None:
        return whole
    values = _values_of(cells)
    return cells if np.isinf(values).any() else values


def whole_values(cells: Column) -> NDArray[np.int64] | None:
    """Return the cells as 64-bit integers, or None where a cell is something else."""
    if isinstance(cells, np.ndarray):
        is_whole = cells.dtype.kind in "iu" and cells.max(initial=0) <= np.iinfo(np.int64).max
        return cells.astype(np.int64, copy=False) if is_whole else None
    try:
        return (
            np.fromiter(map(int, cells), np.int64, len(cells)) if is_plain("".join(cells)) else None
        )
    except (ValueError, OverflowError):
        return None


def _values_of(cells: list[str]) -> Floats:
    """Return the numbers of cells: NaN of a missing one, infinity of one that holds no finite
    number.
    """
    with suppress(ValueError):  # this fast way is enough for most logs
        values = np.fromiter(map(float, cells), np.float64, len(cells))
        if np.isfinite(values).all() and is_plain("".join(cells)):
            return values
    return np.array([_number(cell) for cell in cells])


def is_plain(text: str) -> bool:
    """Return whether a text is free of number forms that Python takes and logs may not have.

    These are ``1_000`` and digits of other scripts.
    """
    return text.isascii() and "_" not in text


WORD = re.compile(r"[^\W\d_]{2}|#")
"""What no number has: two letters beside each other."""


def _is_word(cell: str) -> bool:
    """Return whether a cell holds a word where a number could be, ``inf`` or ``#DIV/0!``."""
    return not any(map(str.isnumeric, cell)) or WORD.search(cell) is not None


def _number(cell: str) -> float:
    text = cell.strip()
    if text.lower() in MISSING:
        return nan
    with suppress(ValueError):
        if is_plain(text) and isfinite(float(text)):
            return float(text)
    return inf


HEXADECIMAL = re.compile(r"(?:0[xX])?[0-9a-fA-F]+")
"""A number in hexadecimal digits."""

LIST = re.compile(r"[\[(].*[\])]", re.DOTALL)
"""A cell that holds a list as text."""
