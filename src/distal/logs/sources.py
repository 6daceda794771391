"""What a log can be read from."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Protocol, TypeAlias

from distal.logs.episodes import Episode


class Frame(Protocol):
    """A table in memory with named columns, such as a frame of pandas or polars."""

    @property
    def columns(self) -> Iterable[str]:
        """Names of the frame's columns."""

    def __getitem__(self, name: str, /) -> object:
        """Return the column of a name."""


Source: TypeAlias = str | Path | Frame | Episode
"""The path of a file, a frame, or an episode of a dataset."""
