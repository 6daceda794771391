"""Formats of logs, one file for each; a new one is a file beside this one and an entry here."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from distal.errors import LogError
from distal.logs.formats.csv import CSV
from distal.logs.formats.format import Format, Message, UndecodableError
from distal.logs.formats.hdf5 import HDF5
from distal.logs.formats.mcap import MCAP
from distal.logs.formats.parquet import PARQUET
from distal.logs.formats.rosbag import ROSBAG

__all__ = ["FORMATS", "TABLES", "Message", "UndecodableError", "check_is_content", "format_of"]

FORMATS = (CSV, PARQUET, HDF5, MCAP, ROSBAG)
"""All formats of logs, in the order in which a path is compared with them."""

TABLES = tuple(ending for kind in FORMATS if kind.read is not None for ending in kind.endings)
"""Endings of the names of files that hold tables."""

POINTER = b"version https://git-lfs.github.com/spec/"
"""First bytes of a file that stands for one in Git LFS. Source: definition (Git LFS
specification).
"""


def check_is_content(path: Path) -> None:
    """Raise a `LogError` where a file only stands for one that Git LFS keeps elsewhere."""
    # what cannot be opened is said by who reads it; reading from a pipe would take the bytes away
    with suppress(OSError):
        if path.is_file():
            with path.open("rb") as file:
                if file.read(len(POINTER)) == POINTER:
                    raise LogError(
                        f"{path}: is a pointer of Git LFS; fetch the log itself with git lfs pull"
                    )


def format_of(path: str | Path) -> Format:
    """Return the format of a log by the ending of its name, or by the file that marks a folder.

    A path without a known ending is taken for CSV.
    """
    path = Path(path)
    with suppress(OSError, ValueError):  # no file can have such a name; reading it raises the error
        for kind in FORMATS:
            if path.suffix.lower() in kind.endings or (
                kind.folder is not None and (path / kind.folder).is_file()
            ):
                return kind
    return CSV
