"""Work on many items by several threads. Results come in the items' order, and only what is in work
is in memory.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

AHEAD = 2
"""Number of groups of items that are in work or ready, for each worker. Source: judgement."""


def grouped(items: Iterable[Item], size: int) -> Iterator[list[Item]]:
    """Yield items in groups of `size`, for vector lanes. Items that came before an error are
    yielded before it is raised.
    """
    group: list[Item] = []
    try:
        for item in items:
            group.append(item)
            if len(group) == size:
                yield group
                group = []
    except Exception:
        if group:
            yield group
        raise
    if group:
        yield group


def in_order(
    items: Iterable[Item], size: int, work: Callable[[list[Item]], list[Result]], workers: int
) -> Iterator[tuple[Item, Result]]:
    """Yield each item with its result, in order. Items that came before an error are yielded before
    it is raised.

    Args:
        size: number of items in a group.
        work: returns the results of a group.
        workers: number of threads.
    """
    groups = grouped(items, size)
    waiting: deque[tuple[list[Item], Future[list[Result]]]] = deque()
    ended: BaseException | None = None
    pool = ThreadPoolExecutor(workers)
    try:
        while True:
            try:
                while ended is None and len(waiting) < AHEAD * workers:
                    group = next(groups, None)
                    if group is None:
                        break
                    waiting.append((group, pool.submit(work, group)))
            except Exception as problem:
                ended = problem
            if not waiting:
                if ended is not None:
                    raise ended
                return
            done, future = waiting.popleft()
            yield from zip(done, future.result())
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
