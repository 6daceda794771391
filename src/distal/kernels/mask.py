"""The mask of a sample: what is done with each of its values. A row of a kernel is x = (dt, values,
mask).

A value of the mask is one of the constants here, or, of a displacement in a row without a sample of
its own, `bridge(k)`.
"""

from __future__ import annotations

import casadi as ca

from distal.expressions import Scalar

READ = 1.0
"""The value was read."""

MISSING = 0.0
"""There is no value: zero stands in its place, and nothing is done with it."""

COMPARED_ONLY = -1.0
"""Of what is compared, a force, a tension or an angle: its innovation is shown, but corrects
nothing.
"""


def bridge(rows: int) -> float:
    """Return the mask of a displacement that crosses a gap in a straight line to the reading that
    ends it: −k.

    Args:
        rows: k, how many rows that reading is away, this one's own step included; at least 2.
    """
    return -float(rows)


def is_read(mask: Scalar) -> Scalar:
    """Return 1 where a value was read."""
    return mask > MISSING


def is_there(mask: Scalar) -> Scalar:
    """Return 1 where there is a value, whatever is done with it."""
    return mask != MISSING


def is_bridge(mask: Scalar) -> Scalar:
    """Return 1 where a displacement crosses a gap."""
    return mask < MISSING


def rows_left(mask: Scalar) -> Scalar:
    """Return how many rows the reading is away that ends a gap: the k of `bridge`; 1 where it
    crosses none.
    """
    return ca.if_else(is_bridge(mask), -mask, 1)


def share_used(mask: Scalar) -> Scalar:
    """Return 1 where a value corrects the state, else 0."""
    return ca.fmax(mask, MISSING)
