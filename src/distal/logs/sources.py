"""What a log is read from."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Protocol, TypeAlias


class Frame(Protocol):
    """A table in memory with named columns, such as a frame of pandas or polars."""

    @property
    def columns(self) -> Iterable[str]:
        """Names of the columns."""

    def __getitem__(self, name: str, /) -> object:
        """Return a column."""


Source: TypeAlias = str | Path | Frame
"""The path of a file, or a frame."""
