"""Which pulls make the torques that are needed, where there are more tendons than joints, all taut.

A f = τ with f ≥ f_min. Least Σ f is a linear programme: at its solution as many pulls are at their
minimum as there are more of them than torques (a vertex). Least Σ f², the heat of alike motors, is
a quadratic one: some pulls are at their minimum, the others are the shortest that make the rest.
The few sets are tried one by one: no iteration, in C too.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Literal

import casadi as ca

from distal.expressions import Matrix, Scalar, Vector

Prefer = Literal["tension", "heat"]
"""What is least: the sum of the pulls, or of their squares."""

VIOLATED = 1e6
"""A newton below the minimum weighs as much as so many above it: where no choice keeps all taut,
the nearest is taken.
"""

SINGULAR = 1e-12
"""Determinants below this, of arms in their largest, count as none."""


def least_pulls(
    arms: Matrix, torques: Vector, lowest: Vector, one_sided: Sequence[bool], prefer: Prefer
) -> Vector:
    """Return the pulls f, (m,), with A f = τ and the least sum, or of squares; those of one side
    are at least `lowest`.

    Args:
        arms: A, (n, m), n ≤ m: torque per pull [m].
        torques: τ, (n,) [N m].
        lowest: (m,) [N].
        one_sided: which pulls are of single tendons; a motor that winds two of them pulls either
            way.
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
    """Return M⁻¹ b by Cramer's rule to three rows, beyond by Gauss; a singular M gives zero, in
    double and in float.

    The `matrix` is M, (n, n), `right` is b, (n,).
    """
    n = matrix.size1()
    if n == 1:
        return _over(right[0], matrix[0, 0])
    if n <= 3:
        determinant = _determinant(matrix)
        columns = []
        for k in range(n):
            replaced = ca.SX(matrix)
            replaced[:, k] = right
            columns.append(_over(_determinant(replaced), determinant))
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


def _over(value: Scalar, divisor: Scalar) -> Scalar:
    usable = ca.fabs(divisor) > SINGULAR
    return ca.if_else(usable, value / ca.if_else(usable, divisor, 1), 0)
