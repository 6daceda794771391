"""Datasets of robot learning (LeRobot, versions 2 and 3): their episodes, each a log."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from distal.arrays import Floats
from distal.errors import DistalWarning, LogError
from distal.logs.cells import Cells, in_memory
from distal.logs.reader_process import table_by_process
from distal.logs.vectors import INFO, dataset_info

EPISODE = "episode_index"
"""Column of the episode that a row is of."""

STATE = "observation.state."
STAMPS = {"time": ("timestamp",)}
"""Where a dataset has what motors read, and its time."""


@dataclass(frozen=True)
class Episode:
    """One episode of a dataset: the file that holds it, and its number there."""

    path: Path
    number: int

    @property
    def stem(self) -> str:
        """A name for files of its own."""
        return f"episode_{self.number:06d}"

    @property
    def name(self) -> str:
        """A name for tables."""
        return self.stem

    def __str__(self) -> str:
        """Return file and number."""
        return f"{self.path}, episode {self.number}"


def is_dataset(path: Path) -> bool:
    """Return whether a folder is a dataset."""
    return (path / INFO).is_file()


def episodes_of(folder: Path) -> list[Episode]:
    """Return the episodes of a dataset, in the order of its files.

    Raises:
        LogError: it has none, is half written, or none of its files can be read; those that cannot
            are left out with a warning.
    """
    dataset_info(folder)
    files = sorted((folder / "data").rglob("*.parquet"))
    if not files:
        raise LogError(f"{folder}: is a dataset without files in 'data'")
    found = dict[int, Episode]()
    problems = list[LogError]()
    for file in files:
        try:
            cells = table_by_process(file, [EPISODE])
        except LogError as problem:
            problems.append(problem)  # a recording that broke off leaves a file without its end
            continue
        cells.check([EPISODE])
        values = cells.values([EPISODE])[EPISODE]
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


def rows_of_episode(episode: Episode, columns: list[str] | None) -> Cells:
    """Return the cells of an episode."""
    # a rig whose columns are motors finds them in the vector of the state, and its time in the
    # stamps
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
    held = {
        name: np.asarray(cells.column(name))[mine]
        for name in cells.names
        if asked is None or name in asked
    }
    named = {alias[name]: values for name, values in held.items() if name in alias} | held
    return in_memory(
        named, episode.path, 1, [*cells.names, *(name for name in named if name not in cells.names)]
    )


@lru_cache(maxsize=2)
def _file(path: Path, written: int, columns: tuple[str, ...] | None) -> tuple[Cells, Floats]:
    """Return a file's cells and the episode of each row: its episodes are read one after the
    other.
    """
    cells = table_by_process(path, columns)
    cells.check([EPISODE])
    return cells, cells.values([EPISODE])[EPISODE]
