"""What the values of columns say: noise, steps and wraps of each, and how much they move alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

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

HALF = 0.5
"""Share of a turn above which a step between neighbours is a wrap. Source: definition (Nyquist: the
shorter way round is taken).
"""

TURNS = np.array([2.0 * pi, 360.0, *2.0 ** np.arange(6, 33)])
"""Periods after which readings wrap: in rad, in deg, of counters. Source: definition (registers
have whole numbers of bits).
"""

LONGEST_LAG = 40
"""Samples by which one column may follow another. Source: judgement."""


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
        stays: largest number of samples in a row with one value.
        turn: counts after which it wraps, None where it does not.
    """

    low: float
    high: float
    noise: float
    step: float
    is_whole: bool
    is_constant: bool
    stays: int
    turn: float | None

    @property
    def width(self) -> float:
        """Difference between the largest and the smallest value."""
        return self.high - self.low


def value_evidence(columns: Sequence[Floats]) -> ValueEvidence:
    """Return what the values of a column in several logs say, (n_samples,) each."""
    present = [column[np.isfinite(column)] for column in columns]
    pooled = np.concatenate(present)
    low = float(pooled.min())
    high = float(pooled.max())
    second = np.concatenate([np.diff(values, 2) for values in present])
    return ValueEvidence(
        low=low,
        high=high,
        noise=NORMAL_MAD * float(np.median(np.abs(second))) / np.sqrt(SECOND_DIFFERENCE),
        step=_step(pooled),
        is_whole=bool(np.all(pooled == np.round(pooled))),
        is_constant=high - low <= SAME * max(abs(low), abs(high), 1e-300),
        stays=max(longest_run(values)[1] for values in present),
        turn=_turn(present, high - low),
    )


def longest_run(values: Floats) -> tuple[int, int]:
    """Return where the longest run of equal values begins, and its number of samples."""
    ends = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0.0, [True]]))
    longest = int(np.argmax(np.diff(ends)))
    return int(ends[longest]), int(np.diff(ends)[longest])


def _step(values: Floats) -> float:
    """Return the resolution: the step of which all differences are multiples, 0 if there is
    none.
    """
    different = np.unique(values)
    if len(different) < 3 or len(different) > len(values) / 2:
        return 0.0
    gaps = np.diff(different)
    step = float(np.quantile(gaps, 0.05))
    multiples = gaps / step
    is_grid = np.mean(np.abs(multiples - np.round(multiples)) < 0.1) > 0.9
    return step if is_grid else 0.0


def _turn(columns: Sequence[Floats], width: float) -> float | None:
    """Return after how many counts a column wraps, None where it does not: its
    usual steps are small, and beside them a wrap is a whole turn.
    """
    steps = np.concatenate([np.abs(np.diff(values)) for values in columns])
    wraps = steps[steps > HALF * width]
    if len(wraps) < 2:
        return None
    usual = float(np.quantile(steps, 0.95))
    # a step across the wrap is shorter than the turn by what it would be elsewhere
    seen = float(np.median(wraps)) + usual / 2.0
    turn = float(TURNS[np.argmin(np.abs(TURNS - seen))])
    return turn if abs(turn - seen) <= usual and usual < HALF * width else None


def unwrapped(values: Floats, turn: float) -> Floats:
    """Return a column without its wraps, by neighbours that differ by less than half a `turn`.

    The `values`, (n_samples,), and the turn are in the same unit.
    """
    present = np.isfinite(values)
    result = values.copy()
    result[present] = np.unwrap(values[present], period=turn)
    return result


def lagged_correlations(columns: Sequence[Floats]) -> Floats:
    """Return the correlations among columns so many samples before, and these as they are, from lag
    −`LONGEST_LAG` to `LONGEST_LAG`, (2 LONGEST_LAG + 1, 2 n, 2 n); 0 of columns that are constant.

    Args:
        columns: of one log, (n_samples,) each, more than 2 `LONGEST_LAG`.
    """
    matrix = np.column_stack([_filled(values) for values in columns])
    inner = slice(LONGEST_LAG, len(matrix) - LONGEST_LAG)
    lags = range(-LONGEST_LAG, LONGEST_LAG + 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        stacked = [np.hstack([np.roll(matrix, lag, axis=0), matrix])[inner] for lag in lags]
        return np.nan_to_num([np.corrcoef(each, rowvar=False) for each in stacked])


def _filled(values: Floats) -> Floats:
    """Return values, missing ones between their neighbours."""
    present = np.isfinite(values)
    rows = np.arange(len(values))
    if not present.any():
        return np.zeros(len(values))
    return np.asarray(np.interp(rows, rows[present], values[present]))


def explained(correlations: Floats, causes: Sequence[int], effects: Sequence[int]) -> Floats:
    """Return the least share of the variance of one of the `effects` that the `causes` explain at
    each lag, (2 LONGEST_LAG + 1,): r C⁻¹ rᵀ with correlations r of an effect, and C of the causes
    (Draper and Smith 1998).

    Args:
        correlations: by lag (`lagged_correlations`).
        causes: indices of columns.
        effects: the same.
    """
    now = np.array(effects) + correlations.shape[1] // 2
    inverse = np.linalg.pinv(correlations[:, causes][:, :, causes], hermitian=True)
    across = correlations[:, now][:, :, causes]
    shares: Floats = np.einsum("lec,lcd,led->le", across, inverse, across).min(axis=1)
    return shares
