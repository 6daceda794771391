"""Torques of joints: those that feedback of a joint's angle asks for, by the one PID law that every
controller has, and the pulls of the tendons that make them.

Where tendons are more than the joints and all stay taut, the pulls f solve A f = τ with f ≥ f_min
and the least Σ f, a linear programme: at its solution as many pulls are at their minimum as there
are more pulls than torques (a vertex). The few sets of pulls that may be at their minimum are tried
one by one, without iteration, in exported C too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import combinations
from math import inf, isfinite, radians
from typing import NamedTuple

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.errors import CommandError
from distal.expressions import Matrix, Scalar, Vector
from distal.rig import Rig, check_scales
from distal.units import rounded, to_si

LEAVES = 2.0
"""Error at which a joint that rests within its dead band is corrected again, in dead bands [1].
Source: judgement.
"""


@dataclass(frozen=True)
class Feedback:
    """Feedback of a joint's estimated angle.

    Args:
        follow: rate at which the commanded angle corrects an error of the angle [1/s]; 0 for none.
        deadband: error that is not corrected [rad], so that a loop with friction and backlash does
            not hunt.
        proportional: gain for drives that follow forces [N m/rad].
        integral: gain for drives that follow forces [N m/(rad s)].
        derivative: gain for drives that follow forces [N m s/rad].
        torque_limit: of the sum of the three torques [N m].
        correction_limit: of the correction of the commanded angle [rad].

    Raises:
        CommandError: a gain is negative or not finite, or a limit is not above zero.
    """

    follow: float = 1.0
    deadband: float = radians(0.5)
    proportional: float = 0.0
    integral: float = 0.0
    derivative: float = 0.0
    torque_limit: float = 1e300
    correction_limit: float = radians(20.0)

    def __post_init__(self) -> None:
        for name, number in vars(self).items():
            if name.endswith("limit"):
                if not number > 0.0:
                    raise CommandError(f"feedback.{name}: a number above 0, {number} came")
            elif not (isfinite(number) and number >= 0.0):
                raise CommandError(f"feedback.{name}: 0 or a finite number above, {number} came")

    @staticmethod
    def gains(joints: Sequence[Feedback]) -> dict[str, Floats]:
        """Return name of a gain → its value for each of some joints, (n,)."""
        return {
            one.name: np.array([vars(joint)[one.name] for joint in joints])
            for one in fields(Feedback)
        }


class Corrected(NamedTuple):
    """What feedback does in a sample: whether joints rest, their errors beyond the dead band [rad],
    its torques [N m], and the integral of the errors afterwards [rad s], (n,) each.
    """

    rests: Vector
    errors: Vector
    torques: Vector
    effort: Vector


def feedback_torques(
    gains: Mapping[str, Vector],
    *,
    error: Vector,
    lag: Vector,
    rested: Vector,
    effort: Vector,
    dt: Scalar,
    trusted: Scalar = 1.0,
    free: Scalar = 1.0,
) -> Corrected:
    """Return what the PID law  τ = K_p e + K_i ∫ e dt + K_d de/dt  does in a sample, as an
    expression.

    In the dead band e = 0, which ends stick-slip (Armstrong-Hélouvry, Dupont and Canudas de Wit,
    Automatica 30, 1994). The torque is cut at its limit; while it is cut, the integral stands.

    Args:
        gains: by the names of `Feedback`.
        error: desired minus estimated angles [rad], (n,).
        lag: desired minus estimated speeds [rad/s], (n,).
        rested: whether joints rested in the sample before, (n,).
        effort: ∫ e dt before the sample [rad s], (n,).
        dt: length of the sample [s].
        trusted: whether the estimate is known; e and its derivative are zero where it is not.
        free: whether the integral may grow.
    """
    band = gains["deadband"]
    rests = ca.fabs(error) < band * ca.if_else(rested > 0, LEAVES, 1)
    errors = trusted * ca.if_else(rests, 0, error - limited(error, band))
    asked = gains["proportional"] * errors + gains["integral"] * effort
    asked += gains["derivative"] * trusted * lag
    torques = limited(asked, gains["torque_limit"])
    grown = effort + free * ca.if_else(torques == asked, errors * dt, 0)
    return Corrected(rests, errors, torques, grown)


def limited(value: Vector, most: Scalar) -> Vector:
    """Return a value within ± `most`."""
    return ca.fmin(ca.fmax(value, -most), most)


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
