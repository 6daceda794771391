"""Functions as C, each written once and after those that it calls."""

from __future__ import annotations

from collections.abc import Container
from itertools import chain, count

import casadi as ca

from distal.codegen.functions import write_matrices, write_scalars
from distal.codegen.number_types import CodeError, Dialect
from distal.codegen.workspace import Written

LARGEST_COPIED = 60
"""Largest number of operations of a called function that the compiler is asked to inline. Compilers
take minutes over many copies of a longer one: the equations of three sheaths in lanes take 12 s
with 400 and 1.7 s with 60, which costs a tenth of their speed, and a filter nothing. Source:
judgement.
"""


class Emitter:
    """Writes CasADi functions as static C functions. Each function is written once, and functions
    with the same text share one.
    """

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self.functions: dict[str, Written] = {}
        self._names: dict[tuple[int, bool], str] = {}
        self._taken: set[str] = set()
        self._alike: dict[str, str] = {}
        self._by_scalars: set[str] = set()
        self._alive: list[
            ca.Function
        ] = []  # a function's hash is its address: no other function may get it

    @property
    def text(self) -> str:
        """All functions written so far, each after those that it calls."""
        inline = f"static {self.dialect.inline}void "
        return "\n".join(
            written.text.replace("static void ", inline, 1)
            if name in self._by_scalars
            else written.text
            for name, written in self.functions.items()
        )

    def add(self, function: ca.Function, in_place: bool = False) -> str:
        """Write a function, of scalars (SX) or of matrices (MX), and those that it calls; return
        its name in C.

        With `in_place` the first input and the first output are one array, ``state``, which the
        function changes.

        Raises:
            CodeError: the function has an operation that has no C here, or its state cannot be
                changed in place.
        """
        return self._written(function, in_place).name

    def _written(self, function: ca.Function, in_place: bool = False) -> Written:
        key = (function.__hash__(), in_place)
        if key in self._names:
            return self.functions[self._names[key]]
        if in_place and function.sparsity_in(0) != function.sparsity_out(0):
            raise CodeError(
                f"'{function.name()}' has no C in place: its first input and output differ in shape"
            )
        name = unused(str(function.name()), self._taken)
        self._taken.add(name)
        if function.is_a("SXFunction"):
            written = write_scalars(function, name, in_place, self.dialect, self._called)
        else:
            written = write_matrices(function, name, in_place, self.dialect, self._written)
        self._alive.append(function)
        # components of a rig that are built alike share one function, called with the parameters
        # of each
        alike = self._alike.setdefault(written.text.replace(f" {name}(", " (", 1), name)
        self._names[key] = alike
        if alike != name:
            self._taken.remove(name)
            return self.functions[alike]
        self.functions[name] = written
        return written

    def _called(self, function: ca.Function) -> Written:
        """Return a function that a function of scalars calls. The compiler is asked to inline a
        small one, if the dialect allows long code.
        """
        written = self._written(function)
        if written.cost.operations <= LARGEST_COPIED:
            self._by_scalars.add(written.name)
        return written


def unused(name: str, taken: Container[str]) -> str:
    """Return a name with a number behind it where it is taken, from 2 on."""
    candidates = chain([name], (f"{name}_{number}" for number in count(2)))
    return next(candidate for candidate in candidates if candidate not in taken)
