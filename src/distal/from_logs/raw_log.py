"""A log before any rig is known: all its columns that hold numbers, as they came."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from distal.arrays import Floats
from distal.errors import LogError
from distal.logs import (
    Column,
    Episode,
    Source,
    is_recording,
    open_recording,
    open_table,
    recorded_columns,
)

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")

MOSTLY = 0.5
"""Share of numbers above which a column is one of numbers [1]. Source: judgement."""

NOTHING = np.full(1, np.nan)
"""What a log has of a column that it lacks. Source: definition."""

FEWEST_ROWS = 50
"""A log with fewer rows than this shows nothing of a rig. Source: judgement."""


TIME = "time"
"""Column of a recording's stamps [s]. Source: definition (the name)."""


@dataclass(frozen=True)
class RawLog:
    """The columns of a log by their headers, numbers as they came, NaN where missing.

    Args:
        source: name of the file.
        columns: header → values, (n_samples,).
        texts: headers of columns that hold no numbers.
    """

    source: str
    columns: Mapping[str, Floats]
    texts: tuple[str, ...] = ()

    @property
    def rows(self) -> int:
        """Number of samples."""
        return len(next(iter(self.columns.values()), ()))


def read_raw(path: Source) -> RawLog:
    """Return a log (CSV, Parquet, HDF5, MCAP, a ROS bag, a LeRobot episode or a frame) with all its
    columns.

    Raises:
        LogError: it cannot be read, holds no numbers, or has fewer than `FEWEST_ROWS` rows.
    """
    if is_recording(path):
        names = recorded_columns(path)
        if not names:
            raise LogError(f"{path}: no message has numbers")
        read, _ = open_recording(path, names, TIME)
        check_rows(str(path), len(read[TIME]))
        return RawLog(str(path), read)
    cells = open_table(path)
    source = str(path) if isinstance(path, (str, Path, Episode)) else str(cells.path)
    check_rows(source, cells.rows)
    columns = dict[str, Floats]()
    texts = list[str]()
    for name in cells.names:
        try:
            columns[name] = cells.values([name])[name]
        except LogError:
            if _is_mostly_numeric(cells.column(name)):
                raise
            texts.append(name)
    if not columns:
        raise LogError(f"{source}: no column holds numbers; a log has a header and rows of numbers")
    return RawLog(source, columns, tuple(texts))


def check_rows(source: str, rows: int) -> None:
    """Raise a `LogError` where a log has too few rows to learn from."""
    if rows < FEWEST_ROWS:
        raise LogError(
            f"{source}: {rows} rows are too few to learn a rig from; {FEWEST_ROWS} at least"
        )


def _is_mostly_numeric(column: Column) -> bool:
    """Return whether most cells of a column are numbers, so that another cell is a mistake."""
    if not isinstance(column, list):
        return column.dtype.kind in "iuf"
    count = sum(_NUMBER.fullmatch(cell.strip()) is not None for cell in column)
    return count > MOSTLY * len(column)


def without_repeats(log: RawLog, time: str) -> RawLog:
    """Return a log with the first of the rows that have one stamp."""
    first = np.concatenate([[True], np.diff(log.columns[time]) > 0.0])
    if first.all():
        return log
    return replace(log, columns={name: values[first] for name, values in log.columns.items()})


def with_same_columns(logs: Sequence[RawLog]) -> tuple[list[RawLog], dict[str, str]]:
    """Return logs that all have the same columns, NaN where a log lacks one, and header → the logs
    that lack it.

    Raises:
        LogError: two logs have fewer than two columns in common; says which are in which.
    """
    for log in logs[1:]:
        if len(set(log.columns) & set(logs[0].columns)) < 2:
            raise LogError(
                f"{log.source} has the columns {', '.join(log.columns)}; {logs[0].source} has "
                f"{', '.join(logs[0].columns)}: logs of one rig have the same columns"
            )
    headers = dict.fromkeys(name for log in logs for name in log.columns)
    headers = {
        name: None
        for name in headers
        if any(np.isfinite(log.columns.get(name, NOTHING)).any() for log in logs)
    }
    lacking = dict[str, str]()
    for name in headers:
        without = [
            log.source for log in logs if not np.isfinite(log.columns.get(name, NOTHING)).any()
        ]
        if without:
            lacking[name] = ", ".join(without)
    filled = [
        replace(
            log,
            columns={name: log.columns.get(name, np.full(log.rows, np.nan)) for name in headers},
        )
        for log in logs
    ]
    return filled, lacking
