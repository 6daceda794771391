"""Names for the types of CasADi's expressions in signatures: a number, a column or a matrix; and
what all functions are made with: their symbols, their outputs, and rotation matrices.

CasADi has two kinds of expressions. In an `SX` every entry is an expression of its own: the model
is written in them. In an `MX` a whole matrix is one node of the graph: the filters join their
functions with them. The two kinds do not mix, so that each has names of its own here. The names
stand for CasADi's own types, so that a type checker uses CasADi's stubs where its version has them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias, TypeVar

import casadi as ca

Scalar: TypeAlias = ca.SX | ca.DM | float
"""One number, 1 × 1: an expression, or a plain number where its value is known."""

Vector: TypeAlias = ca.SX | ca.DM
"""A column of n numbers, n × 1."""

Matrix: TypeAlias = ca.SX | ca.DM
"""A matrix of numbers, n × m."""

ScalarNode: TypeAlias = ca.MX
"""One number, 1 × 1, in a function of matrices."""

VectorNode: TypeAlias = ca.MX
"""A column, n × 1, in a function of matrices."""

MatrixNode: TypeAlias = ca.MX
"""A matrix, n × m, in a function of matrices."""

Expression = TypeVar("Expression", ca.SX, ca.MX)
"""Either kind of expression, the same one throughout a signature; its docstring says the shape."""


def rotation(axis: Sequence[float], angle: Scalar) -> Matrix:
    """Return the rotation matrix R = a aᵀ + cos θ (1 − a aᵀ) + sin θ [a×] about a unit `axis` a by
    an `angle` θ [rad], (3, 3) (Rodrigues).
    """
    a = ca.DM(list(axis))
    along = ca.mtimes(a, a.T)
    return along + ca.cos(angle) * (ca.DM.eye(3) - along) + ca.sin(angle) * ca.skew(a)


def symbols(kind: type[Expression], /, **sizes: int | tuple[int, int]) -> list[Expression]:
    """Return new symbols of a `kind` of expression, by their names and their sizes n or (rows,
    columns).
    """
    return [kind.sym(name, size) for name, size in sizes.items()]


def dense_function(name: str, inputs: Sequence[Vector], outputs: Sequence[Matrix]) -> ca.Function:
    """Return a function of some `inputs` whose `outputs` have all their entries, and which computes
    nothing twice.
    """
    return ca.Function(name, inputs, ca.cse([ca.densify(output) for output in outputs]))
