"""How to make the function of a kernel. It is made only where it is needed, since a compiled kernel
is found by its structure.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from threading import RLock

import casadi as ca

from distal.kernels.structure import Structure

_MAKING = RLock()  # CasADi does not count its symbols safely over threads


class Recipe:
    """A CasADi function (kernel_state, x, p) → (kernel_state⁺, y) that is made at its first use.

    Args:
        make: returns the function.
        structure: all that the function depends on; where it is None, compiled kernels are found by
            their C instead.
    """

    def __init__(self, make: Callable[[], ca.Function], structure: Structure | None = None) -> None:
        self._make = make
        self.structure = structure

    @cached_property
    def function(self) -> ca.Function:
        """The CasADi function, made at the first call."""
        with _MAKING:
            return self._make()

    def written(self, source: Callable[[ca.Function], str]) -> str:
        """Return the C that `source` writes of the function."""
        function = self.function
        with _MAKING:
            return source(function)

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """The lengths of the kernel state, x, p and y."""
        function = self.function
        kernel_state, x, p = (int(function.numel_in(i)) for i in range(3))
        return kernel_state, x, p, int(function.numel_out(1))
