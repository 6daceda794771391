"""The memory that reading a log may take: a small file can ask for more than there is."""

from __future__ import annotations

import os

import numpy as np

from distal.errors import LogError, UnitError
from distal.units import to_si

MOST_MEMORY = "2 GB"
"""Memory that reading a log may take, unless the user sets another limit. Source:
judgement.
"""


COPIES = 3
"""Copies of what is read that are in memory while it is turned into numbers. Source: benchmark
(benchmarks/csv_readers).
"""


MEMORY_VARIABLE = "DISTAL_MAX_MEMORY"
"""Name of the environment variable that sets another limit; processes hand it on to those they
start.
"""


def memory_limit() -> int:
    """Return the memory that reading one log may take [bytes]: $DISTAL_MAX_MEMORY where it is set,
    such as ``8 GB``, else `MOST_MEMORY`.

    Raises:
        LogError: $DISTAL_MAX_MEMORY holds no size.
    """
    try:
        return int(to_si(os.environ.get(MEMORY_VARIABLE) or MOST_MEMORY, "byte"))
    except UnitError as problem:
        raise LogError(f"{MEMORY_VARIABLE}: {problem}") from None


def check_rows(rows: int, columns: int) -> None:
    """Raise a `LogError` where a table takes more memory than is allowed."""
    size = rows * columns * np.dtype(np.float64).itemsize
    check_memory(size, f"has {rows:,} rows of {columns} columns or more")


def check_memory(size: float, why: str) -> None:
    """Raise a `LogError` where reading a log needs more memory than is allowed.

    Args:
        size: of what is read [bytes].
        why: first words of the message, which say what takes this memory.
    """
    needed = COPIES * size
    if needed > memory_limit():
        raise LogError(
            f"{why}, about {needed / 1e9:.1f} GB in memory; "
            f"{memory_limit() / 1e9:.3g} GB are allowed; if the file is to be trusted, allow more "
            f"with {MEMORY_VARIABLE}=16GB distal …"
        )
