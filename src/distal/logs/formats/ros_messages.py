"""Stamps and fields of ROS messages, which are in bags and in MCAP files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np


def stamp_of(message: object) -> int | None:
    """Return the stamp in a ROS message's header [ns], or None where it has none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return None if stamp is None else int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def field(message: object, path: str) -> object:
    """Return the field of a ROS message at a path such as ``wrench.force.z`` or ``position[0]``.

    The result is None where the message lacks the field.
    """
    for part in _parts(path):
        if isinstance(part, int):
            if not isinstance(message, Sequence | np.ndarray) or part >= len(message):
                return None
            message = message[part]
        else:
            message = getattr(message, part, None)
            if message is None:
                return None
    return message


def _parts(path: str) -> Iterable[str | int]:
    for part in path.replace("[", ".[").split("."):
        if part.startswith("["):
            yield int(part[1:-1]) if part[1:-1].isdecimal() else part
        elif part:
            yield part
