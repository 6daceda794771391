"""Rao's score test on linear systems, where all it says is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

from distal.arrays import Floats
from distal.diagnosis.innovation_tests import (
    LEVEL,
    SPAN,
    ScoreTest,
    independent,
    quantile,
    span_sums,
)

TIME = np.arange(2000) / 100.0
SEEDS = 600


def noise(seed: int, rho: float) -> Floats:
    """Return e of unit variance with e⁺ = ρ e + noise, (k,)."""
    white = np.random.default_rng(seed).normal(size=len(TIME) + 400)
    coloured: Floats = lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], white)[400:]
    return coloured


def made(residual: Floats, slopes: Floats, stds: tuple[float, ...] = (0.0,)) -> ScoreTest:
    """Return the test of one channel, with a slope of each cause, (n, k)."""
    return ScoreTest(residual[:, None], slopes[:, :, None], TIME, np.array(stds))


def test_estimates_are_those_of_least_squares() -> None:
    """Residuals r = D x + e: the estimate of a lone cause is −Dᵀr/DᵀD, its statistic w
    (Dᵀ r)²/DᵀD with the weight w, at most one, of what it leaves.
    """
    slopes = np.random.default_rng(0).normal(size=(2, len(TIME)))
    residual = noise(1, 0.0) - 0.3 * slopes[0]
    found = made(residual, slopes, (0.0, 0.0))
    own = np.sum(slopes**2, axis=1)
    estimates = -slopes @ residual / own
    np.testing.assert_allclose(found.estimates, estimates)
    for k in range(2):
        left = (residual + slopes[k] * estimates[k])[:, None]
        weight = independent(left, TIME)[0] / len(TIME) / max(np.mean(left**2), 1.0)
        assert weight <= 1.0
        assert found.statistics[k] == pytest.approx(weight * (slopes[k] @ residual) ** 2 / own[k])
        assert found.standard_errors[k] == pytest.approx(1.0 / np.sqrt(weight * own[k]))


def test_the_rigs_own_std_is_part_of_the_variance() -> None:
    """Var s = I + (I σ)²: with a wide prior the statistic is (x̂/σ)²."""
    slopes = np.sin(TIME)[None]
    residual = -5.0 * slopes[0] + noise(2, 0.0)
    wide = made(residual, slopes, (100.0,))
    assert wide.statistics[0] == pytest.approx((wide.estimates[0] / 100.0) ** 2, rel=1e-3)
    assert wide.estimates[0] == pytest.approx(5.0, abs=4.0 * wide.standard_errors[0])


@pytest.mark.parametrize(("rho", "std"), [(0.99, 0.0), (0.9, 2.0)])
def test_its_size_is_the_level_whatever_the_correlation(rho: float, std: float) -> None:
    """Causes drawn from the rig's stds are significant in LEVEL of all logs. The limit is exceeded
    with a chance of 1e-6 if that is so; a test that takes samples as independent has 20 % at ρ =
    0.99.
    """
    slopes = 0.3 * np.sin(0.7 * TIME)[None]
    draws = std * np.random.default_rng(3).normal(size=SEEDS)
    hits = sum(
        bool(made(noise(seed, rho) - slopes[0] * x, slopes, (std,)).significant[0])
        for seed, x in enumerate(draws)
    )
    assert hits <= binom.isf(1e-6, SEEDS, LEVEL)


def test_it_has_power() -> None:
    """A cause of twice the limit's standard errors is found in nearly all logs: where the weight of
    a value is estimated as a half, the statistic's root is √½ · 9.6 ± 1, and the limit 4.8.
    """
    slopes = 0.3 * np.sin(0.7 * TIME)[None]
    limit = made(noise(0, 0.0), slopes).limit
    size = 2.0 * limit / np.sqrt(np.sum(slopes**2))
    hits = [
        bool(made(noise(seed, 0.0) - slopes[0] * size, slopes).significant[0])
        for seed in range(100)
    ]
    assert np.mean(hits) > 0.95


def test_what_nothing_depends_on_has_no_estimate() -> None:
    found = made(noise(4, 0.0), np.zeros((1, len(TIME))))
    assert found.estimates[0] == 0.0
    assert np.isinf(found.standard_errors[0])
    assert found.statistics[0] == 0.0
    assert not found.significant[0]


def test_missing_values_and_lost_runs_count_for_nothing() -> None:
    residual, slope = noise(5, 0.0), np.cos(TIME)
    residual[1000:] = np.nan
    found = made(residual, np.array([slope, np.where(TIME < 5.0, slope, 1e200)]), (0.0, 0.0))
    for x, end in zip(found.estimates, (10.0, 5.0)):
        known = end > TIME
        least_squares = -slope[known] @ residual[known] / np.sum(slope[known] ** 2)
        assert x == pytest.approx(least_squares)


def test_span_sums_are_those_typed_out() -> None:
    values = np.column_stack([TIME, np.where(TIME < 3.0, np.nan, 1.0)])
    spans = np.floor(TIME / SPAN + 1e-9).astype(int)
    for column, sums in zip(np.nan_to_num(values).T, span_sums(values, TIME).T):
        np.testing.assert_allclose(sums, np.bincount(spans, column))


@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_how_many_values_are_independent(rho: float) -> None:
    """Of n values with correlation ρ it is n (1 − ρ)/(1 + ρ) (Bartlett); at least as many as spans.

    Mean over logs: its standard error over 200 logs of 10 spans is √(2/10/200) = 3 %, and the mean
    of 1/x is above 1/mean by the 2/10 of the spans' variance.
    """
    found = np.mean([independent(noise(s, rho)[:, None], TIME)[0] for s in range(200)])
    expected = len(TIME) * (1.0 - rho) / (1.0 + rho)
    assert 0.8 * expected < found < 1.4 * expected
    constant = independent(np.ones((len(TIME), 1)), TIME)[0]
    assert constant == pytest.approx(len(TIME) / (SPAN * 100.0))


def test_the_level_is_shared_by_all_tests() -> None:
    """3.29 standard deviations leave 0.1 % on both sides; ten tests share it (Bonferroni)."""
    assert quantile(1) == pytest.approx(3.2905, abs=1e-4)
    assert quantile(10) == pytest.approx(3.8906, abs=1e-4)
