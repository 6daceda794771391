"""Gaps between samples: a long interval is bridged by several predictions, so that sub-steps stay
short.

A row of a kernel is x = (dt, values, mask), see `distal.kernels.mask`. In a row without a sample of
its own nothing is read, and displacements cross the gap in a straight line to the reading that ends
it.
"""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.errors import EstimationError
from distal.kernels.mask import MISSING, bridge

MOST_BRIDGES = 100_000
"""So many predictions may bridge one gap."""

SPLIT = 1.25
"""An interval longer than this times the nominal one is bridged by several predictions."""

ROUNDING = 1e-9
"""Share of an interval by which a stamp may be off without another prediction."""


def first_values(samples: Floats) -> Floats:
    """Return the first value of each channel that is not missing, (n_channels,)."""
    firsts: Floats = samples[np.isfinite(samples).argmax(axis=0), np.arange(samples.shape[1])]
    return firsts


def predictions(dt: float, interval: float) -> int:
    """Return how many predictions a time `dt` [s] needs, with samples an `interval` [s] apart.

    Twice `MOST_BRIDGES` stands for any number that is as large.
    """
    parts = dt / (SPLIT * interval) - ROUNDING
    return (
        max(1, ceil(parts)) if parts < 2 * MOST_BRIDGES else 2 * MOST_BRIDGES
    )  # dt may be infinite


def fill(
    values: Floats,
    mask: Floats,
    sample: Floats,
    is_finite: Bools,
    rows_after: int = 0,
    bridged: int = 0,
) -> None:
    """Write `values` and `mask` of one row, (n_channels,) each, from the `sample` that ends the
    interval.

    The sample has a value where `is_finite`, else 0. So many rows follow in the same interval, 0
    after the sample's own; so many of the first channels, `bridged`, cross a gap in a straight
    line.
    """
    if rows_after == 0:
        values[:] = sample
        mask[:] = is_finite
        return
    values[:] = 0.0
    mask[:] = MISSING
    values[:bridged] = sample[:bridged]
    np.multiply(is_finite[:bridged], bridge(rows_after + 1), out=mask[:bridged])


def rows_with_gaps(
    name: str, steps: Floats, samples: Floats, interval: float, bridged: int
) -> tuple[Floats, NDArray[np.intp]]:
    """Return a kernel's rows (dt, values, mask) for a log, and the index of each sample's own row.

    Between the `samples` are `steps` [s], (k,), nominally an `interval` [s]. So many of the first
    channels, `bridged`, cross a gap in a straight line; the name is the estimator's, for messages.

    Raises:
        EstimationError: too many predictions would be needed.
    """
    width = samples.shape[1]
    is_finite = np.isfinite(samples)
    filled = np.where(is_finite, samples, 0.0)
    if (
        len(steps) and predictions(float(steps.max()), interval) == 1
    ):  # no gaps, as most logs: a row for each sample
        return np.column_stack([steps, filled, is_finite]), np.arange(len(steps))
    parts = np.maximum(1.0, np.ceil(steps / (SPLIT * interval) - ROUNDING))
    if parts.max(initial=1.0) > MOST_BRIDGES:
        raise EstimationError(
            f"{name}: a gap of {steps.max():g} s is too long to bridge "
            f"(at most {MOST_BRIDGES * SPLIT * interval:g} s); split the log there"
        )
    if parts.sum() > 4 * MOST_BRIDGES + 4 * len(steps):
        raise EstimationError(
            f"{name}: the stamps are {np.median(steps):g} s apart, the rig's sensors give a value "
            "every "
            f"{interval:g} s: {parts.sum():.3g} predictions would be needed; set the sensors' "
            "rate to the log's"
        )
    counts = parts.astype(np.int64)
    last = np.cumsum(counts) - 1
    rows = np.zeros((int(counts.sum()), 1 + 2 * width))
    rows[:, 0] = np.repeat(steps / parts, counts)
    values = rows[:, 1 : 1 + width]
    masks = rows[:, 1 + width :]
    values[last] = filled
    masks[last] = is_finite
    for i in np.flatnonzero(counts > 1):
        for after in range(1, int(counts[i])):
            row = last[i] - after
            fill(values[row], masks[row], filled[i], is_finite[i], after, bridged)
    return rows, last
