"""Samples as messages: lines of CSV or JSON, in the rig's columns and units."""

from __future__ import annotations

import csv
import json
import re
from collections import Counter
from collections.abc import Sequence
from math import isnan, nan

import numpy as np

from distal.arrays import Floats
from distal.errors import LogError
from distal.logs.cells import MISSING
from distal.logs.header_units import factor_of, time_factor, units_of
from distal.rig import Rig, log_factor
from distal.units import unit_factor

STAMPS = ("timestamp", "ts", "time", "t")
"""Names under which a JSON message may have its stamp [s] where it lacks the rig's own time
column.
"""


class MessageReader:
    """Turns messages into stamps [s] and samples in SI.

    Args:
        rig: names the columns and their units.
        channels: names of the sensors in a sample, in its order.
    """

    def __init__(self, rig: Rig, channels: Sequence[str]) -> None:
        sensors = {sensor.name: sensor for sensor in rig.sensors}
        self._time = rig.log.time.column
        self._time_factor = unit_factor(rig.log.time.unit, "s")
        self._rig = rig
        self._sensors = [sensors[channel] for channel in channels]
        self._columns = [sensor.log_column for sensor in self._sensors]
        self._factors = np.array([sensor.sign * log_factor(sensor) for sensor in self._sensors])
        self._at: list[int] | None = None
        self._width = 0
        self._separator = ","
        self._sample = np.zeros(len(channels))

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
        headers = units_of(names, [self._time, *self._columns], "the stream")
        name_of = {header: name for name, (header, _) in headers.items()}
        names = [name_of.get(name, name) for name in names]
        units = {name: unit for name, (_, unit) in headers.items()}
        if self._time not in names:
            raise LogError(
                f"the stream's header lacks the time column '{self._time}' (it has "
                f"{', '.join(names)[:200]})"
            )
        if not any(column in names for column in self._columns):
            raise LogError(
                f"the stream's header has none of the columns {', '.join(self._columns)} (it has "
                f"{', '.join(names)[:200]})"
            )
        self._width = len(names)
        self._time_factor = time_factor(self._rig, units.get(self._time), "the stream")
        for i, sensor in enumerate(self._sensors):
            self._factors[i] = sensor.sign * factor_of(
                sensor, units.get(sensor.log_column), "the stream"
            )
        self._at = [
            names.index(name) if name in names else -1 for name in (self._time, *self._columns)
        ]

    @property
    def absent(self) -> list[str]:
        """Columns of the rig's sensors that the header lacks."""
        return (
            [] if self._at is None else [c for c, at in zip(self._columns, self._at[1:]) if at < 0]
        )

    def _cells(self, line: str) -> list[str]:
        if '"' not in line:
            return [cell.strip() for cell in line.strip("\r\n").split(self._separator)]
        try:
            return [
                cell.strip()
                for cell in next(csv.reader([line.strip("\r\n")], delimiter=self._separator))
            ]
        except (csv.Error, StopIteration) as problem:
            raise LogError(f"the line is no CSV ({problem})") from None

    def csv(self, line: str) -> tuple[float, Floats]:
        """Return the stamp [s] and the sample of a CSV line, in SI, (m,); the next call reuses the
        array.

        Raises:
            LogError: the line has more or fewer cells than the header, or a cell is no number.
        """
        assert self._at is not None
        cells = self._cells(line)
        if len(cells) != self._width:
            raise LogError(f"{len(cells)} cells came, the header has {self._width}")
        time = number_of(cells[self._at[0]], self._time)
        for i, at in enumerate(self._at[1:]):
            self._sample[i] = nan if at < 0 else number_of(cells[at], self._columns[i])
        self._sample *= self._factors
        return time * self._time_factor, self._sample

    def json(self, text: str | bytes) -> tuple[float, Floats]:
        """Return the stamp [s] and the sample of a JSON object, in SI, (m,); the next call reuses
        the array.

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
        stamp = find(message, self._time)
        time = number_of(stamp, self._time) * self._time_factor
        if stamp is None:
            stamps = (find(message, name) for name in STAMPS)
            time = next(
                (number_of(stamp, "timestamp") for stamp in stamps if stamp is not None), nan
            )
        if isnan(time):
            names = ", ".join(name for name in STAMPS if name != self._time)
            raise LogError(f"no stamp: neither '{self._time}' nor {names} is there with a value")
        self._sample[:] = [number_of(find(message, column), column) for column in self._columns]
        self._sample *= self._factors
        return time, self._sample

    def message(self, time: float, sample: Floats) -> dict[str, float]:
        """Return a JSON object in the rig's columns and units, as `json` reads it.

        Args:
            time: stamp [s].
            sample: readings in SI, (m,).
        """
        return {
            self._time: time / self._time_factor,
            **dict(zip(self._columns, (sample / self._factors).tolist())),
        }


def find(message: object, path: str) -> object:
    """Return a member of nested JSON objects and arrays by its path, or None where it is not there.

    A path is, for example, ``motors/left.force`` or ``position[0]``.
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
        if isinstance(message, dict) and part in message:
            message = message[part]
        elif isinstance(message, list) and _is_index(part) and int(part) < len(message):
            message = message[int(part)]
        else:
            return None
    return message


def _is_index(part: str) -> bool:
    """Return whether a part of a path is an index of an array: up to nine digits from 0 to 9."""
    return part.isascii() and part.isdecimal() and len(part) < 10


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
