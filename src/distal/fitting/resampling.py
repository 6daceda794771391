"""Displacements between samples, interpolated by curves: a fit runs offline and knows the next
samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats

FINEST = 4
"""Largest number of steps per sample. Source: judgement."""


def steps_per_sample(positions: Floats, noise: Floats) -> int:
    """Return how many steps per sample keep the error of straight lines within the sensors'
    `noise`, (m,): 1, 2 or `FINEST`.

    A straight line between samples misses ẍ dt²/8. Where sliders swing with ω, that much tension is
    missing at every crest, and stiffness would be fitted too large by (ω dt)²/12. With n steps the
    error is n² times less. The displacements `positions` are (k, m), NaN where missing.
    """
    bends = np.abs(np.diff(positions, n=2, axis=0)) / 8.0
    missed = [float(np.sqrt(np.nanmean(b**2))) if np.isfinite(b).any() else 0.0 for b in bends.T]
    # the second difference of noise alone has the variance 6 σ²
    noise_bends = np.sqrt(6.0) / 8.0 * noise
    excess = max(
        (np.sqrt(max(m**2 - o**2, 0.0)) / n for m, o, n in zip(missed, noise_bends, noise)),
        default=0.0,
    )
    return next((steps for steps in (1, 2) if excess < 0.5 * steps**2), FINEST)


def refined(
    times: Floats, samples: Floats, positions: int, steps: int
) -> tuple[Floats, Floats, NDArray[np.intp]]:
    """Return stamps, samples and the rows of the original samples, with interpolated displacements
    between them.

    Each interval of `times` [s], (k,), is cut into `steps`. The displacements, the first
    `positions` columns of `samples`, (k, n_channels), follow the cubic through the four samples
    about the interval (Catmull and Rom, 1974), or a straight line where one of these is missing or
    the stamps have a gap. All other channels are NaN between the samples.
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
    # the filter itself bridges gaps
    keep = np.ones(len(fine_times), dtype=bool)
    for j in range(1, steps):
        keep[j::steps] = even & np.isfinite(fine[j::steps, :positions]).all(axis=1)
    new_rows = np.cumsum(keep) - 1
    return fine_times[keep], fine[keep], new_rows[rows]
