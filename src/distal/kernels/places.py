"""Numbers of a vector by their places: how functions of parts become one function of the whole."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.expressions import MatrixNode, VectorNode

Indices = NDArray[np.intp]


def taken(vector: VectorNode, at: Indices) -> VectorNode:
    """Return some numbers of a vector."""
    return vector[at.tolist()]


def placed(parts: Sequence[MatrixNode], places: Sequence[Indices], size: int) -> VectorNode:
    """Return a vector with the numbers of parts at their places, zero elsewhere."""
    order = np.concatenate(places)
    sources = np.full(size, len(order))
    sources[order] = np.arange(len(order))
    joined: VectorNode = ca.vertcat(*parts, 0.0)
    return joined[sources.tolist()]
