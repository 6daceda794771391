"""The distribution of tensions: pulls of the tendons that make the torques of joints.

Where tendons are more than the joints and all stay taut, the pulls f solve A f = τ with f ≥ f_min
and the least Σ f, a linear programme: at its solution as many pulls are at their minimum as there
are more pulls than torques (a vertex). The few sets of pulls that may be at their minimum are tried
one by one, without iteration, in exported C too.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import inf

import casadi as ca

from distal.errors import CommandError
from distal.expressions import Matrix, Vector
from distal.rig import Rig, check_scales
from distal.units import rounded, to_si

VIOLATED = 1e6
"""Cost of a newton below the minimum beside that of a newton above it [1]: where no solution keeps
all tendons taut, the nearest to that is taken. Source: definition (a penalty: any number far above
ratios of moment arms).
"""

SINGULAR = 1e-12
"""Magnitude of a determinant per product of the rows' lengths, which bounds it (Hadamard), up to
which its matrix counts as singular [1]. Source: rounding (division by a determinant of zero).
"""

LEAST_TENSION = 1.0
"""Default of the tension that commands keep in the tendons [N]. Source: judgement."""

FARTHEST = 0.1
"""Largest distance along its tendon, from where a drive is, at which its next position is looked
for, and by which the least tension may stretch a tendon [m]. Source: judgement.
"""


def least_tension_of(value: float | str, rig: Rig) -> float:
    """Return a least tension [N], checked for a rig.

    Args:
        value: newtons, or a text with a unit.
        rig: whose tendons shall keep it.

    Raises:
        CommandError: the value is no tension of 0 N or more, stretches a tendon too far, or the
            rig's scale of force was taken.
    """
    check_scales(rig, "a command that keeps tendons taut", "tension")
    try:
        tension = to_si(value, "N")
    except ValueError as problem:
        raise CommandError(f"least_tension: {problem}") from None
    if not 0.0 <= tension < inf:
        raise CommandError(f"least_tension: at least 0 N, {value} came")
    for tendon in rig.tendons:
        most = FARTHEST * tendon.stiffness.value
        if tension > most:
            raise CommandError(
                f"least_tension: {value} would stretch tendon '{tendon.name}' by more than "
                f"{FARTHEST:g} m; up to {rounded(most, 3)} N can be"
            )
    return tension


def least_pulls(arms: Matrix, torques: Vector, lowest: Vector, one_sided: Sequence[bool]) -> Vector:
    """Return the pulls f, (m,) [N], that solve A f = τ with the least sum.

    Where n < m, one-sided pulls are at least `lowest`, if any solution allows that. Where n = m,
    the one solution is returned as it is.

    Args:
        arms: A, (n, m), n ≤ m: torque per pull [m].
        torques: τ, (n,) [N m].
        lowest: f_min, (m,) [N].
        one_sided: which pulls are of drives with a single tendon; a motor that winds two tendons
            pulls either way.
    """
    n, m = arms.shape
    if n == m:
        return solved(arms, torques)
    best = ca.SX.zeros(m)
    cost = ca.SX(ca.inf)
    sided = [i for i in range(m) if one_sided[i]]
    for at in map(list, combinations(sided, m - n)):
        free = [i for i in range(m) if i not in at]
        own = arms[:, free]
        if ca.sprank(own) < n:
            continue
        pulls = ca.SX(m, 1)
        pulls[at] = lowest[at]
        pulls[free] = solved(own, torques - ca.mtimes(arms[:, at], lowest[at]))
        total = ca.sum1(ca.fabs(pulls))
        for i in free:
            if one_sided[i]:
                total += VIOLATED * ca.fmax(lowest[i] - pulls[i], 0)
        better = total < cost
        best = ca.if_else(better, pulls, best)
        cost = ca.if_else(better, total, cost)
    return ca.densify(best)


def solved(matrix: Matrix, right: Vector) -> Vector:
    """Return M⁻¹ b, by its adjugate and determinant up to three rows and by CasADi's `solve`
    beyond.

    Up to three rows a singular M gives zero. The `matrix` is M, (n, n), and `right` is b, (n,).
    """
    if matrix.size1() > 3:
        return ca.solve(ca.densify(matrix), right)
    bound = ca.SX(1)
    for row in ca.vertsplit(matrix):
        bound *= ca.norm_2(row)
    determinant = ca.det(matrix)
    usable = ca.fabs(determinant) > SINGULAR * bound
    found = ca.mtimes(ca.adj(matrix), right) / ca.if_else(usable, determinant, 1)
    return ca.if_else(usable, found, 0)
