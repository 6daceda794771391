"""The mask of a sample: what is done with each of its values. A row of a kernel is x = (dt, values,
mask).

Each number of the mask is one of the constants here. In rows between samples, that of a
displacement may be `bridge(k)` instead.
"""

from __future__ import annotations

import casadi as ca

from distal.expressions import Scalar

READ = 1.0
"""Mask of a value that was read. Source: definition (of the mask)."""

MISSING = 0.0
"""Mask of a value that is missing: zero stands in its place, and nothing is done with it. Source:
definition (of the mask).
"""

COMPARED_ONLY = -1.0
"""Mask of a force, a tension or an angle that is only compared: its innovation is shown, but
corrects nothing. Source: definition (of the mask).
"""


def bridge(rows: int) -> float:
    """Return the mask −k of a displacement in a gap, which goes in a straight line to the reading
    that ends the gap.

    Args:
        rows: k, the number of rows to that reading, this row's own step included; at least 2.
    """
    return -float(rows)


def is_read(mask: Scalar) -> Scalar:
    """Return 1 where a value was read, else 0."""
    return mask > MISSING


def is_there(mask: Scalar) -> Scalar:
    """Return 1 where there is a value, whatever is done with it, else 0."""
    return mask != MISSING


def is_bridge(mask: Scalar) -> Scalar:
    """Return 1 where a displacement crosses a gap, else 0."""
    return mask < MISSING


def rows_left(mask: Scalar) -> Scalar:
    """Return the number of rows to the reading that ends a gap, the k of `bridge`; 1 where there is
    no gap.
    """
    return ca.if_else(is_bridge(mask), -mask, 1)


def share_used(mask: Scalar) -> Scalar:
    """Return 1 where a value corrects the state, else 0."""
    return ca.fmax(mask, MISSING)
