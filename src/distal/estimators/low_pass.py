"""The low-pass on measured forces of the kinematic estimators."""

from __future__ import annotations

import casadi as ca

CUT_OFF = 5.0
"""Cut-off of the low-pass on measured forces in `elastic` [Hz]."""


def low_passed(before: ca.SX, read: ca.SX, dt: ca.SX) -> ca.SX:
    """Return F⁺ = U + e^{−2π f dt} (F − U), f = `CUT_OFF`.

    Args:
        before: F.
        read: U.
        dt: length of the interval [s].
    """
    return read + ca.exp(-2 * ca.pi * CUT_OFF * dt) * (before - read)
