"""What a format of logs offers: a table, or messages with topics."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from distal.errors import LogError
from distal.logs.messages import find
from distal.logs.output_files import shown
from distal.logs.table_cells import Cells


class UndecodableError(LogError):
    """A message of a recording is of a kind that cannot be read."""


@dataclass(frozen=True)
class Message:
    """One message of a recording; it is decoded when it is asked for.

    Args:
        recorded: when the message was recorded [ns].
        decode: function that returns the message's content.
        json: whether the message is JSON, whose fields may be looked for by name without a topic.
    """

    topic: str
    recorded: int
    decode: Callable[[], object]
    json: bool = False

    @cached_property
    def content(self) -> object:
        """The message itself; None for JSON that cannot be read.

        Raises:
            UndecodableError: the message cannot be decoded.
            ImportError: the package for that is missing.
        """
        try:
            return self.decode()
        except ImportError:
            raise
        except Exception as problem:
            raise UndecodableError(
                f"a message of '{self.topic}' cannot be decoded "
                f"({type(problem).__name__}: {str(problem)[:120]})"
            ) from None

    @property
    def stamp(self) -> int | None:
        """Stamp in the header of a message of ROS [ns], None where it has none."""
        stamp = getattr(getattr(self.content, "header", None), "stamp", None)
        return None if stamp is None else int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)

    def read(self, path: str) -> object:
        """Return the content of a field, None where the message lacks it; see `find`."""
        return find(self.content, path)


EXTRAS = {
    "pyarrow": "parquet",
    "h5py": "hdf5",
    "mcap": "mcap",
    "rosbags": "ros",
    "pandas": "pandas",
    "polars": "polars",
}
"""Packages that are not needed, and the extra that installs each."""


@dataclass(frozen=True)
class Format:
    """A format of logs: `read` reads a table, `messages` reads a recording of topics.

    Args:
        name: what its files are called in messages.
        endings: endings of the names of its files, in lower case.
        read: function from a path and the needed columns (None: all) to the table; columns that are
            not needed may be left out.
        messages: function from a path and a set to the messages; it adds the names of the
            recording's topics to the set.
        write: function that writes columns into a file; None where results cannot be written in
            this format.
        package: package without which nothing can be written; None where none is needed.
        folder: name of the file that marks a folder as a log of this format; None where no folder
            is one.
    """

    name: str
    endings: tuple[str, ...]
    read: Callable[[Path, Sequence[str] | None], Cells] | None = None
    messages: Callable[[Path, set[str]], Iterator[Message]] | None = None
    write: Callable[[Mapping[str, NDArray[np.generic]], BinaryIO], None] | None = None
    package: str | None = None
    folder: str | None = None

    @contextmanager
    def reading(self, path: Path) -> Iterator[None]:
        """Turn whatever is raised while a log is read into a `LogError` with its path before it: of
        a damaged file the packages that read it may raise anything.
        """
        try:
            yield
        except MemoryError:
            raise
        except LogError as problem:
            raise LogError(f"{shown(path)}: {problem}") from None
        except ImportError as problem:
            package = (problem.name or "").partition(".")[0]
            raise LogError(
                f"{shown(path)}: {self.name} needs the package {package} (pip install "
                f"'.[{EXTRAS.get(package, package)}]')"
            ) from None
        except OSError as problem:
            reason = problem.strerror or str(problem)[:160]
            raise LogError(f"{shown(path)}: cannot be read ({reason})") from None
        except Exception as problem:
            raise LogError(
                f"{shown(path)}: cannot be read as {self.name} ({type(problem).__name__}: "
                f"{str(problem)[:160]}); is it damaged?"
            ) from None
