"""How much of the machine distal uses: one BLAS thread where small matrices are multiplied, and so
much memory for a log, a simulation or a study. A small file can ask for more than there is.

NumPy's BLAS uses all cores for each product. For matrices of some dozen columns that gains nothing,
and beside other busy processes its threads wait for each other, spinning: a product takes a
thousand times as long (`python -m benchmarks.newcomers --busy 8`).
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

import numpy as np
from threadpoolctl import ThreadpoolController, threadpool_limits

from distal.errors import LogError, UnitError
from distal.units import to_si

_changing = threading.Lock()
_within = 0
_limits: threadpool_limits | None = None


@lru_cache(maxsize=1)
def _libraries(modules: int) -> ThreadpoolController:
    """Return the libraries that threadpoolctl finds, which takes a millisecond. They are cached by
    the number of loaded `modules`, since another module may load further libraries.
    """
    return ThreadpoolController()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread, in a ``with`` or as a decorator; the earlier limits are restored
    when the last user has left.

    Some BLAS libraries take limits from the main thread only, so the limits are also restored when
    the main thread leaves. A BLAS that threadpoolctl does not know stays as it is.
    """
    global _within, _limits
    with _changing:
        if _within == 0:
            _limits = _libraries(len(sys.modules)).limit(limits=1, user_api="blas")
        _within += 1
    try:
        yield
    finally:
        with _changing:
            _within -= 1
            last = _within == 0
            if _limits is not None and (
                last or threading.current_thread() is threading.main_thread()
            ):
                _limits.restore_original_limits()
            if last:
                _limits = None


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
