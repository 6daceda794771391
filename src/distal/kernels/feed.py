"""The inputs of a kernel in a run, and its results."""

from __future__ import annotations

from typing import NamedTuple

from distal.arrays import Floats


class Feed(NamedTuple):
    """The inputs of a kernel in one run.

    Args:
        kernel_state: before the first row, (n_kernel_state,).
        rows: the samples, in order, (k, n_x).
        p: the parameters, (n_p,).
    """

    kernel_state: Floats
    rows: Floats
    p: Floats


class Advanced(NamedTuple):
    """The results of a kernel in one run.

    Args:
        kernel_states: after each row, (k, n_kernel_state), or only those numbers of each that are
            kept.
        ys: the outputs of each row, (k, n_y).
    """

    kernel_states: Floats
    ys: Floats
