"""A log before any rig is known: all its columns that hold numbers, as they came."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from distal.arrays import Floats
from distal.errors import DistalError, LogError
from distal.logs import Episode, Source, open_table

FEWEST_ROWS = 50
"""A log with fewer rows than this shows nothing of a rig. Source: judgement."""


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
    """Return a table (CSV, Parquet, HDF5, a LeRobot episode or a frame) with all its columns.

    Raises:
        LogError: it cannot be read, holds no numbers, or has fewer than `FEWEST_ROWS` rows.
    """
    cells = open_table(path)
    source = str(path) if isinstance(path, (str, Path, Episode)) else str(cells.path)
    columns = dict[str, Floats]()
    texts = list[str]()
    for name in cells.names:
        try:
            values = cells.values([name])[name]
        except DistalError:
            texts.append(name)
            continue
        if np.isfinite(values).any():
            columns[name] = values
        else:
            texts.append(name)
    log = RawLog(source, columns, tuple(texts))
    if not columns:
        raise LogError(f"{source}: no column holds numbers; a log has a header and rows of numbers")
    if log.rows < FEWEST_ROWS:
        raise LogError(
            f"{source}: {log.rows} rows are too few to learn a rig from; {FEWEST_ROWS} at least"
        )
    return log


def common_columns(logs: Sequence[RawLog]) -> list[str]:
    """Return the headers that all logs have, in the order of the first.

    Raises:
        LogError: they have fewer than two in common; says which are in which.
    """
    shared = [name for name in logs[0].columns if all(name in log.columns for log in logs[1:])]
    if len(shared) >= 2:
        return shared
    other = next(log for log in logs if len(set(log.columns) & set(logs[0].columns)) < 2)
    raise LogError(
        f"{other.source} has the columns {', '.join(other.columns)}; {logs[0].source} has "
        f"{', '.join(logs[0].columns)}: logs of one rig have the same columns"
    )
