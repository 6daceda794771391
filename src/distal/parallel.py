"""Where work runs: with one BLAS thread where small matrices are multiplied, and by the workers of
a Dask cluster.

NumPy's BLAS uses all cores for each product. For matrices of some dozen columns that gains nothing,
and beside other busy processes its threads wait for each other, spinning: a product takes a
thousand times as long (`python -m benchmarks.newcomers --busy 8`).
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from typing import TypeVar

from threadpoolctl import ThreadpoolController, threadpool_limits

from distal.errors import DistalError
from distal.version import __version__

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


PATIENCE = 10.0
"""Longest wait for an answer of the scheduler [s]. Source: judgement."""

Key = TypeVar("Key")
Result = TypeVar("Result")


def on_cluster(
    function: Callable[..., Result],
    tasks: Mapping[Key, tuple[object, ...]],
    address: str,
    error: type[DistalError],
    lost: str,
) -> Iterator[tuple[Key, Result]]:
    """Yield the key and the result of each task as it ends; the workers of a Dask scheduler run
    function(*arguments).

    Args:
        tasks: key → arguments.
        address: of the scheduler, ``tcp://host:8786``.
        error: class of what is raised where the cluster is not as it should be, or a task fails; an
            error of this class in a task is raised as it is.
        lost: what the message tells a user to do where a task fails.
    """
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise error("--scheduler needs Dask; pip install '.[dask]'") from None
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, ImportError, TypeError) as problem:
        raise error(
            f"no scheduler answers at {address} ({str(problem)[:80]}); start one: dask scheduler"
        ) from None
    with client:
        keys = {
            client.submit(_far, function, arguments, error, __version__, pure=False): key
            for key, arguments in tasks.items()
        }
        try:
            for future in as_completed(list(keys), loop=client.loop):
                try:
                    result = future.result()
                except error:
                    raise
                except Exception as problem:  # whatever a cluster may do to a task
                    kind = type(problem).__name__
                    raise error(
                        f"a task failed on the cluster ({kind}: {str(problem)[:120]}); {lost}"
                    ) from None
                yield keys.pop(future), result
                future.release()
        finally:
            client.cancel(list(keys), force=True)


def _far(
    function: Callable[..., Result],
    arguments: tuple[object, ...],
    error: type[DistalError],
    version: str,
) -> Result:
    """Run a task on a worker, or raise `error` where the worker has another version of distal."""
    if version != __version__:
        raise error(
            f"a worker has distal {__version__}, this is {version}; install the same on all"
        )
    return function(*arguments)
