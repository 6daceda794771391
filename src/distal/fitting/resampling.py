"""Displacements between samples, offline: a fit knows what comes next, so they need not go in
straight lines.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats

FINEST = 4
"""At most so many steps per sample."""


def steps_per_sample(positions: Floats, noise: Floats) -> int:
    """Return how many steps per sample keep straight lines within the sensors' `noise`, (m,): 1, 2
    or `FINEST`.

    A chord leaves out ẍ dt²/8: where sliders swing, that much tension is missing at every crest,
    and stiffness would be fitted too large by (ω dt)²/12. With n steps it is n² times less.
    Displacements `positions` are (k, m), NaN where missing.
    """
    bends = np.abs(np.diff(positions, n=2, axis=0)) / 8.0
    missed = [float(np.sqrt(np.nanmean(b**2))) if np.isfinite(b).any() else 0.0 for b in bends.T]
    # noise bends too: its second difference has a variance of 6 σ²
    noise_bends = np.sqrt(6.0) / 8.0 * noise
    excess = max(
        (np.sqrt(max(m**2 - o**2, 0.0)) / n for m, o, n in zip(missed, noise_bends, noise)),
        default=0.0,
    )
    return next((steps for steps in (1, 2) if excess < 0.5 * steps**2), FINEST)


def refined(
    times: Floats, samples: Floats, positions: int, steps: int
) -> tuple[Floats, Floats, NDArray[np.intp]]:
    """Return stamps, samples and the original samples' rows, with displacements interpolated
    between them.

    Each interval of `times` [s], (k,), is cut in `steps`; displacements, the first `positions` of
    the `samples`, (k, n_channels), NaN where missing, follow the cubic through the four samples
    about it (Catmull and Rom, 1974), a straight line where one of them is missing or the stamps
    have a gap. All other channels are missing there.
    """
    k = len(times)
    if steps == 1 or k < 4:
        return times, samples, np.arange(k)
    parts = np.arange(1, steps) / steps
    interval = np.diff(times)
    even = interval < 1.5 * np.median(interval)
    rows = np.arange(k) * steps
    fine_times = np.empty((k - 1) * steps + 1)
    fine = np.full((len(fine_times), samples.shape[1]), np.nan)
    fine_times[rows] = times
    fine[rows] = samples
    x = samples[:, :positions]
    before = np.vstack([x[:1], x[:-2]])
    after = np.vstack([x[2:], x[-1:]])
    first = x[:-1]
    last = x[1:]
    smooth = np.isfinite(before + after) & even[:, None]
    smooth &= (np.r_[True, even[:-1]] & np.r_[even[1:], True])[:, None]
    left = np.where(smooth, (last - before) / 2, last - first)
    right = np.where(smooth, (after - first) / 2, last - first)
    for j, s in enumerate(parts, start=1):
        fine_times[j::steps] = times[:-1] + s * interval
        fine[j::steps, :positions] = (
            (2 * s**3 - 3 * s**2 + 1) * first
            + (s**3 - 2 * s**2 + s) * left
            + (3 * s**2 - 2 * s**3) * last
            + (s**3 - s**2) * right
        )
    # gaps are bridged by the filter itself
    keep = np.ones(len(fine_times), dtype=bool)
    for j in range(1, steps):
        keep[j::steps] = even & np.isfinite(fine[j::steps, :positions]).all(axis=1)
    new_rows = np.cumsum(keep) - 1
    return fine_times[keep], fine[keep], new_rows[rows]
