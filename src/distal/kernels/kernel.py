"""A kernel: one function of a carry and a sample, compiled where that is possible, interpreted otherwise."""

from __future__ import annotations

import ctypes
import threading
import warnings
from collections.abc import Callable
from typing import Literal

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.errors import KernelWarning
from distal.kernels.compiler import CompileError, UnwantedError, compiled_library, find_compiler
from distal.kernels.lanes import LaneKernel

Backend = Literal["compiled", "interpreted"]
_said: set[str] = set()
_building = threading.Lock()


class Kernel:
    """A function (carry, x, p) → (carry⁺, y) for a log (`scan`), sample by sample (`loop`) or several logs (`lanes`).

    Args:
        function: the CasADi function; its inputs and outputs are dense columns.
        compiled: compile it if possible; False keeps the interpreter, "lanes" keeps it for one run alone.
    """

    def __init__(self, function: ca.Function, compiled: bool | Literal["lanes"] = True) -> None:
        self._interpreted = function
        self.n_carry, self.n_x, self.n_p = (int(function.numel_in(i)) for i in range(3))
        self.n_y = int(function.numel_out(1))
        self.backend: Backend = "interpreted"
        self.reason = "asked for"
        self._scan: Callable[..., int] | None = None
        self._lanes: LaneKernel | None = None
        self._laned = not compiled  # what is not wanted counts as tried
        self._lanes_alone = compiled == "lanes"
        self._lock = threading.Lock()  # one set of buffers: threads that share a kernel take turns
        call = function
        if compiled is True:
            try:
                call = self._load()
            except CompileError as problem:
                self.reason = str(problem)
                if not isinstance(problem, UnwantedError):
                    _warn(self.reason)
        self._carry, self._x = np.zeros(self.n_carry), np.zeros(self.n_x)
        self._p, self._y = np.zeros(self.n_p), np.zeros(self.n_y)
        self._next = np.zeros(self.n_carry)
        self._buffer, self._trigger = call.buffer()
        for i, array in enumerate((self._carry, self._x, self._p)):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate((self._next, self._y)):
            self._buffer.set_res(i, array.data)
        self._call = call

    def _load(self) -> ca.Function:
        name = self._interpreted.name()
        library = compiled_library(self._interpreted)
        try:
            external = ca.external(f"{name}_kernel", str(library))
            scan = getattr(ctypes.CDLL(str(library)), f"{name}_scan")
        except (OSError, RuntimeError, AttributeError) as problem:
            raise CompileError(f"the compiled kernel {library} cannot be loaded ({type(problem).__name__})") from None
        scan.restype = ctypes.c_longlong
        scan.argtypes = [ctypes.c_longlong] + 5 * [ctypes.c_void_p]
        self._scan = scan
        compiler = find_compiler()
        self.backend, self.reason = "compiled", compiler if isinstance(compiler, str) else compiler.version
        return external

    @property
    def function(self) -> ca.Function:
        """The CasADi function itself."""
        return self._interpreted

    def scan(self, carry: Floats, xs: Floats, p: Floats) -> tuple[Floats, Floats]:
        """Return the carries after every sample, (n, n_carry), and the outputs, (n, n_y), in one call.

        Args:
            carry: before the first sample, (n_carry,).
            xs: the samples, (n, n_x).
            p: the parameters, (n_p,).
        """
        xs = np.ascontiguousarray(xs, dtype=np.float64).reshape(-1, self.n_x)
        carries, ys = np.empty((len(xs), self.n_carry)), np.empty((len(xs), self.n_y))
        if self._scan is not None:
            start = np.ascontiguousarray(carry, dtype=np.float64).reshape(self.n_carry)
            held = np.ascontiguousarray(p, dtype=np.float64).reshape(self.n_p)
            addresses = (a.ctypes.data for a in (start, xs, held, carries, ys))
            done = self._scan(len(xs), *addresses)
            if done != len(xs):
                raise RuntimeError(f"kernel {self._interpreted.name()} failed at sample {done}")
            return carries, ys
        with self._lock:
            self._carry[:] = carry
            self._p[:] = p
            for k, x in enumerate(xs):
                self._x[:] = x
                self._trigger()
                carries[k], ys[k] = self._next, self._y
                self._carry[:] = self._next
        return carries, ys

    def loop(self, p: Floats) -> Loop:
        """Return the kernel with a carry of its own, for one sample after the other.

        Args:
            p: the parameters, (n_p,).
        """
        return Loop(self._call, self.n_carry, self.n_x, np.array(p, dtype=np.float64), self.n_y)

    def lanes(self) -> LaneKernel | None:
        """Return the same kernel for several runs at once, built when first asked for; None where that cannot be."""
        with _building:
            if not self._laned:
                self._laned = True
                if self.backend == "compiled" or self._lanes_alone:
                    try:
                        self._lanes = LaneKernel(self._interpreted)
                    except CompileError:
                        self._lanes = None  # one by one gives the same numbers
        return self._lanes

    @property
    def side_by_side(self) -> int:
        """How many runs go through it at once."""
        lanes = self.lanes()
        return 1 if lanes is None else lanes.lanes


class Evaluation:
    """A function of arrays to arrays, called without CasADi's own matrices; threads that share it take turns.

    Args:
        function: the CasADi function; its inputs and outputs are dense.
    """

    def __init__(self, function: ca.Function) -> None:
        self._arguments = [np.zeros(int(function.numel_in(i))) for i in range(function.n_in())]
        self._results = [np.zeros(int(function.numel_out(i))) for i in range(function.n_out())]
        self._buffer, self._trigger = function.buffer()
        self._lock, self._function = threading.Lock(), function
        for i, array in enumerate(self._arguments):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate(self._results):
            self._buffer.set_res(i, array.data)

    def __call__(self, *arguments: object) -> list[Floats]:
        """Return the results, each as a column.

        Args:
            arguments: arrays of numbers, each as long as its input has numbers.
        """
        with self._lock:
            for array, argument in zip(self._arguments, arguments):
                array[:] = argument  # type: ignore[call-overload]
            self._trigger()
            return [array.copy() for array in self._results]


class Loop:
    """A kernel whose carry stays where it is: write `x`, call `step`, read `carry` and `y`. For one thread.

    Args:
        call: the function.
        n_carry: numbers in the carry.
        n_x: numbers in a sample.
        p: the parameters.
        n_y: numbers that are put out.
    """

    def __init__(self, call: ca.Function, n_carry: int, n_x: int, p: Floats, n_y: int) -> None:
        self.carry, self.x, self.y = np.zeros(n_carry), np.zeros(n_x), np.zeros(n_y)
        self._p, self._next = p, np.zeros(n_carry)
        self._buffer, self._trigger = call.buffer()
        for i, array in enumerate((self.carry, self.x, self._p)):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate((self._next, self.y)):
            self._buffer.set_res(i, array.data)

    def step(self) -> None:
        """Advance the carry by one sample."""
        self._trigger()
        self.carry[:] = self._next


def _warn(reason: str) -> None:
    """Say once per reason and process that kernels are interpreted."""
    if reason in _said:
        return
    _said.add(reason)
    warnings.warn(f"kernels are interpreted, about 15 times slower: {reason}", KernelWarning, stacklevel=4)
