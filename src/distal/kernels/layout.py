"""Vectors with named parts, the same for NumPy and CasADi, such as the kernel state of a filter."""

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
    """The positions of the named parts of a vector.

    Args:
        parts: name → length, or (rows, columns) of a matrix, in their order. CasADi reads a matrix
            column by column and NumPy row by row; both agree on symmetric ones.
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
        """Names of the parts in their order."""
        return tuple(self._shapes)

    def __getitem__(self, name: str) -> slice:
        """Return the slice of a part."""
        return self._slices[name]

    def part(self, vector: Expression, name: str) -> Expression:
        """Return a part of a CasADi column, in its shape.

        Args:
            vector: the column; it may be longer than this layout.
        """
        at = self._slices[name]
        shape = self._shapes[name]
        return vector[at] if len(shape) == 1 else ca.reshape(vector[at], *shape)

    def parts(self, vector: Expression) -> dict[str, Expression]:
        """Return all parts of a CasADi column by name, in their shapes; the `vector` may be longer
        than this layout.
        """
        return {name: self.part(vector, name) for name in self._shapes}

    def view(self, array: NDArray[Number], name: str) -> NDArray[Number]:
        """Return a part of an array (…, size) in its shape, behind the array's other axes; a view
        where that is possible.

        Args:
            array: it may be longer than this layout.
        """
        at = self._slices[name]
        shape = self._shapes[name]
        return array[..., at].reshape(*array.shape[:-1], *shape)

    def joined(self, **parts: Expression) -> Expression:
        """Return the CasADi column that has these parts, by name."""
        assert set(parts) == set(self._shapes), (set(parts), set(self._shapes))
        return ca.vertcat(*(ca.vec(ca.densify(parts[name])) for name in self._shapes))


@lru_cache(maxsize=64)
def kernel_state_layout(states: int, **memory: int) -> Layout:
    """Return the layout of a filter's kernel state: the mean of its `states`, their covariance, and
    what the filter remembers of its inputs, `memory`.
    """
    return Layout(mean=states, covariance=(states, states), **memory)


def mean_of(kernel_state: NDArray[Number], states: int) -> NDArray[Number]:
    """Return the mean, (…, n), in one `kernel_state` or several, (…, size), of a filter with n
    `states`.
    """
    return kernel_state_layout(states).view(kernel_state, "mean")


def covariance_of(kernel_state: NDArray[Number], states: int) -> NDArray[Number]:
    """Return the covariance, (…, n, n), in one `kernel_state` or several, (…, size), of a filter
    with n `states`.
    """
    return kernel_state_layout(states).view(kernel_state, "covariance")


def variances_of(kernel_state: NDArray[Number], states: int) -> NDArray[Number]:
    """Return the variances of the states, (…, n), in one `kernel_state` or several, (…, size), of a
    filter with n `states`.
    """
    variances: NDArray[Number] = np.diagonal(
        covariance_of(kernel_state, states), axis1=-2, axis2=-1
    )
    return variances
