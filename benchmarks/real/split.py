"""Logs to learn from and logs to judge by."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Split:
    """A rig with its logs.

    Args:
        title: name of the rig.
        training: logs to learn from.
        judged: whole other files, which nothing has seen.
        words: options of `distal learn`.
    """

    title: str
    training: tuple[Path, ...]
    judged: tuple[Path, ...]
    words: tuple[str, ...] = ()
