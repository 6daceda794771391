"""The zero of a position sensor that jumps: a tendon slips on its spool, an encoder loses counts. Equation (2b)."""

from __future__ import annotations

import casadi as ca

from distal.estimators.adaptive.tuning import Robustness
from distal.expressions import Scalar

CONTRADICTED = 2.3
"""Logarithm of the odds by which a force speaks against a jump of its drive: ten to one."""

SOONEST_STOP = 0.01
"""No drive starts, moves far and stops within so short an interval [s]."""

SETTLED_TIME = 1.2
"""Time constant with which it is settled that a zero jumped [s]: had the drive moved, its force would stay unexplained."""

GOES_ON = 0.25
"""A drive that goes on after a step does so by at least this share of it from one sample to the next [1]."""


def kept_shift(robustness: Robustness, shift: Scalar, raw: Scalar, doubted: Scalar, read: Scalar) -> Scalar:
    """Return by which a sensor's zero is still displaced at a reading that is `raw` from where its drive should be: (2b).

    It came back where the reading without the shift is nearer. It was a motion and no jump where a second reading, after
    one in doubt, goes on in the same direction.
    """
    if not robustness.zeros_jump:
        return shift
    shifted = raw - shift
    back = ca.fabs(raw) < ca.fabs(shifted) / 2
    moves_on = ca.logic_and(doubted, shifted * shift > GOES_ON * shift**2)
    return ca.if_else(ca.logic_and(read, ca.logic_or(back, moves_on)), 0, shift)
