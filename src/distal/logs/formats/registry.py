"""The list of the formats of logs; a new format is a file beside this one and an entry here."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from distal.errors import Content, LogError, OutputError
from distal.logs.formats.csv import CSV
from distal.logs.formats.format import EXTRAS, Format
from distal.logs.formats.hdf5 import HDF5
from distal.logs.formats.jsonl import JSONL
from distal.logs.formats.mcap import MCAP
from distal.logs.formats.parquet import PARQUET
from distal.logs.formats.rosbag import ROSBAG

FORMATS = (CSV, PARQUET, HDF5, JSONL, MCAP, ROSBAG)
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
                        "is a pointer of Git LFS; fetch the log itself with git lfs pull"
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


def check_format(path: str | Path) -> None:
    """Raise an `OutputError` where a path ends as a file that is never written, or where the
    package for its format is missing.
    """
    kind = format_of(path)
    if kind.write is None or Path(path).suffix.lower() in UNWRITTEN:
        raise OutputError(
            f"{path}: results are written as CSV (.csv, .txt) or Parquet (.parquet, .pq)"
        )
    if kind.package is not None and find_spec(kind.package) is None:
        raise OutputError(
            f"{path}: needs the package {kind.package} (pip install '.[{EXTRAS[kind.package]}]'); "
            "or write CSV"
        )


UNWRITTEN = (".xlsx", ".xls", ".ods", ".mat", ".npz")
"""Endings of tables that other programs write."""


def file_of(columns: Mapping[str, NDArray[np.generic]], path: str | Path) -> Content:
    """Return columns as the content of the file `path`, in the format of its ending: a function
    that writes them piece by piece.

    Raises:
        OutputError: see `check_format`.
    """
    check_format(path)
    write = format_of(path).write
    assert write is not None
    return partial(write, columns)
