"""The formats of logs: a new one is a file beside this one, and an entry here."""

from __future__ import annotations

from pathlib import Path

from distal.logs.formats.csv import CSV
from distal.logs.formats.format import Format
from distal.logs.formats.mcap import MCAP
from distal.logs.formats.parquet import PARQUET
from distal.logs.formats.rosbag import ROSBAG

FORMATS = (CSV, PARQUET, MCAP, ROSBAG)

TABLES = tuple(ending for one in FORMATS if one.read is not None for ending in one.endings)
"""Endings of the names of tables."""


def format_of(path: str | Path) -> Format:
    """Return the format of a log by its name, of a folder by what is in it; a name without a known ending is CSV."""
    path = Path(path)
    for one in FORMATS:
        try:
            if path.suffix.lower() in one.endings or (one.folder is not None and (path / one.folder).is_file()):
                return one
        except (OSError, ValueError):  # no name that a file could have; reading it says so
            break
    return CSV
