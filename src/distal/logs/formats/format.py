"""What a format of logs offers: a table, or messages with topics."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from distal.logs.cells import Cells


@dataclass(frozen=True)
class Message:
    """One message of a recording.

    Args:
        recorded: when the message was recorded [ns].
        stamp: stamp in the message's header [ns], None where it has none.
        read: function from a field's path to its content, None where the message lacks the field.
        content: the message itself, whose fields `read` finds.
        json: whether the message is JSON, whose fields may be looked for by name without a topic.
    """

    topic: str
    recorded: int
    stamp: int | None
    read: Callable[[str], object]
    content: object
    json: bool = False


@dataclass(frozen=True)
class Format:
    """A format of logs: `read` reads a table, `messages` reads a recording of topics.

    Args:
        endings: endings of the names of its files, in lower case.
        read: function from a path and the needed columns (None: all) to the table; columns that are
            not needed may be left out.
        messages: function from a path and a set to the messages; it adds the names of the
            recording's topics to the set.
        write: function from columns to the content of a file; None where results cannot be written
            in this format.
        package: package without which nothing can be written, and the extra of distal that installs
            it; None where no package is needed.
        apart: whether files are read in a process of their own. Formats that are read by compiled
            code need this, since a damaged file may end the process.
        folder: name of the file that marks a folder as a log of this format; None where no folder
            is one.
    """

    endings: tuple[str, ...]
    read: Callable[[Path, Sequence[str] | None], Cells] | None = None
    messages: Callable[[Path, set[str]], Iterator[Message]] | None = None
    write: Callable[[Mapping[str, NDArray[np.generic]]], bytes] | None = None
    package: tuple[str, str] | None = None
    apart: bool = True
    folder: str | None = None
