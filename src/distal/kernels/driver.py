"""The one driver of kernels: the kernel states and outputs of a run in order, alone or side by side
with others in lanes.
"""

from __future__ import annotations

from collections.abc import Sequence

from distal.kernels.feed import Advanced, Feed
from distal.kernels.indices import Indices
from distal.kernels.kernel import Kernel


def advance(kernel: Kernel, feed: Feed) -> Advanced:
    """Return what a run gives."""
    return Advanced(*kernel.scan(*feed))


def advance_all(
    kernel: Kernel, feeds: Sequence[Feed], keep: Sequence[int] | None = None
) -> list[Advanced]:
    """Return what several runs give, side by side where there are lanes for that: the same numbers
    as one by one.

    Args:
        keep: indices of the numbers of the kernel state that are kept; default all.
    """
    lanes = kernel.lanes() if len(feeds) > 1 or kernel.backend == "interpreted" else None
    if lanes is None:
        runs = (advance(kernel, feed) for feed in feeds)
        return [
            run if keep is None else Advanced(run.kernel_states[:, list(keep)], run.ys)
            for run in runs
        ]
    columns = range(kernel.n_kernel_state) if keep is None else keep
    groups = (feeds[k : k + lanes.lanes] for k in range(0, len(feeds), lanes.lanes))
    return [run for group in groups for run in lanes.scan(group, columns)]


def at_samples(run: Advanced, last: Indices) -> Advanced:
    """Return a run at the samples' own rows."""
    return run if len(last) == len(run.ys) else Advanced(run.kernel_states[last], run.ys[last])
