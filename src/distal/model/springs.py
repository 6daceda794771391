"""Springs that are not linear: tendons that stiffen, and extension springs of joints."""

from __future__ import annotations

from math import exp

import casadi as ca

from distal.expressions import Scalar

STEEPEST = 2.0
"""Largest a δ [1] up to which `stretched` is exponential. Beyond it the curve goes on as a straight
line, whose slope is e² = 7.4 times the first one. Source: judgement.
"""


def stretched(elongation: Scalar, stiffening: Scalar) -> Scalar:
    """Return (e^{a δ} − 1)/a, the stretch of a linear tendon with the same tension: T = T_pre + k
    (e^{aδ} − 1)/a.

    Stiffness then grows in a straight line with tension, dT/dδ = k + a (T − T_pre): Fung's law of
    soft tissue (Am. J. Physiol. 213, 1967), which fibre ropes and wire ropes that bed in follow as
    well. For a → 0 it is Hooke's law. The `elongation` δ [m] is counted from the pre-tensioned
    length; the `stiffening` is a ≥ 0 [1/m].
    """
    x = stiffening * elongation
    small = ca.fabs(x) < 1e-5
    safe = ca.if_else(small, 1, stiffening)
    curve = ca.if_else(
        x < STEEPEST, ca.expm1(ca.fmin(x, STEEPEST)), exp(STEEPEST) * (x - STEEPEST + 1) - 1
    )
    return ca.if_else(small, elongation * (1 + x / 2), curve / safe)


SHORTEST_SPRING = 1e-6
"""Least length of an extension spring [m]; at length zero it has no direction. Source: rounding (a
division by zero).
"""


def extension_torque(
    away: Scalar,
    stiffness: Scalar,
    free_length: Scalar,
    radius: Scalar,
    distance: Scalar,
    preload: Scalar,
) -> Scalar:
    """Return the torque −F dL/dθ [N m] of a spring between two points, with the length L² = r² + R²
    − 2 r R cos x and dL/dθ = r R sin x/L.

    F = max(preload + k (L − free length), 0), the force of an extension spring with initial
    tension: its coils open at `free_length` [m] with the force `preload` [N], and k is its
    `stiffness` [N/m]. The angle x = θ − line angle [rad] is `away`. The distances from the axis to
    the points on the link and on the base are `radius` r and `distance` R [m].
    """
    length = ca.sqrt(
        ca.fmax(radius**2 + distance**2 - 2 * radius * distance * ca.cos(away), SHORTEST_SPRING**2)
    )
    force = ca.fmax(preload + stiffness * (length - free_length), 0)
    return -force * radius * distance * ca.sin(away) / length
