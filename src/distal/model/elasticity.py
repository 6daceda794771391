"""Tendons that stiffen as they are pulled, and springs whose torque is no straight line."""

from __future__ import annotations

from math import exp

import casadi as ca

from distal.expressions import Scalar

STEEPEST = 2.0
"""Where a δ is larger, the curve goes on as a straight line: its slope there is e² = 7.4 times the
first one.
"""


def stretched(elongation: Scalar, stiffening: Scalar) -> Scalar:
    """Return (e^{a δ} − 1)/a, the stretch of a linear tendon with the same tension: T = T_pre + k
    (e^{aδ} − 1)/a.

    Stiffness then grows in a straight line with tension, dT/dδ = k + a (T − T_pre): Fung's law of
    soft tissue (Am. J. Physiol. 213, 1967), which fibre ropes and wire ropes that bed in follow as
    well. a → 0 is Hooke's law. The elongation δ [m] is counted from the pre-tensioned length, the
    stiffening a ≥ 0 is in 1/m.
    """
    x = stiffening * elongation
    small = ca.fabs(x) < 1e-5
    safe = ca.if_else(small, 1, stiffening)
    curve = ca.if_else(
        x < STEEPEST, ca.expm1(ca.fmin(x, STEEPEST)), exp(STEEPEST) * (x - STEEPEST + 1) - 1
    )
    return ca.if_else(small, elongation * (1 + x / 2), curve / safe)


def slope_of(stretch: Scalar, stiffening: Scalar) -> Scalar:
    """Return the slope of `stretched` by its elongation, e^{a δ} for a stiffening a, at most e² of
    the first one, where it is `stretch` [m].
    """
    return ca.fmin(1 + stiffening * stretch, exp(STEEPEST))


def polynomial_torque(away: Scalar, stiffness: Scalar, quadratic: Scalar, cubic: Scalar) -> Scalar:
    """Return −(k x + k₂ x² + k₃ x³), the torque of a spring that is x = θ − rest angle [rad] `away`
    [N m].

    Its `stiffness` k, `quadratic` k₂ and `cubic` k₃ are in N m/rad, N m/rad² and N m/rad³.
    """
    return -away * (stiffness + away * (quadratic + away * cubic))


SHORTEST = 1e-6
"""An extension spring is never shorter than this [m]: its direction is then still defined."""


def extension_torque(
    away: Scalar,
    stiffness: Scalar,
    free_length: Scalar,
    radius: Scalar,
    distance: Scalar,
    preload: Scalar,
) -> Scalar:
    """Return −F dL/dθ of a spring between two points [N m]: L² = r² + R² − 2 r R cos x, dL/dθ = r R
    sin x/L.

    F = max(preload + k (L − free length), 0), as an extension spring with initial tension pulls:
    its coils open at `free_length` [m] with `preload` [N], `stiffness` is k [N/m]. The angle x = θ
    − line angle [rad] is `away`; `radius` r and `distance` R are from the axis to the link's and to
    the base's point [m].
    """
    length = ca.sqrt(
        ca.fmax(radius**2 + distance**2 - 2 * radius * distance * ca.cos(away), SHORTEST**2)
    )
    force = ca.fmax(preload + stiffness * (length - free_length), 0)
    return -force * radius * distance * ca.sin(away) / length
