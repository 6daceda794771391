"""Tables from files and frames, and episodes of robot-learning datasets (LeRobot, versions 2 and
3), each of which is a log.

Every error names the file, row and column, the value found, and what is allowed.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np

from distal.arrays import Floats
from distal.errors import DistalWarning, LogError
from distal.logs.cells import INFO, Cells, Column, as_column, dataset_info
from distal.logs.column_units import needed, units_of
from distal.logs.formats import check_is_content, format_of
from distal.logs.formats.parquet import read_parquet
from distal.logs.outputs import shown
from distal.logs.recordings import read_recording

EPISODE = "episode_index"
"""Column that holds the number of the episode to which a row belongs."""

STATE = "observation.state."
"""What stands before the name of a motor in the columns of a dataset's readings."""

STAMPS = {"time": ("timestamp",)}
"""Name of a rig's time column → names that a dataset's time column may have."""


@dataclass(frozen=True)
class Episode:
    """One episode of a dataset: the file that holds it, and the episode's number."""

    path: Path
    number: int

    @property
    def name(self) -> str:
        """The episode's name in tables of results, and of files without their ending."""
        return f"episode_{self.number:06d}"

    stem = name

    def __str__(self) -> str:
        """Return file and number."""
        return f"{self.path}, episode {self.number}"


def is_dataset(path: Path) -> bool:
    """Return whether a folder is a LeRobot dataset."""
    return (path / INFO).is_file()


def episodes_of(folder: Path) -> list[Episode]:
    """Return the episodes of a dataset, in the order of its files.

    A file that cannot be read is left out with a warning.

    Raises:
        LogError: the dataset has no file, its description or all its files cannot be read, a row
            has no episode, or an episode is in two files.
    """
    dataset_info(folder)
    files = sorted((folder / "data").rglob("*.parquet"))
    if not files:
        raise LogError(f"{folder}: is a dataset without files in 'data'")
    found = dict[int, Episode]()
    problems = list[LogError]()
    for file in files:
        try:
            cells = read_parquet(file, [EPISODE])
        except LogError as problem:
            problems.append(problem)  # a recording that broke off leaves a file without its end
            continue
        cells.check([EPISODE])
        values = cells.values(EPISODE)
        if not np.isfinite(values).all():
            raise LogError(f"{file}: '{EPISODE}' lacks values")
        for number in map(int, dict.fromkeys(values.tolist())):
            if number in found:
                raise LogError(f"{found[number]}: is in two files")
            found[number] = Episode(file, number)
    if not found and problems:
        raise problems[0]
    for unread in problems:
        warnings.warn(f"left out: {unread}", DistalWarning, stacklevel=2)
    return list(found.values())


def sources_of(logs: Sequence[Path]) -> list[Path | Episode]:
    """Return logs, each dataset as its episodes; see `episodes_of`."""
    return [
        source for path in logs for source in (episodes_of(path) if is_dataset(path) else [path])
    ]


def rows_of_episode(episode: Episode, columns: list[str] | None) -> Cells:
    """Return the cells of an episode.

    Args:
        columns: names of the columns that are needed; None needs all. A motor's name also finds its
            number in ``observation.state``.
    """
    # where a rig's columns are names of motors, they are looked for in the vector of the state,
    # and its time in the dataset's stamps
    alias = (
        {}
        if columns is None
        else {other: name for name in columns for other in (STATE + name, *STAMPS.get(name, ()))}
    )
    asked = None if columns is None else (*columns, *alias, EPISODE)
    try:
        written = episode.path.stat().st_mtime_ns
    except OSError as problem:
        raise LogError(f"{episode.path}: cannot be read ({problem.strerror or problem})") from None
    cells, values = _file(episode.path, written, asked)
    mine = values == episode.number
    held: dict[str, Column] = {
        name: np.asarray(column)[mine] for name, column in cells.columns.items()
    }
    named = {alias[name]: values for name, values in held.items() if name in alias} | held
    return Cells(named, episode.path, 1, tuple(dict.fromkeys((*cells.names, *named))))


@lru_cache(maxsize=2)
def _file(path: Path, written: int, columns: tuple[str, ...] | None) -> tuple[Cells, Floats]:
    """Return a file's cells and the episode of each row, (n,).

    The file is kept for the next call, since its episodes are read one after the other. `written`
    is when the file was changed last [ns], so that a changed file is read again.
    """
    cells = read_parquet(path, columns)
    cells.check([EPISODE])
    return cells, cells.values(EPISODE)


class Frame(Protocol):
    """A table in memory with named columns, such as a frame of pandas or polars."""

    @property
    def columns(self) -> Iterable[str]:
        """Names of the frame's columns."""

    def __getitem__(self, name: str, /) -> object:
        """Return the column of a name."""


Source: TypeAlias = str | Path | Frame | Episode
"""The path of a file, a frame, or an episode of a dataset."""


def read_table(path: str | Path, desired: Sequence[str] | None = None) -> Cells:
    """Return columns of a CSV or Parquet file as numbers.

    Args:
        path: a file whose format follows from its ending; without a known ending it is CSV with a
            header, separated by comma, semicolon or tab.
        desired: columns that must be there; None reads all.

    Raises:
        LogError: the file cannot be read, a column is missing or doubled, a cell is not a number, a
            row is short or long, or there is no row.
    """
    cells = open_table(path, desired)
    return cells.parsed(cells.names if desired is None else desired)


def open_table(
    path: Source, columns: Sequence[str] | None = None, time: str = "t", unit: float = 1.0
) -> Cells:
    """Return the cells of a file, a recording of topics (`read_recording`), a frame, or
    an episode of a dataset.

    Args:
        path: a path, a frame of any library whose columns have ``to_numpy``, or an episode.
        columns: names of the columns that are needed, with or without units; None needs all. Others
            may be left out where the format allows that.
        time: time column; a recording has its stamps there, and a pandas frame that lacks it its
            index of dates.
        unit: unit of the time column in a recording's JSON messages [s].

    Raises:
        LogError: see `read_table`.
    """
    cells = _opened(path, columns, time, unit)
    return cells.without_units(units_of(cells.names, columns or (), cells.source))


def _opened(path: Source, columns: Sequence[str] | None, time: str, unit: float) -> Cells:
    if isinstance(path, Episode):
        return rows_of_episode(path, None if columns is None else list(columns))
    if isinstance(path, (str, Path)):
        path = Path(path)
        try:
            is_folder = path.is_dir()
        except (OSError, ValueError, RuntimeError) as problem:
            raise LogError(
                f"{shown(path)}: cannot be read ({getattr(problem, 'strerror', None) or problem})"
            ) from None
        check_is_content(path)
        kind = format_of(path)
        if kind.read is None:
            return read_recording(path, columns, time, unit)
        if is_folder:
            raise LogError(
                f"{path}: is a folder without {INFO}, so no dataset; give its files, such as "
                f"{path}/*.csv"
            )
        return kind.read(path, columns)
    if not hasattr(path, "columns"):
        raise LogError(f"a log is a path, a frame or a distal.Log; {type(path).__name__} came")
    columns_of = {
        str(name): _column(path[name]) for name in path.columns if needed(str(name), columns)
    }
    names = [str(name) for name in path.columns]
    index = getattr(path, "index", None)
    if time not in names and _is_dated(index):
        columns_of[time] = _column(index)
        names = [*names, time]
    return Cells(columns_of, Path("the frame"), 0, tuple(names))


def _is_dated(column: Any) -> bool:
    """Return whether a column or an index of a frame holds dates."""
    return str(getattr(column, "dtype", "")).startswith("datetime64")


def _column(column: Any) -> Column:
    """Return a frame's column or index as cells.

    Dates with a zone are turned into UTC.
    """
    if _is_dated(column) and getattr(column.dtype, "tz", None) is not None:
        column = getattr(column, "dt", column).tz_convert(None)
    return as_column(np.asarray(column.to_numpy()))
