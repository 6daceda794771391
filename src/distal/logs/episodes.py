"""Episodes of robot-learning datasets (LeRobot, versions 2 and 3), each of which is a log."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from distal.arrays import Floats
from distal.errors import DistalWarning, LogError
from distal.logs.cells import Cells, in_memory
from distal.logs.formats.parquet import read_parquet
from distal.logs.reader_process import read_apart
from distal.logs.vectors import INFO, dataset_info

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
    def stem(self) -> str:
        """The episode's name without an ending, for names of files."""
        return f"episode_{self.number:06d}"

    @property
    def name(self) -> str:
        """The episode's name in tables of results."""
        return self.stem

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
            cells = read_apart(read_parquet, file, [EPISODE])
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
    """Return a file's cells and the episode of each row, (n,).

    The file is kept for the next call, since its episodes are read one after the other. `written`
    is when the file was changed last [ns], so that a changed file is read again.
    """
    cells = read_apart(read_parquet, path, columns)
    cells.check([EPISODE])
    return cells, cells.values([EPISODE])[EPISODE]
