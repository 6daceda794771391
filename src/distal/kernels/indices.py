"""Numbers of a vector by their indices, by which functions of parts are joined to one function of
the whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.expressions import MatrixNode, VectorNode

Indices = NDArray[np.intp]


def taken(vector: VectorNode, at: Indices) -> VectorNode:
    """Return the numbers of a vector at some indices."""
    return vector[at.tolist()]


def placed(parts: Sequence[MatrixNode], positions: Sequence[Indices], size: int) -> VectorNode:
    """Return a vector of length `size` with the numbers of the `parts` at their `positions`, and
    zero elsewhere.
    """
    order = np.concatenate(positions)
    sources = np.full(size, len(order))
    sources[order] = np.arange(len(order))
    joined: VectorNode = ca.vertcat(*parts, 0.0)
    return joined[sources.tolist()]


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
        after, y = part.function(
            taken(kernel_state, part.kernel_state), taken(x, part.x), taken(p, part.p)
        )
        following[part.kernel_state.tolist()] = after
        outputs.append(y)
    y = placed(outputs, [part.y for part in parts], sizes[3])
    return ca.Function(
        name, [kernel_state, x, p], [following, y], ["kernel_state", "x", "p"], ["next", "y"]
    )
