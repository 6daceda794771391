"""Named parts of a vector, the same for NumPy and CasADi: the kernel state of a filter, what is
remembered of a drive.
"""

from __future__ import annotations

from functools import lru_cache
from math import prod
from typing import TypeVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.expressions import Expression

Number = TypeVar("Number", bound=np.generic)


class Layout:
    """Where the parts of a vector stand.

    Args:
        parts: name → length, or (rows, columns) of a symmetric matrix, in their order.
    """

    def __init__(self, **parts: int | tuple[int, int]) -> None:
        self._shapes = {
            name: (part,) if isinstance(part, int) else part for name, part in parts.items()
        }
        ends = np.cumsum([0, *(prod(shape) for shape in self._shapes.values())])
        self._slices = {name: slice(int(a), int(b)) for name, a, b in zip(parts, ends, ends[1:])}
        self.size = int(ends[-1])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parts, in their order."""
        return tuple(self._shapes)

    def __getitem__(self, name: str) -> slice:
        """Return where a part stands."""
        return self._slices[name]

    def part(self, vector: Expression, name: str) -> Expression:
        """Return a part of a column of CasADi's, in its shape.

        Args:
            vector: the column; it may be longer than this layout.
        """
        at = self._slices[name]
        shape = self._shapes[name]
        return vector[at] if len(shape) == 1 else ca.reshape(vector[at], *shape)

    def parts(self, vector: Expression) -> dict[str, Expression]:
        """Return all parts of a column of CasADi's by name, in their shapes."""
        return {name: self.part(vector, name) for name in self._shapes}

    def view(self, array: NDArray[Number], name: str) -> NDArray[Number]:
        """Return a part of arrays (…, size), with its shape behind the other axes; a view where it
        can be.

        Args:
            array: it may be longer than this layout.
        """
        at = self._slices[name]
        shape = self._shapes[name]
        return array[..., at].reshape(*array.shape[:-1], *shape)

    def joined(self, **parts: Expression) -> Expression:
        """Return the column of CasADi's that has these parts."""
        assert set(parts) == set(self._shapes), (set(parts), set(self._shapes))
        return ca.vertcat(*(ca.vec(ca.densify(parts[name])) for name in self._shapes))


@lru_cache(maxsize=64)
def kernel_state_layout(states: int, **memory: int) -> Layout:
    """Return the layout of a filter's kernel_state: the mean, its covariance, what the filter
    remembers of its inputs.
    """
    return Layout(mean=states, covariance=(states, states), **memory)


def mean_of(kernel_state: NDArray[Number], states: int) -> NDArray[Number]:
    """Return the mean, (…, n), of a `kernel_state` or several, (…, size)."""
    return kernel_state_layout(states).view(kernel_state, "mean")


def covariance_of(kernel_state: NDArray[Number], states: int) -> NDArray[Number]:
    """Return the covariance, (…, n, n), of a `kernel_state` or several, (…, size)."""
    return kernel_state_layout(states).view(kernel_state, "covariance")


def variances_of(kernel_state: NDArray[Number], states: int) -> NDArray[Number]:
    """Return the variances of the states, (…, n), of a `kernel_state` or several, (…, size)."""
    variances: NDArray[Number] = np.diagonal(
        covariance_of(kernel_state, states), axis1=-2, axis2=-1
    )
    return variances
