"""What the values of a column say: its noise, its steps, its rate, whether it is constant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distal.arrays import Floats

NORMAL_MAD = 1.4826
"""Standard deviation per median of absolute values of a normal error. Source: definition (its
75 % quantile).
"""

SECOND_DIFFERENCE = 6.0
"""Variance of x₋₁ − 2x₀ + x₁ per variance of white noise x. Source: definition (1 + 4 + 1)."""

SAME = 1e-9
"""Values whose range is below this share of their size are one value. Source: rounding.
"""

WRAP = 0.5
"""A step above this share of the range, between neighbours, is a wrap. Source: judgement."""

FEWEST_WRAPPED = 2
"""So many such steps make a counter that wraps. Source: judgement."""


NEAR_TURN = 0.1
"""A jump is a turn that differs from it by less than this share. Source: judgement."""


@dataclass(frozen=True)
class ValueEvidence:
    """What the values of one column say, over all logs.

    Args:
        low: smallest value.
        high: largest value.
        noise: standard deviation of white noise, from second differences.
        step: smallest difference between different values: the resolution, 0 if it has none.
        is_whole: whether all values are whole numbers.
        is_constant: whether it has one value only.
        missing: share of samples without a value.
        changes: share of samples at which it has a new value.
        stays: largest number of samples in a row with one value.
        turn: counts after which it wraps, None where it does not.
    """

    low: float
    high: float
    noise: float
    step: float
    is_whole: bool
    is_constant: bool
    missing: float
    changes: float
    stays: int
    turn: float | None

    @property
    def width(self) -> float:
        """Difference between the largest and the smallest value."""
        return self.high - self.low

    @property
    def roughness(self) -> float:
        """Noise per range."""
        return self.noise / self.width if self.width > 0.0 else 0.0


def value_evidence(columns: Sequence[Floats]) -> ValueEvidence:
    """Return what the values of a column in several logs say, (n_samples,) each."""
    present = [column[np.isfinite(column)] for column in columns]
    pooled = np.concatenate(present)
    low = float(pooled.min())
    high = float(pooled.max())
    second = np.concatenate([np.diff(values, 2) for values in present])
    first = np.concatenate([np.diff(values) for values in present])
    noise = NORMAL_MAD * float(np.median(np.abs(second))) / np.sqrt(SECOND_DIFFERENCE)
    return ValueEvidence(
        low=low,
        high=high,
        noise=noise,
        step=_step(pooled),
        is_whole=bool(np.all(pooled == np.round(pooled))),
        is_constant=high - low <= SAME * max(abs(low), abs(high), 1e-300),
        missing=1.0 - len(pooled) / sum(len(column) for column in columns),
        changes=float(np.mean(first != 0.0)) if len(first) else 0.0,
        stays=max(_longest_run(values) for values in present),
        turn=_turn(present, high - low),
    )


def _longest_run(values: Floats) -> int:
    """Return the largest number of values in a row that are equal."""
    ends = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0.0, [True]]))
    return int(np.max(np.diff(ends), initial=0))


def _step(values: Floats) -> float:
    """Return the resolution: the step of which all differences are multiples, 0 if there is
    none.
    """
    different = np.unique(values)
    if len(different) < 3 or len(different) > len(values) / 2:
        return 0.0
    gaps = np.diff(different)
    step = float(np.quantile(gaps, 0.05))
    if step <= 0.0:
        return 0.0
    multiples = gaps / step
    is_grid = np.mean(np.abs(multiples - np.round(multiples)) < 0.1) > 0.9
    return step if is_grid else 0.0


def _turn(columns: Sequence[Floats], width: float) -> float | None:
    """Return after how many counts a column wraps, None where it does not."""
    jumps = np.concatenate([np.abs(np.diff(values)) for values in columns])
    wrapped = jumps[jumps > WRAP * width]
    if width <= 0.0 or len(wrapped) < FEWEST_WRAPPED:
        return None
    usual = float(np.quantile(jumps, 0.95))
    if usual > 0.1 * width:  # it jumps all the time: no counter
        return None
    turn = float(np.median(wrapped)) + usual / 2.0
    powers = 2.0 ** np.arange(6, 33)
    nearest = float(powers[np.argmin(np.abs(powers - turn))])
    present = (360.0, 2.0 * np.pi, nearest)
    best = min(present, key=lambda candidate: abs(candidate / turn - 1.0))
    return best if abs(best / turn - 1.0) < NEAR_TURN else None


def unwrapped(values: Floats, turn: float) -> Floats:
    """Return a column without its wraps, by neighbours that differ by less than half a `turn`.

    The `values`, (n_samples,), and the turn are in the same unit.
    """
    present = np.isfinite(values)
    result = values.copy()
    result[present] = np.unwrap(values[present], period=turn)
    return result
