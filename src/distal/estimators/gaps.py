"""Gaps between samples: several predictions bridge a long interval, so that sub-steps stay short.

A row of a kernel's input is x = (dt, values, mask), see `distal.kernels.layout`. A row that bridges
a gap has no sample of its own: nothing is read in it, and displacements are interpolated along a
straight line to the reading that ends the gap.
"""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.errors import EstimationError
from distal.kernels.layout import MISSING, bridge

MOST_BRIDGES = 100_000
"""Largest number of predictions that bridge one gap [1]. Source: judgement."""

SPLIT = 1.25
"""An interval longer than this times the nominal one is bridged by several predictions [1]. Source:
judgement.
"""

ROUNDING = 1e-9
"""Share of an interval by which a stamp may be off without another prediction [1]. Source: rounding
(of stamps).
"""


def first_values(samples: Floats) -> Floats:
    """Return the first finite value of each channel, (n_channels,), NaN for a channel that has
    none.
    """
    firsts: Floats = samples[np.isfinite(samples).argmax(axis=0), np.arange(samples.shape[1])]
    return firsts


def predictions(dt: float, interval: float) -> int:
    """Return the number of predictions for an interval `dt` [s] where samples are nominally an
    `interval` [s] apart.

    It is at most twice `MOST_BRIDGES`, also for an infinite `dt`.
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
    """Write `values` and `mask` of one input row, (n_channels,) each, from the `sample` that ends
    the interval.

    Args:
        values: of the row, changed in place.
        mask: of the row, changed in place.
        sample: value where `is_finite`, else 0.
        is_finite: where the sample has a value.
        rows_after: number of rows that follow in the same interval; 0 for the sample's own row.
        bridged: number of leading channels that are interpolated along a straight line.
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
    """Return a kernel's input rows (dt, values, mask) for a log, and the index of each sample's own
    row among them.

    Args:
        name: of the estimator, for messages.
        steps: intervals before the samples [s], (k,).
        samples: values of the channels, NaN where missing, (k, n_channels).
        interval: nominal interval [s].
        bridged: number of leading channels that are interpolated along a straight line over a gap.

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
