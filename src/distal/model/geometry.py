"""Length functions of tendons, and their inverses; everything else about a tendon follows by virtual work."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from distal.expressions import Scalar
from distal.rig import Polynomial

NEWTON_STEPS = 12
"""Iterations of the inverse of a linkage's excursion: it is nearly a straight line."""


@dataclass(frozen=True)
class Insertion:
    """How a tendon meets its joint, with symbols or numbers for its sizes.

    Args:
        kind: ``"pinned"``, ``"pulley"`` or ``"linkage"``.
        side: +1 pulls the joint to +θ, −1 to −θ.
        radius: r [m].
        free_length: l [m], of a pinned tendon.
        shape: (centre θ_c [rad], slope s [1/rad], curvature c [1/rad²]) of a linkage.
    """

    kind: str
    side: int
    radius: Scalar
    free_length: Scalar = 0.0
    shape: tuple[Scalar, ...] = ()


def excursion(insertion: Insertion, angle: Scalar) -> Scalar:
    """Return how far a linkage draws its tendon from θ = 0 to θ: r [u + s u²/2 + c u³/3], u = θ − θ_c, less that at 0.

    Its moment arm is r (1 + s u + c u²): what a jaw driven by a linkage, or a pulley that is not round, has.

    Args:
        insertion: of kind linkage.
        angle: θ [rad].
    """
    centre, slope, curvature = insertion.shape

    def drawn(u: Scalar) -> Scalar:
        return u * (1 + u * (slope / 2 + u * curvature / 3))

    return insertion.radius * (drawn(angle - centre) - drawn(-centre))


def elongation(insertion: Insertion, angle: Scalar, displacement: Scalar) -> Scalar:
    """Return ℓ − l, what the joint's angle and the drive's displacement add to a tendon's free length.

    `pinned`: ℓ = sqrt(r²(1 − cos θ)² + (l + x − side · r sin θ)²), equations (4) and (5) of the 2008 paper.
    Mend: the paper prints "− r sin θ" for both tendons; the second insertion is opposite, so it moves the other way.
    `pulley`: ℓ = l + x − side · r θ, the tendon wraps round the joint.
    `linkage`: ℓ = l + x − side · e(θ), see `excursion`.

    Args:
        insertion: how the tendon meets the joint.
        angle: joint angle θ [rad].
        displacement: of the tendon's proximal end, away from the joint, x [m].
    """
    side, radius, free_length = insertion.side, insertion.radius, insertion.free_length
    if insertion.kind == "pulley":
        return displacement - side * radius * angle
    if insertion.kind == "linkage":
        return displacement - side * excursion(insertion, angle)
    # (4) and (5) multiplied out: ℓ² = A² − 2 side r A sin θ + 2 r² (1 − cos θ), A = l + x, has the shorter derivatives
    along = free_length + displacement
    square = along * (along - 2 * side * radius * ca.sin(angle)) + 2 * radius * radius * (1 - ca.cos(angle))
    return ca.sqrt(square) - free_length


def polynomial_excursion(polynomial: Polynomial, coefficients: Sequence[Scalar], angles: Sequence[Scalar]) -> Scalar:
    """Return e(θ) = Σ c Π θ_j^{n_j}; outside its range e(θ_c) + Σ a_j (θ_j − θ_c,j), with θ_c at the end of the range.

    a_j is the arm at the end of θ_j's own range with the other angles in the middle of theirs: no length jumps, and no arm
    grows beyond what it is somewhere in the range.

    Args:
        polynomial: its terms and its range.
        coefficients: c of each term [m].
        angles: of its joints, θ [rad].
    """
    kept = [ca.fmin(ca.fmax(angle, low), high) for angle, (low, high) in zip(angles, polynomial.range)]
    total = ca.SX(0)
    for term, coefficient in zip(polynomial.terms, coefficients):
        total += coefficient * _product(kept, term.powers)
    middle = [(low + high) / 2 for low, high in polynomial.range]
    for j, (low, high) in enumerate(polynomial.range):
        ends = [_slope(polynomial, coefficients, [*middle[:j], end, *middle[j + 1 :]], j) for end in (low, high)]
        total += ends[0] * ca.fmin(angles[j] - low, 0) + ends[1] * ca.fmax(angles[j] - high, 0)
    return total


def _slope(polynomial: Polynomial, coefficients: Sequence[Scalar], at: Sequence[Scalar], joint: int) -> Scalar:
    """Return ∂e/∂θ_j at given angles."""
    total = ca.SX(0)
    for term, coefficient in zip(polynomial.terms, coefficients):
        power = term.powers[joint]
        if power > 0:
            lower = tuple(p - (i == joint) for i, p in enumerate(term.powers))
            total += coefficient * power * _product(at, lower)
    return total


def _product(angles: Sequence[Scalar], powers: Sequence[int]) -> Scalar:
    result = ca.SX(1)
    for angle, power in zip(angles, powers):
        for _ in range(power):
            result *= angle
    return result


def angle_at(insertion: Insertion, elongated: Scalar, displacement: Scalar) -> Scalar:
    """Return the joint angle θ [rad] at which a tendon has the given ℓ − l: the inverse of `elongation`.

    For `pinned`, squaring (4) gives r cos θ + side · A sin θ = (2r² + A² − ℓ²)/(2r) with A = l + x, a shifted sine.
    Where no angle fits (the drive moved further than the insertion can follow), the nearest one is returned.

    Args:
        insertion: how the tendon meets the joint.
        elongated: ℓ − l [m].
        displacement: x [m].
    """
    side, radius, free_length = insertion.side, insertion.radius, insertion.free_length
    if insertion.kind == "pulley":
        return side * (displacement - elongated) / radius
    if insertion.kind == "linkage":
        wanted = side * (displacement - elongated)
        centre, slope, curvature = insertion.shape
        angle = centre + (wanted - excursion(insertion, centre)) / radius
        for _ in range(NEWTON_STEPS):
            u = angle - centre
            # the arm is kept away from zero, where no angle fits
            arm = radius * ca.fmax(1 + u * (slope + u * curvature), 0.2)
            angle = angle + (wanted - excursion(insertion, angle)) / arm
        return angle
    along = free_length + displacement
    length = free_length + elongated
    level = (2 * radius * radius + along * along - length * length) / (2 * radius)
    amplitude = ca.sqrt(radius * radius + along * along)
    ratio = ca.fmin(ca.fmax(level / amplitude, -1), 1)
    return side * (ca.asin(ratio) - ca.atan2(radius, along))
