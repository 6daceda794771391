"""Length functions of tendons, and their inverses; everything else about a tendon follows by virtual work."""

from __future__ import annotations

from typing import Any

import casadi as ca


def elongation(kind: str, angle: Any, displacement: Any, side: int, radius: Any, free_length: Any = None) -> Any:
    """Return ℓ − l, what the joint's angle and the drive's displacement add to a tendon's free length.

    `pinned`: ℓ = sqrt(r²(1 − cos θ)² + (l + x − side · r sin θ)²), equations (4) and (5) of the 2008 paper.
    Mend: the paper prints "− r sin θ" for both tendons; the second insertion is opposite, so it moves the other way.
    `pulley`: ℓ = l + x − side · r θ, the tendon wraps round the joint.

    Args:
        kind: ``"pinned"`` or ``"pulley"``.
        angle: joint angle θ [rad].
        displacement: of the tendon's proximal end, away from the joint, x [m].
        side: +1 pulls the joint to +θ, −1 to −θ.
        radius: r [m].
        free_length: l [m], of a pinned tendon.
    """
    if kind == "pulley":
        return displacement - side * radius * angle
    along = free_length + displacement - side * radius * ca.sin(angle)
    across = radius * (1 - ca.cos(angle))
    return ca.sqrt(across * across + along * along) - free_length


def angle_at(kind: str, elongated: Any, displacement: Any, side: int, radius: Any, free_length: Any = None) -> Any:
    """Return the joint angle θ [rad] at which a tendon has the given ℓ − l: the inverse of `elongation`.

    For `pinned`, squaring (4) gives r cos θ + side · A sin θ = (2r² + A² − ℓ²)/(2r) with A = l + x, a shifted sine.
    Where no angle fits (the drive moved further than the insertion can follow), the nearest one is returned.

    Args:
        kind: ``"pinned"`` or ``"pulley"``.
        elongated: ℓ − l [m].
        displacement: x [m].
        side: +1 or −1.
        radius: r [m].
        free_length: l [m], of a pinned tendon.
    """
    if kind == "pulley":
        return side * (displacement - elongated) / radius
    along = free_length + displacement
    length = free_length + elongated
    level = (2 * radius * radius + along * along - length * length) / (2 * radius)
    amplitude = ca.sqrt(radius * radius + along * along)
    ratio = ca.fmin(ca.fmax(level / amplitude, -1), 1)
    return side * (ca.asin(ratio) - ca.atan2(radius, along))
