"""Distribution of the joints' torques over the tendons, where these may be more than the joints and
all stay taut.

The pulls f solve A f = τ with f ≥ f_min. The least Σ f is a linear programme: at its solution as
many pulls are at their minimum as there are more pulls than torques (a vertex). The least Σ f², the
heat of equal motors, is a quadratic programme: some pulls are at their minimum, and the others are
the shortest vector that makes the remaining torque. The few sets of pulls that may be at their
minimum are tried one by one, without iteration, in exported C too.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Literal

import casadi as ca

from distal.expressions import Matrix, Scalar, Vector

Prefer = Literal["tension", "heat"]
"""What is least: the sum of the pulls ("tension"), or the sum of their squares ("heat")."""

VIOLATED = 1e6
"""Cost of a newton below the minimum beside that of a newton above it [1]: where no solution keeps
all tendons taut, the nearest to that is taken. Source: judgement.
"""

SINGULAR = 1e-12
"""Magnitude of a determinant per product of the rows' lengths, which bounds it (Hadamard), up to
which its matrix counts as singular [1]. Source: rounding (division by a determinant of zero).
"""


def least_pulls(
    arms: Matrix, torques: Vector, lowest: Vector, one_sided: Sequence[bool], prefer: Prefer
) -> Vector:
    """Return the pulls f, (m,) [N], that solve A f = τ with the least sum, or the least sum of
    squares.

    Where n < m, one-sided pulls are at least `lowest`, if any solution allows that. Where n = m,
    the one solution is returned as it is.

    Args:
        arms: A, (n, m), n ≤ m: torque per pull [m].
        torques: τ, (n,) [N m].
        lowest: f_min, (m,) [N].
        one_sided: which pulls are of drives with a single tendon; a motor that winds two tendons
            pulls either way.
        prefer: which sum is least.
    """
    n, m = arms.shape
    if n == m:
        return solved(arms, torques)
    best = ca.SX.zeros(m)
    cost = ca.SX(ca.inf)
    sided = [i for i in range(m) if one_sided[i]]
    counts = range(m - n + 1) if prefer == "heat" else (m - n,)
    for held in (at for count in counts for at in combinations(sided, count)):
        free = [i for i in range(m) if i not in held]
        at = list(held)
        own = arms[:, free]
        if ca.sprank(own) < n:
            continue
        pulls = ca.SX(m, 1)
        pulls[at] = lowest[at]
        left = torques - ca.mtimes(arms[:, at], lowest[at])
        pulls[free] = (
            solved(own, left)
            if len(free) == n
            else ca.mtimes(own.T, solved(ca.mtimes(own, own.T), left))
        )
        total = ca.sumsqr(pulls) if prefer == "heat" else ca.sum1(ca.fabs(pulls))
        for i in free:
            if one_sided[i]:
                total += VIOLATED * ca.fmax(lowest[i] - pulls[i], 0)
        better = total < cost
        best = ca.if_else(better, pulls, best)
        cost = ca.if_else(better, total, cost)
    return ca.densify(best)


def solved(matrix: Matrix, right: Vector) -> Vector:
    """Return M⁻¹ b, by Cramer's rule up to three rows and by CasADi's `solve` beyond.

    Up to three rows a singular M gives zero. The `matrix` is M, (n, n), and `right` is b, (n,).
    """
    n = matrix.size1()
    if n <= 3:
        bound = ca.SX(1)
        for row in ca.vertsplit(matrix):
            bound *= ca.norm_2(row)
        determinant = _determinant(matrix)
        columns = []
        for k in range(n):
            replaced = ca.SX(matrix)
            replaced[:, k] = right
            columns.append(_over(_determinant(replaced), determinant, bound))
        return ca.vertcat(*columns)
    return ca.solve(ca.densify(matrix), right)


def _determinant(matrix: Matrix) -> Scalar:
    if matrix.size1() == 1:
        return matrix[0, 0]
    total = ca.SX(0)
    rows = list(range(1, matrix.size1()))
    for k in range(matrix.size2()):
        others = [j for j in range(matrix.size2()) if j != k]
        total += (-1) ** k * matrix[0, k] * _determinant(matrix[rows, others])
    return total


def _over(value: Scalar, divisor: Scalar, bound: Scalar) -> Scalar:
    """Return a quotient, zero where the divisor is zero but for rounding, beside its `bound`."""
    usable = ca.fabs(divisor) > SINGULAR * bound
    return ca.if_else(usable, value / ca.if_else(usable, divisor, 1), 0)
