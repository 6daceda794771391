"""The checks of a sample, the same for all that take one in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.arrays import Floats
from distal.logs import LARGEST_READING

WILD = f"beyond {LARGEST_READING:g} in SI; NaN stands for a missing value"
"""The words of a message on a wild value."""


def sample_problem(sample: object, channels: Sequence[str]) -> str | None:
    """Return why `sample` is no sample of `channels`, or None where it is an array with one number
    for each of them.
    """
    if not isinstance(sample, np.ndarray) or sample.dtype.kind not in "fiu":
        return (
            f"a sample is an array of {len(channels)} numbers for {tuple(channels)}, "
            f"{type(sample).__name__} came"
        )
    if sample.shape != (len(channels),):
        return (
            f"a sample must have shape ({len(channels)},) for {tuple(channels)}, "
            f"{sample.shape} came"
        )
    return None


def wild_problem(sample: Floats) -> str | None:
    """Return a message if a value of a sample, (n_channels,) [SI], is wild, None where none is."""
    for value in sample.tolist():  # of a few numbers this is faster than arrays
        if value > LARGEST_READING or value < -LARGEST_READING:
            return f"the sample {sample} is wild ({WILD})"
    return None
