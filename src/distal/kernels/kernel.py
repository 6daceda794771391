"""A kernel: one function of a kernel state and a sample, compiled where that is possible and
interpreted otherwise; and its runs, one alone or several side by side, one in each vector lane,
on several threads.

Kernels that a process has made are kept by their structure, since rigs that differ in their
numbers alone share one.
"""

from __future__ import annotations

import ctypes
import os
import platform
import threading
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import prod
from threading import RLock
from typing import Literal, TypeVar, cast

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.codegen import Lanes
from distal.errors import KernelWarning
from distal.expressions import VectorNode
from distal.kernels.compiler import (
    OPTIMISED,
    OPTIMISED_LANES,
    QUICK,
    SWITCHED_OFF,
    CompileError,
    Recipe,
    Structure,
    c_source,
    cpu,
    emitted,
    library_of,
    loaded,
    needed_compiler,
    sizes_of,
)
from distal.kernels.layout import Advanced, Feed, Sizes

_BATCH = """
/* {count} runs of {name}: of each sample's kernel_state the numbers `keep` are kept, and y; a run
 * that ended rests */
void {name}_batch(const long long* rows, const double* const* kernel_state, const double* const* x,
                  const double* const* p,
                  long long n_keep, const int* keep, double* const* kept, double* const* y) {{
  V c[2][{n_kernel_state}], sample[{n_x}], numbers[{n_p}], out[{n_y}];
  long long k, most = 0, i;
  int l;
  for (l = 0; l < {count}; ++l) {{
    for (i = 0; i < {n_kernel_state}; ++i) c[0][i][l] = kernel_state[l][i];
    for (i = 0; i < {n_p}; ++i) numbers[i][l] = p[l][i];
    if (rows[l] > most) most = rows[l];
  }}
  for (k = 0; k < most; ++k) {{
    const V* now = c[k & 1];
    V* next = c[~k & 1];
    for (l = 0; l < {count}; ++l) {{
      const double* row = x[l] + k * {n_x};
      for (i = 0; i < {n_x}; ++i) sample[i][l] = k < rows[l] ? row[i] : 0.0;
    }}
    {name}(now, sample, numbers, next, out);
    for (l = 0; l < {count}; ++l) {{
      if (k >= rows[l]) continue;
      for (i = 0; i < n_keep; ++i) kept[l][k * n_keep + i] = next[keep[i]][l];
      for (i = 0; i < {n_y}; ++i) y[l][k * {n_y} + i] = out[i][l];
    }}
  }}
}}

/* one sample of groups of {count} runs each, whose kernel states are changed in place */
void {name}_step(long long groups, V* kernel_state, const V* x, const V* p, V* y) {{
  V next[{n_kernel_state}];
  long long g, i;
  for (g = 0; g < groups; ++g, kernel_state += {n_kernel_state}, x += {n_x}, y += {n_y}) {{
    {name}(kernel_state, x, p, next, y);
    for (i = 0; i < {n_kernel_state}; ++i) kernel_state[i] = next[i];
  }}
}}
"""


@lru_cache(maxsize=1)
def lanes_here() -> int:
    """Return the number of vector lanes: how many numbers of double precision this processor takes
    at once.
    """
    features = cpu()
    if "avx512f" in features:
        return 8
    return 4 if "avx2" in features or platform.machine() == "x86_64" else 2


class LaneKernel:
    """A kernel (kernel_state, x, p) → (kernel_state⁺, y) over several runs at once. Its results are
    those of one run after the other.

    Raises:
        CompileError: there is no compiler, or it does not know vectors, or the function has no C.
    """

    def __init__(self, recipe: Recipe) -> None:
        self.lanes = lanes_here()
        library = library_of(
            recipe,
            f"{self.lanes} lanes",
            lambda function: emitted(function, Lanes(lanes_here()), _BATCH),
            OPTIMISED_LANES,
        )
        self.sizes = library.sizes
        self._batch = loaded(
            library, "batch", [*4 * [ctypes.c_void_p], ctypes.c_longlong, *3 * [ctypes.c_void_p]]
        )
        self._step = loaded(library, "step", [ctypes.c_longlong, *4 * [ctypes.c_void_p]])

    def scan(self, feeds: Sequence[Feed], keep: Sequence[int]) -> list[Advanced]:
        """Return the results of several runs: of the kernel state after each row only the numbers
        `keep`, (k, len(keep)), and the outputs.

        Args:
            feeds: at most `lanes` runs, which may differ in length.
            keep: indices of numbers of the kernel state.
        """
        dense = [feed.dense(self.sizes) for feed in feeds]
        lengths = np.zeros(self.lanes, dtype=np.int64)
        lengths[: len(feeds)] = [len(feed.rows) for feed in dense]
        out = [
            Advanced(np.empty((rows, len(keep))), np.empty((rows, self.sizes.y)))
            for rows in lengths[: len(feeds)]
        ]
        kept = np.array(keep, dtype=np.int32)
        # lanes without a run of their own begin as the first one, with no rows, and keep nothing
        self._batch(
            lengths.ctypes.data,
            *(self._pointers(arrays) for arrays in zip(*dense)),
            len(kept),
            kept.ctypes.data,
            *(self._pointers(arrays) for arrays in zip(*out)),
        )
        return out

    def empty(self, *shape: int) -> Floats:
        """Return an array of zeros (…, lanes) that begins where vectors may begin in memory."""
        size = prod(shape) * self.lanes
        room = np.zeros(size + self.lanes)
        first = -room.ctypes.data // room.itemsize % self.lanes
        return room[first : first + size].reshape(*shape, self.lanes)

    def step(self, kernel_state: Floats, x: Floats, p: Floats, y: Floats) -> None:
        """Advance groups of runs by one sample each; `kernel_state` and `y` are changed in place.

        Args:
            kernel_state: (groups, n_kernel_state, lanes), as of `empty`.
            x: (groups, n_x, lanes).
            p: the parameters that all have in common, (n_p, lanes).
            y: (groups, n_y, lanes).
        """
        self._step(len(x), *(array.ctypes.data for array in (kernel_state, x, p, y)))

    def _pointers(self, arrays: Sequence[Floats]) -> ctypes.Array[ctypes.c_void_p]:
        filled = [*arrays, *[arrays[0]] * (self.lanes - len(arrays))]
        return (ctypes.c_void_p * self.lanes)(*(array.ctypes.data for array in filled))


AT_ONCE = 1 << 20
"""Numbers of whole kernel states in memory, where few of them are kept [1]: 8 MB. Source:
judgement.
"""

Compiled = bool | Literal["lanes", "quick"]
"""How a kernel is compiled: where possible, or never; only for several runs at once; or in a third
of the time, to run half as fast.
"""

_warned: set[str] = set()
"""Why kernels are interpreted, as far as a warning has said it in this process."""

_building = threading.Lock()


class Kernel:
    """A function (kernel_state, x, p) → (kernel_state⁺, y), to be used on a log (`scan`), sample by
    sample (`loop`) or on several logs at once (`lanes`).

    Args:
        function: the CasADi function, whose inputs and outputs are dense columns, or its recipe.
        compiled: whether to compile it where possible; with False it is always interpreted, with
            "lanes" only one run alone is, see `Compiled`.
    """

    def __init__(self, function: ca.Function | Recipe, compiled: Compiled = True) -> None:
        self._recipe = Recipe(lambda: function) if isinstance(function, ca.Function) else function
        self.backend: Literal["compiled", "interpreted"] = "interpreted"
        self.reason = "asked for"
        self._scan: Callable[..., None] | None = None
        self._compiled = compiled
        self._external: ca.Function | None = None
        if compiled is True or compiled == "quick":
            level = QUICK if compiled == "quick" else OPTIMISED
            try:
                library = library_of(self._recipe, "scan", c_source, level)
                self._scan = loaded(library, "scan", [ctypes.c_longlong, *5 * [ctypes.c_void_p]])
                self._external = ca.external(f"{library.name}_kernel", str(library.path))
                self.sizes = library.sizes
                self.backend = "compiled"
                self.reason = needed_compiler().version
            except CompileError as problem:
                self.reason = str(problem)
                if self.reason not in (SWITCHED_OFF, *_warned):
                    _warned.add(self.reason)
                    warnings.warn(
                        f"kernels are interpreted, about 15 times slower: {self.reason}",
                        KernelWarning,
                        stacklevel=3,
                    )

    @property
    def function(self) -> ca.Function:
        """The CasADi function of this kernel."""
        return self._recipe.function

    @cached_property
    def sizes(self) -> Sizes:
        """The lengths of the kernel state, x, p and y."""
        return sizes_of(self.function)

    def scan(
        self, kernel_state: Floats, xs: Floats, p: Floats, keep: Sequence[int] | None = None
    ) -> Advanced:
        """Return the kernel states after each sample of a log, (n, n_kernel_state), and the
        outputs, (n, n_y).

        Args:
            kernel_state: before the first sample, (n_kernel_state,).
            xs: the samples, (n, n_x).
            p: the parameters, (n_p,).
            keep: indices of the numbers of the kernel states that are returned; default all.
        """
        start, rows, parameters = feed = Feed(kernel_state, xs, p).dense(self.sizes)
        ys = np.empty((len(rows), self.sizes.y))
        if keep is not None:  # only some samples' whole kernel states are in memory at once
            columns = np.empty((len(rows), len(keep)))
            step = 1 + AT_ONCE // self.sizes.kernel_state
            for begin in range(0, len(rows), step):
                part = slice(begin, begin + step)
                states, ys[part] = self.scan(start, rows[part], parameters)
                columns[part] = states[:, list(keep)]
                start = states[-1]
            return Advanced(columns, ys)
        kernel_states = np.empty((len(rows), self.sizes.kernel_state))
        if self._scan is not None:
            arrays = (*feed, kernel_states, ys)
            self._scan(len(rows), *(array.ctypes.data for array in arrays))
        else:
            loop = self.loop(parameters)
            loop.kernel_state[:] = start
            for k, x in enumerate(rows):
                loop.x[:] = x
                loop.step()
                kernel_states[k] = loop.kernel_state
                ys[k] = loop.y
        return Advanced(kernel_states, ys)

    def loop(self, p: Floats) -> Loop:
        """Return this kernel with a kernel state of its own, to be called for one sample after the
        other.
        """
        return Loop(self.function if self._external is None else self._external, p)

    def lanes(self) -> LaneKernel | None:
        """Return the same kernel for several runs at once, or None where it cannot be built. It is
        built at the first call.
        """
        with _building:
            return self._lanes

    @cached_property
    def _lanes(self) -> LaneKernel | None:
        if self.backend == "interpreted" and self._compiled != "lanes":
            return None
        try:
            return LaneKernel(self._recipe)
        except CompileError:
            return None  # one by one gives the same numbers

    @property
    def side_by_side(self) -> int:
        """How many runs this kernel takes at once."""
        lanes = self.lanes()
        return 1 if lanes is None else lanes.lanes


class Evaluation:
    """A CasADi function that is called with arrays and returns arrays, without CasADi's own
    matrices. Threads that share it take turns.
    """

    def __init__(self, function: ca.Function) -> None:
        self.arguments = [np.zeros(int(function.numel_in(i))) for i in range(function.n_in())]
        self.outputs = [np.zeros(int(function.numel_out(i))) for i in range(function.n_out())]
        self._buffer, self.run = function.buffer()
        for i, array in enumerate(self.arguments):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate(self.outputs):
            self._buffer.set_res(i, array.data)
        self._lock = threading.Lock()

    def __call__(self, *arguments: object) -> list[Floats]:
        """Return the outputs, each as a column. Each argument has as many numbers as its input."""
        with self._lock:
            for array, argument in zip(self.arguments, arguments):
                array[:] = argument  # type: ignore[call-overload]
            self.run()
            return [array.copy() for array in self.outputs]


class Loop:
    """A kernel that keeps its kernel state between samples: write `x`, call `step`, read
    `kernel_state` and `y`. Only one thread may use it.
    """

    def __init__(self, call: ca.Function, p: Floats) -> None:
        self._call = Evaluation(call)
        self.kernel_state, self.x, self.parameters = self._call.arguments
        self._next, self.y = self._call.outputs
        self.parameters[:] = np.reshape(p, self.parameters.size)

    def step(self) -> None:
        """Advance the kernel state by the sample `x`, and set `y`."""
        self._call.run()
        self.kernel_state[:] = self._next


_TURNS = RLock()

Made = TypeVar("Made")


def kernel_of(
    structure: Structure | None,
    make: Callable[[], ca.Function],
    compiled: Compiled = True,
) -> Kernel:
    """Return the kernel of a structure: the one that this process keeps, or a new one.

    Args:
        structure: all that the kernel depends on; None for a new kernel that is not kept.
        make: returns its function, which must depend on the structure alone.
        compiled: as for `Kernel`.
    """
    if structure is None:
        return Kernel(Recipe(make), compiled)
    wishes = tuple(os.environ.get(name) for name in ("DISTAL_COMPILE", "DISTAL_CACHE", "CC"))
    key = (structure.key, compiled, *wishes)
    recipe = _kept((structure.key, "recipe"), lambda: Recipe(make, structure))
    return _kept(key, lambda: Kernel(recipe, compiled))


def function_of(structure: Structure, make: Callable[[], ca.Function]) -> ca.Function:
    """Return the function of a structure, for a function that is not called often enough for a
    kernel: the one that this process keeps, or a new one.
    """
    return _kept((structure.key,), make)


@lru_cache
def _slot(key: tuple[object, ...]) -> list[object]:
    """Return the slot of what is kept by a key, empty at first; the cache drops what was not asked
    for the longest.
    """
    return []


def _kept(key: tuple[object, ...], make: Callable[[], Made]) -> Made:
    with _TURNS:
        slot = _slot(key)
        if not slot:
            slot.append(make())
        return cast(Made, slot[0])


Indices = NDArray[np.intp]


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
    order = np.concatenate([part.y for part in parts])
    sources = np.full(sizes[3], len(order))
    sources[order] = np.arange(len(order))
    sorted_y = ca.vertcat(*outputs, 0.0)[sources.tolist()]
    y = ca.vec(sorted_y)  # of no numbers a column, not a row, of length 0
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
    return kernel.scan(*feed, keep)


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
