"""Limit of the memory that a log may take, since a small file can ask for more than there is."""

from __future__ import annotations

import os
from pathlib import Path

from distal.errors import LogError, UnitError
from distal.logs.output_targets import shown
from distal.units import to_si

MOST = 2_000_000_000
"""Memory that reading a log may take, unless the user sets another limit [bytes]. Source:
judgement.
"""

MEMORY_VARIABLE = "DISTAL_MAX_MEMORY"
"""Name of the environment variable that sets another limit; processes hand it on to those they
start.
"""


def memory_limit() -> int:
    """Return the memory that reading one log may take [bytes]: $DISTAL_MAX_MEMORY where it is set,
    else `MOST`.

    Raises:
        LogError: $DISTAL_MAX_MEMORY holds no size.
    """
    limit = os.environ.get(MEMORY_VARIABLE)
    try:
        return size_of(limit) if limit else MOST
    except UnitError as problem:
        raise LogError(f"{MEMORY_VARIABLE}: {problem}") from None


def size_of(text: str) -> int:
    """Return a size such as ``8 GB`` or ``500 MB`` [bytes]; a bare number is in bytes.

    Raises:
        UnitError: the text is no size, or one below 1 MB.
    """
    try:
        size = to_si(float(text), "byte")
    except ValueError:
        size = to_si(text, "byte")
    if not 1e6 <= size < 1e18:
        raise UnitError(
            f"'{text}' is no size to read logs with; from 1 MB on is allowed, e.g. 8 GB"
        )
    return int(size)


def check_memory(path: Path, needed: float, why: str) -> None:
    """Raise a `LogError` where reading a log needs more memory than is allowed.

    Args:
        needed: memory that reading takes [bytes].
        why: first words of the message, which say what takes this memory.
    """
    if needed > memory_limit():
        raise LogError(
            f"{shown(path)}: {why}, about {needed / 1e9:.1f} GB in memory; {how_to_allow()}"
        )


def how_to_allow() -> str:
    """Return a sentence that says how the user allows more memory."""
    return (
        f"{memory_limit() / 1e9:.3g} GB are allowed; if the file is to be trusted, allow more "
        f"with {MEMORY_VARIABLE}=16GB distal …"
    )
