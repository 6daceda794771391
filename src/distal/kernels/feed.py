"""The inputs of a kernel in a run, and its results."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from distal.arrays import Floats


class Sizes(NamedTuple):
    """The lengths of a kernel's arguments and of its output."""

    kernel_state: int
    x: int
    p: int
    y: int


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

    def dense(self, sizes: Sizes) -> Feed:
        """Return the same arrays as C reads them, in their shapes."""
        shapes = (sizes.kernel_state,), (-1, sizes.x), (sizes.p,)
        return Feed(
            *(
                np.ascontiguousarray(part, dtype=np.float64).reshape(shape)
                for part, shape in zip(self, shapes)
            )
        )


class Advanced(NamedTuple):
    """The results of a kernel in one run.

    Args:
        kernel_states: after each row, (k, n_kernel_state), or only those numbers of each that are
            kept.
        ys: the outputs of each row, (k, n_y).
    """

    kernel_states: Floats
    ys: Floats
