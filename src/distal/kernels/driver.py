"""Runs of kernels: their kernel states and outputs, for one run or for several side by side in
vector lanes.
"""

from __future__ import annotations

from collections.abc import Sequence

from distal.kernels.feed import Advanced, Feed
from distal.kernels.indices import Indices
from distal.kernels.kernel import Kernel


def advance(kernel: Kernel, feed: Feed, keep: Sequence[int] | None = None) -> Advanced:
    """Return the kernel states and outputs of a kernel in one run; see `advance_all` for `keep`."""
    return Advanced(*kernel.scan(*feed, keep))


def advance_all(
    kernel: Kernel, feeds: Sequence[Feed], keep: Sequence[int] | None = None
) -> list[Advanced]:
    """Return what a kernel gives in several runs, side by side where it has vector lanes. The
    results are those of `advance` for each run.

    Args:
        keep: indices of the numbers of the kernel state that are returned; default all.
    """
    lanes = kernel.lanes() if len(feeds) > 1 or kernel.backend == "interpreted" else None
    if lanes is None:
        return [advance(kernel, feed, keep) for feed in feeds]
    columns = range(kernel.n_kernel_state) if keep is None else keep
    groups = (feeds[k : k + lanes.lanes] for k in range(0, len(feeds), lanes.lanes))
    return [run for group in groups for run in lanes.scan(group, columns)]


def at_samples(run: Advanced, last: Indices) -> Advanced:
    """Return the rows of a run that belong to the samples of a log, whose indices are `last`; other
    rows are steps in between.
    """
    return run if len(last) == len(run.ys) else Advanced(run.kernel_states[last], run.ys[last])
