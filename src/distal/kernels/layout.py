"""The vectors of kernels: named parts of a vector, the same for NumPy and CasADi; the mask of a
sample; the inputs of a run and its results.

A row of a kernel is x = (dt, values, mask). The mask says what is done with each of the values: it
is one of the constants here, and in rows between samples, that of a displacement may be `bridge(k)`
instead.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import accumulate, pairwise
from math import prod
from typing import NamedTuple, TypeVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.expressions import Expression, Scalar

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
        ends = [*accumulate(map(prod, self._shapes.values()), initial=0)]
        self._slices = {name: slice(*pair) for name, pair in zip(parts, pairwise(ends))}
        self.size = ends[-1]

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

    def views(self, array: NDArray[Number]) -> dict[str, NDArray[Number]]:
        """Return all parts of an array (…, size) by name; see `view`."""
        return {name: self.view(array, name) for name in self._shapes}

    def rows(self, **parts: Floats) -> Floats:
        """Return the rows, (k, size), that have these parts, (k, …) each, by name."""
        return np.column_stack([parts[name] for name in self._shapes])

    def joined(self, **parts: Expression) -> Expression:
        """Return the CasADi column that has these parts, by name."""
        assert set(parts) == set(self._shapes), (set(parts), set(self._shapes))
        return ca.vertcat(*(ca.vec(ca.densify(parts[name])) for name in self._shapes))


@lru_cache(maxsize=64)
def kernel_state_layout(states: int, **memory: int | tuple[int, int]) -> Layout:
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
    return covariance_of(kernel_state, states).diagonal(axis1=-2, axis2=-1)


READ = 1.0
"""Mask of a value that was read. Source: definition (of the mask)."""

MISSING = 0.0
"""Mask of a value that is missing: zero stands in its place, and nothing is done with it. Source:
definition (of the mask).
"""

COMPARED_ONLY = -1.0
"""Mask of a force, a tension or an angle that is only compared: its innovation is shown, but
corrects nothing. Source: definition (of the mask).
"""


def bridge(rows: int) -> float:
    """Return the mask −k of a displacement in a gap, which goes in a straight line to the reading
    that ends the gap.

    Args:
        rows: k, the number of rows to that reading, this row's own step included; at least 2.
    """
    return -float(rows)


def is_read(mask: Scalar) -> Scalar:
    """Return 1 where a value was read, else 0."""
    return mask > MISSING


def is_there(mask: Scalar) -> Scalar:
    """Return 1 where there is a value, whatever is done with it, else 0."""
    return mask != MISSING


def is_bridge(mask: Scalar) -> Scalar:
    """Return 1 where a displacement crosses a gap, else 0."""
    return mask < MISSING


def rows_left(mask: Scalar) -> Scalar:
    """Return the number of rows to the reading that ends a gap, the k of `bridge`; 1 where there is
    no gap.
    """
    return ca.if_else(is_bridge(mask), -mask, 1)


def share_used(mask: Scalar) -> Scalar:
    """Return 1 where a value corrects the state, else 0."""
    return ca.fmax(mask, MISSING)


class Sizes(NamedTuple):
    """The lengths of a kernel's arguments and of its output."""

    kernel_state: int
    x: int
    p: int
    y: int


class Feed(NamedTuple):
    """The inputs of a kernel in one run.

    Args:
        kernel_state: before the first row, (n_kernel_state,).
        rows: the samples, in order, (k, n_x).
        p: the parameters, (n_p,).
    """

    kernel_state: Floats
    rows: Floats
    p: Floats

    def dense(self, sizes: Sizes) -> Feed:
        """Return the same arrays as C reads them, in their shapes."""
        shapes = (sizes.kernel_state,), (-1, sizes.x), (sizes.p,)
        return Feed(
            *(
                np.ascontiguousarray(part, dtype=np.float64).reshape(shape)
                for part, shape in zip(self, shapes)
            )
        )


class Advanced(NamedTuple):
    """The results of a kernel in one run.

    Args:
        kernel_states: after each row, (k, n_kernel_state), or only those numbers of each that are
            kept.
        ys: the outputs of each row, (k, n_y).
    """

    kernel_states: Floats
    ys: Floats
