"""Where work runs: with one BLAS thread where small matrices are multiplied.

NumPy's BLAS uses all cores for each product. For matrices of some dozen columns that gains nothing,
and beside other busy processes its threads wait for each other, spinning: a product takes a
thousand times as long (`python -m benchmarks.newcomers --busy 8`).
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

from threadpoolctl import ThreadpoolController, threadpool_limits

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
