"""What a kernel is fed in a run, and what it gives."""

from __future__ import annotations

from typing import NamedTuple

from distal.arrays import Floats


class Feed(NamedTuple):
    """What a kernel is fed in one run.

    Args:
        kernel_state: before the first row, (n_kernel_state,).
        rows: the samples, in order, (k, n_x).
        p: the parameters, (n_p,).
    """

    kernel_state: Floats
    rows: Floats
    p: Floats


class Advanced(NamedTuple):
    """What a run gave.

    Args:
        kernel_states: after each row, (k, n_kernel_state), or of each those numbers that were kept.
        ys: the outputs of each row, (k, n_y).
    """

    kernel_states: Floats
    ys: Floats
