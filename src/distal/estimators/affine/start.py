"""Where a joint begins, as far as the map that logs taught says it of the first readings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from distal.rig import Affine

NOWHERE = 1e6
"""Variance of an angle of which the map says nothing [rad²]."""

OUTSIDE, FARTHEST = 10.0, 1.0
"""Growth of the std, and the end of the map, in half ranges outside of what it was learned from."""


def start_of(affine: Affine, joint: int, readings: Mapping[str, tuple[Any, Any]]) -> tuple[Any, Any]:
    """Return angle and variance of a joint by an affine map: b0 + Σ b z, and φᵀ C φ + s² + Σ c² for unknown directions.

    Outside what the map was learned from its std grows, and far outside, or where a reading is missing, it says nothing.

    Args:
        affine: as learned.
        joint: its index.
        readings: channel → (first reading, 1 where there is one), symbolic.
    """
    own, m = affine.joints[joint], len(affine.channels)
    phi, known, far = [ca.SX(1)], ca.SX(1), ca.SX(0)
    for i, name in enumerate(affine.channels):
        value, there = readings[name]
        phi.append((value - affine.centre[i]) / affine.scale[i])
        half = max((affine.high[i] - affine.low[i]) / 2, 1e-12)
        far = ca.fmax(far, ca.fmax(affine.low[i] - value, value - affine.high[i]) / half)
        known = ca.logic_and(known, there > 0)
    column, covariance = ca.vertcat(*phi), np.asarray(own.covariance)[: m + 1, : m + 1]
    directions = float(np.sum(np.square(own.coefficients[m + 1 :])))
    angle = ca.dot(ca.DM(own.coefficients[: m + 1]), column)
    variance = ca.bilin(ca.DM(covariance), column, column) + own.std**2 + directions
    return angle, ca.if_else(ca.logic_and(known, far < FARTHEST), variance * (1 + OUTSIDE * far) ** 2, NOWHERE)
