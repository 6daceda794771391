"""A kernel: one function of a kernel state and a sample, which is compiled where that is possible
and interpreted otherwise; and the kernels that a process keeps by their structure, since rigs that
differ in their numbers alone share one.
"""

from __future__ import annotations

import ctypes
import os
import threading
import warnings
from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache
from threading import RLock
from typing import Literal, TypeVar, cast

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.errors import KernelWarning
from distal.kernels.cache import Recipe, Structure
from distal.kernels.compiler import (
    OPTIMISED,
    QUICK,
    CompileError,
    UnwantedError,
    c_source,
    find_compiler,
    library_of,
    loaded,
)
from distal.kernels.lanes import LaneKernel
from distal.kernels.layout import Feed, Sizes

AT_ONCE = 1 << 20
"""Numbers of whole kernel states in memory, where few of them are kept [1]: 8 MB. Source:
judgement.
"""

Backend = Literal["compiled", "interpreted"]

Compiled = bool | Literal["lanes", "quick"]
"""How a kernel is compiled: where possible, or never; only for several runs at once; or in a third
of the time, to run half as fast.
"""

_warned: set[str] = set()
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
        self.backend: Backend = "interpreted"
        self.reason = "asked for"
        self._scan: Callable[..., None] | None = None
        self._compiled = compiled
        self._sizes: Sizes | None = None
        self._external: ca.Function | None = None
        if compiled is True or compiled == "quick":
            try:
                self._external = self._load(QUICK if compiled == "quick" else OPTIMISED)
            except CompileError as problem:
                self.reason = str(problem)
                if not isinstance(problem, UnwantedError):
                    _warn(self.reason)

    def _load(self, level: str) -> ca.Function:
        library = library_of(self._recipe, "scan", c_source, level)
        self._scan = loaded(library, "scan", [ctypes.c_longlong, *5 * [ctypes.c_void_p]])
        self._sizes = library.sizes
        compiler = find_compiler()
        self.backend = "compiled"
        self.reason = compiler if isinstance(compiler, str) else compiler.version
        return ca.external(f"{library.name}_kernel", str(library.path))

    @property
    def function(self) -> ca.Function:
        """The CasADi function of this kernel."""
        return self._recipe.function

    @cached_property
    def sizes(self) -> Sizes:
        """The lengths of the kernel state, x, p and y."""
        return self._recipe.sizes if self._sizes is None else self._sizes

    def scan(
        self, kernel_state: Floats, xs: Floats, p: Floats, keep: Sequence[int] | None = None
    ) -> tuple[Floats, Floats]:
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
            return columns, ys
        kernel_states = np.empty((len(rows), self.sizes.kernel_state))
        if self._scan is not None:
            arrays = (*feed, kernel_states, ys)
            self._scan(len(rows), *(array.ctypes.data for array in arrays))
            return kernel_states, ys
        loop = self.loop(parameters)
        loop.kernel_state[:] = start
        for k, x in enumerate(rows):
            loop.x[:] = x
            loop.step()
            kernel_states[k] = loop.kernel_state
            ys[k] = loop.y
        return kernel_states, ys

    def loop(self, p: Floats) -> Loop:
        """Return this kernel with a kernel state of its own, to be called for one sample after the
        other.
        """
        call = self.function if self._external is None else self._external
        return Loop(call, np.array(p, dtype=np.float64).reshape(self.sizes.p))

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
        self._arguments = [np.zeros(int(function.numel_in(i))) for i in range(function.n_in())]
        self._outputs = [np.zeros(int(function.numel_out(i))) for i in range(function.n_out())]
        self._trigger, self._buffer = _attached(function, self._arguments, self._outputs)
        self._lock = threading.Lock()

    def __call__(self, *arguments: object) -> list[Floats]:
        """Return the outputs, each as a column. Each argument has as many numbers as its input."""
        with self._lock:
            for array, argument in zip(self._arguments, arguments):
                array[:] = argument  # type: ignore[call-overload]
            self._trigger()
            return [array.copy() for array in self._outputs]


class Loop:
    """A kernel that keeps its kernel state between samples: write `x`, call `step`, read
    `kernel_state` and `y`. Only one thread may use it.
    """

    def __init__(self, call: ca.Function, p: Floats) -> None:
        self.kernel_state = np.zeros(call.numel_in(0))
        self.x = np.zeros(call.numel_in(1))
        self.parameters = p
        self._next = np.zeros(call.numel_out(0))
        self.y = np.zeros(call.numel_out(1))
        self._trigger, self._buffer = _attached(
            call, (self.kernel_state, self.x, self.parameters), (self._next, self.y)
        )

    def step(self) -> None:
        """Advance the kernel state by the sample `x`, and set `y`."""
        self._trigger()
        self.kernel_state[:] = self._next


def _attached(
    function: ca.Function, arguments: Sequence[Floats], outputs: Sequence[Floats]
) -> tuple[Callable[[], None], object]:
    """Return a function that evaluates `function` from and into arrays, and the buffer that must
    live as long.
    """
    buffer, trigger = function.buffer()
    for i, array in enumerate(arguments):
        buffer.set_arg(i, array.data)
    for i, array in enumerate(outputs):
        buffer.set_res(i, array.data)
    return trigger, buffer


def _warn(reason: str) -> None:
    """Warn, once per reason and process, that kernels are interpreted."""
    if reason in _warned:
        return
    _warned.add(reason)
    warnings.warn(
        f"kernels are interpreted, about 15 times slower: {reason}", KernelWarning, stacklevel=4
    )


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


def forget() -> None:
    """Drop all kernels and functions that this process keeps, so that they are made anew."""
    with _TURNS:
        _slot.cache_clear()


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
