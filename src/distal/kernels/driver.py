"""Runs of kernels: their kernel states and outputs, for one run or for several side by side in
vector lanes.

Numbers of a vector by their indices, by which functions of parts are joined to one function of
the whole.

Work on many items by several threads. Results come in the items' order, and only what is in work
is in memory.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.expressions import MatrixNode, VectorNode
from distal.kernels.kernel import Kernel
from distal.kernels.layout import Advanced, Feed

Indices = NDArray[np.intp]


def placed(parts: Sequence[MatrixNode], positions: Sequence[Indices], size: int) -> VectorNode:
    """Return a vector of length `size` with the numbers of the `parts` at their `positions`, and
    zero elsewhere.
    """
    order = np.concatenate(positions)
    sources = np.full(size, len(order))
    sources[order] = np.arange(len(order))
    joined: VectorNode = ca.vertcat(*parts, 0.0)
    return ca.vec(joined[sources.tolist()])  # of no numbers a column, not a row, of length 0


@dataclass(frozen=True)
class PlacedKernel:
    """The function (kernel_state, x, p) → (kernel_state⁺, y) of a part, and the indices that the
    numbers of each of these vectors have in that of the whole.
    """

    function: ca.Function
    kernel_state: Indices
    x: Indices
    p: Indices
    y: Indices


def side_by_side(
    name: str, parts: Sequence[PlacedKernel], sizes: tuple[int, int, int, int]
) -> ca.Function:
    """Return the function (kernel_state, x, p) → (kernel_state⁺, y) of several independent parts
    together.

    The `sizes` are the lengths of kernel_state, x, p and y. Numbers of the kernel state that belong
    to no part stay as they are; those of y are zero.
    """
    kernel_state, x, p = (
        ca.MX.sym(symbol, size) for symbol, size in zip(("kernel_state", "x", "p"), sizes)
    )
    following = ca.MX(kernel_state)
    outputs = list[VectorNode]()
    for part in parts:
        states = part.kernel_state.tolist()
        after, y = part.function(kernel_state[states], x[part.x.tolist()], p[part.p.tolist()])
        following[states] = after
        outputs.append(y)
    y = placed(outputs, [part.y for part in parts], sizes[3])
    return ca.Function(name, [kernel_state, x, p], [following, y])


Item = TypeVar("Item")
Result = TypeVar("Result")

AHEAD = 2
"""Number of groups of items for each worker: one in work, one ready. Source: definition (the least
with which no worker waits).
"""


def in_order(
    items: Iterable[Item], size: int, work: Callable[[list[Item]], list[Result]], workers: int
) -> Iterator[tuple[Item, Result]]:
    """Yield each item with its result, in order. Items that came before an error are yielded before
    it is raised.

    Args:
        size: number of items in a group, for vector lanes.
        work: returns the results of a group.
        workers: number of threads.
    """
    coming = iter(items)
    waiting: deque[tuple[list[Item], Future[list[Result]]]] = deque()
    ended: Exception | None = None
    pool = ThreadPoolExecutor(workers)
    try:
        while True:
            while ended is None and len(waiting) < AHEAD * workers:
                group: list[Item] = []
                try:
                    while len(group) < size:
                        group.append(next(coming))
                except Exception as problem:  # at the end of the items a StopIteration
                    ended = problem
                if group:
                    waiting.append((group, pool.submit(work, group)))
            if waiting:
                done, future = waiting.popleft()
                yield from zip(done, future.result())
            elif isinstance(ended, StopIteration):
                return
            elif ended is not None:
                raise ended
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def advance(kernel: Kernel, feed: Feed, keep: Sequence[int] | None = None) -> Advanced:
    """Return the kernel states and outputs of a kernel in one run; see `advance_all` for `keep`."""
    return Advanced(*kernel.scan(*feed, keep))


def advance_all(
    kernel: Kernel, feeds: Sequence[Feed], keep: Sequence[int] | None = None
) -> list[Advanced]:
    """Return what a kernel gives in several runs, side by side where it has vector lanes. The
    results are those of `advance` for each run.

    Args:
        keep: indices of the numbers of the kernel state that are returned; default all.
    """
    lanes = kernel.lanes() if len(feeds) > 1 or kernel.backend == "interpreted" else None
    if lanes is None:
        return [advance(kernel, feed, keep) for feed in feeds]
    columns = range(kernel.sizes.kernel_state) if keep is None else keep
    groups = (feeds[k : k + lanes.lanes] for k in range(0, len(feeds), lanes.lanes))
    return [run for group in groups for run in lanes.scan(group, columns)]


def at_samples(run: Advanced, last: Indices) -> Advanced:
    """Return the rows of a run that belong to the samples of a log, whose indices are `last`; other
    rows are steps in between.
    """
    return run if len(last) == len(run.ys) else Advanced(run.kernel_states[last], run.ys[last])
