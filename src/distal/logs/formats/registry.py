"""The formats of logs: a new one is a file beside this one, and an entry here."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from distal.logs.formats.csv import CSV
from distal.logs.formats.format import Format
from distal.logs.formats.hdf5 import HDF5
from distal.logs.formats.mcap import MCAP
from distal.logs.formats.parquet import PARQUET
from distal.logs.formats.rosbag import ROSBAG

FORMATS = (CSV, PARQUET, HDF5, MCAP, ROSBAG)

TABLES = tuple(ending for kind in FORMATS if kind.read is not None for ending in kind.endings)
"""Endings of the names of tables."""


def format_of(path: str | Path) -> Format:
    """Return the format of a log by its name, of a folder by what is in it; a name without a known
    ending is CSV.
    """
    path = Path(path)
    with suppress(OSError, ValueError):  # no name that a file could have; reading it says so
        for kind in FORMATS:
            if path.suffix.lower() in kind.endings or (
                kind.folder is not None and (path / kind.folder).is_file()
            ):
                return kind
    return CSV
