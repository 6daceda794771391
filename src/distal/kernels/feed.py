"""What a kernel is fed in a run, and what it gives."""

from __future__ import annotations

from typing import NamedTuple

from distal.arrays import Floats


class Feed(NamedTuple):
    """What a kernel is fed in one run.

    Args:
        carry: before the first row, (n_carry,).
        rows: the samples, in order, (k, n_x).
        p: the parameters, (n_p,).
    """

    kernel_state: Floats
    rows: Floats
    p: Floats


class Advanced(NamedTuple):
    """What a run gave.

    Args:
        carries: after each row, (k, n_carry), or of each those numbers that were kept.
        ys: the outputs of each row, (k, n_y).
    """

    kernel_states: Floats
    ys: Floats
