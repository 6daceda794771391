"""Samples as messages: lines of CSV or JSON, in the rig's columns and units."""

from __future__ import annotations

import csv
import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from math import isnan, nan

import numpy as np

from distal.arrays import Floats
from distal.errors import LogError
from distal.logs.raw_to_si import RawToSI, Remark
from distal.logs.table_cells import MISSING, factor_of, headers_of, time_factor, units_of
from distal.rig import Rig

INDEX = re.compile("[0-9]{1,9}")
"""An index of an array in a path."""

TIMES = ("timestamp", "stamp", "ts", "time", "t")
"""Names of the time [s] of a table or a JSON message which lacks the rig's own time column."""


class MessageReader:
    """Turns messages into stamps [s] and samples in SI.

    Args:
        rig: names the columns and their units.
        channels: names of the sensors in a sample, in its order.
    """

    def __init__(self, rig: Rig, channels: Sequence[str]) -> None:
        sensors = {sensor.name: sensor for sensor in rig.sensors}
        self._time = rig.log.time.column
        self._rig = rig
        self._sensors = [sensors[channel] for channel in channels]
        self._columns = [sensor.log_column for sensor in self._sensors]
        self._names: list[str] = []
        self._separator = ","
        self._use({})

    def _use(self, units: Mapping[str, str]) -> None:
        """Take units of columns, name → unit, before those of the rig."""
        self._time_factor = time_factor(self._rig, units, "the stream")
        factors = [factor_of(sensor, units, "the stream") for sensor in self._sensors]
        self._to_si = RawToSI(self._rig, self._sensors, factors)

    def header(self, line: str) -> None:
        """Read the header of a CSV stream, which must come before the first line.

        It holds names, with or without units, between commas, semicolons or tabs.

        Raises:
            LogError: a name is there twice, the time column or every sensor's column is missing, or
                a unit is wrong.
        """
        self._separator = max(",;\t", key=line.count)
        names = self._cells(line)
        name, count = Counter(names).most_common(1)[0]
        if count > 1:
            raise LogError(f"the stream's header has '{name[:80]}' twice")
        name_of = headers_of(names, [self._time, *self._columns], "the stream")
        names = [name_of.get(text, text) for text in names]
        known = ", ".join(names)[:200]
        if self._time not in names:
            raise LogError(
                f"the stream's header lacks the time column '{self._time}' (it has {known})"
            )
        if set(names).isdisjoint(self._columns):
            raise LogError(
                f"the stream's header has none of the columns {', '.join(self._columns)} (it has "
                f"{known})"
            )
        self._use(units_of(name_of))
        self._names = names

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What was done with the readings of the last sample, see `RawToSI`."""
        return self._to_si.remarks

    @property
    def absent(self) -> list[str]:
        """Columns of the rig's sensors that the header of a CSV stream lacks."""
        return [column for column in self._columns if column not in self._names]

    def _cells(self, line: str) -> list[str]:
        line = line.strip("\r\n")
        cells = line.split(self._separator)
        if '"' in line:
            try:
                cells = next(csv.reader([line], delimiter=self._separator))
            except (csv.Error, StopIteration) as problem:
                raise LogError(f"the line is no CSV ({problem})") from None
        return [cell.strip() for cell in cells]

    def csv(self, line: str) -> tuple[float, Floats]:
        """Return the stamp [s] and the sample of a CSV line, in SI, (m,).

        Raises:
            LogError: the line has more or fewer cells than the header, or a cell is no number.
        """
        cells = self._cells(line)
        if len(cells) != len(self._names):
            raise LogError(f"{len(cells)} cells came, the header has {len(self._names)}")
        came = dict(zip(self._names, cells))
        time = number_of(came[self._time], self._time) * self._time_factor
        return time, self._in_si(time, (came.get(column) for column in self._columns))

    def _in_si(self, time: float, cells: Iterable[object]) -> Floats:
        readings = [number_of(cell, name) for cell, name in zip(cells, self._columns)]
        return self._to_si.take(time, readings)

    def json(self, text: str | bytes) -> tuple[float, Floats]:
        """Return the stamp [s] and the sample of a JSON object, in SI, (m,).

        Columns name nested members with dots or slashes, see `find`.

        Raises:
            LogError: the text is no JSON object, has no stamp, or a member is no number.
        """
        try:
            message = json.loads(text)
        except (ValueError, RecursionError) as problem:
            raise LogError(f"no JSON ({str(problem)[:80]})") from None
        if not isinstance(message, dict):
            raise LogError("a JSON object is expected, with a member for each column")
        time = stamp_of(message, self._time, self._time_factor)
        if isnan(time):
            names = ", ".join(name for name in TIMES if name != self._time)
            raise LogError(f"no stamp: neither '{self._time}' nor {names} is there with a value")
        return time, self._in_si(time, (find(message, column) for column in self._columns))


def stamp_of(message: object, time: str, unit: float) -> float:
    """Return the stamp of a JSON message [s], NaN where it has none.

    Args:
        time: name of the rig's time column.
        unit: its unit [s]; a stamp under another name is in seconds.
    """
    for name in (time, *TIMES):
        cell = find(message, name)
        if cell is not None:
            return number_of(cell, name) * (unit if name == time else 1.0)
    return nan


def find(message: object, path: str) -> object:
    """Return a member of nested JSON objects, messages of ROS and arrays by its path, or None where
    it is not there.

    A path is, for example, ``motors/left.force``, ``wrench.force.z`` or ``position[0]``.
    """
    while isinstance(message, dict):
        if path in message:
            return message[path]
        head, _, tail = path.partition(".")
        # a topic may have slashes of its own
        name = next((name for name in (head, head.lstrip("/")) if tail and name in message), None)
        if name is None:
            break
        message = message[name]
        path = tail
    for part in re.findall(r"[^./\[\]]+", path):
        if isinstance(message, dict):
            message = message.get(part)
        elif isinstance(message, list | np.ndarray):
            is_there = INDEX.fullmatch(part) and int(part) < len(message)
            message = message[int(part)] if is_there else None
        else:
            message = getattr(message, part, None) if is_dataclass(message) else None
    return message


def number_of(cell: object, name: str) -> float:
    """Return a cell or a member as a number, with NaN for a missing one.

    Args:
        name: column or member, as the message names it.

    Raises:
        LogError: it is no number.
    """
    if cell is None or (isinstance(cell, str) and cell.strip().lower() in MISSING):
        return nan
    if isinstance(cell, (bool, dict, list)) or (isinstance(cell, str) and "_" in cell):
        raise LogError(f"'{name}' is {str(cell)[:40]}; a number is expected")
    try:
        return float(cell)  # type: ignore[arg-type]
    except (ValueError, OverflowError):
        raise LogError(f"'{name}' is '{str(cell)[:40]}'; a number is expected") from None
