"""Tendons that stiffen as they are pulled."""

from __future__ import annotations

from math import exp
from typing import Any

import casadi as ca

STEEPEST = 2.0
"""Where a δ is larger, the curve goes on as a straight line: its slope there is e² = 7.4 times the first one."""


def stretched(elongation: Any, stiffening: Any) -> Any:
    """Return (e^{a δ} − 1)/a, the stretch of a linear tendon with the same tension: T = T_pre + k (e^{aδ} − 1)/a.

    Stiffness then grows in a straight line with tension, dT/dδ = k + a (T − T_pre): Fung's law of soft tissue (Am. J.
    Physiol. 213, 1967), which fibre ropes and wire ropes that bed in follow as well. a → 0 is Hooke's law.

    Args:
        elongation: beyond the pre-tensioned length, δ [m].
        stiffening: a [1/m] ≥ 0.
    """
    x = stiffening * elongation
    small = ca.fabs(x) < 1e-5
    safe = ca.if_else(small, 1, stiffening)
    curve = ca.if_else(x < STEEPEST, ca.expm1(ca.fmin(x, STEEPEST)), exp(STEEPEST) * (x - STEEPEST + 1) - 1)
    return ca.if_else(small, elongation * (1 + x / 2), curve / safe)
