"""What a format of logs is: tables, or messages with topics."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from distal.logs.cells import Cells


@dataclass(frozen=True)
class Message:
    """One message of a recording: when it was `recorded` and the stamp in its header, if it has one
    [ns], and its fields.

    `read` gives a field, None where it is not there; those of JSON may be looked for by name alone.
    """

    topic: str
    recorded: int
    stamp: int | None
    read: Callable[[str], object]
    json: bool = False


@dataclass(frozen=True)
class Format:
    """A format of logs: a table is read by `read`, a recording of topics by `messages`.

    Args:
        endings: of the names of its files, in lower case.
        read: path and the columns that are needed (None: all) → the table; columns that are not
            needed may be left out.
        messages: path and a set → the messages; the topics that are there are put into the set.
        write: columns → the content of a file; None where results cannot be written so.
        package: without which nothing can be written, and the extra of distal that installs it, or
            None.
        apart: whether files are read in a process of its own: where compiled code reads them, a
            damaged one may end it.
        folder: the file by which a folder is a log of this format, None where none is.
    """

    endings: tuple[str, ...]
    read: Callable[[Path, Sequence[str] | None], Cells] | None = None
    messages: Callable[[Path, set[str]], Iterator[Message]] | None = None
    write: Callable[[Mapping[str, NDArray[np.generic]]], bytes] | None = None
    package: tuple[str, str] | None = None
    apart: bool = True
    folder: str | None = None
