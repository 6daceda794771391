"""Least squares of logs whose coefficients differ: correlated samples, Bayes' rule, what readings
tell nothing, plays.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from distal.regression.features import played
from distal.regression.random_effects import (
    _basis,
    correlated_samples,
    line,
    posterior_of,
    random_effects,
    surprise,
)
from distal.rig import JointMap


def direction(values: np.ndarray, band: float) -> np.ndarray:
    return (values - played(values, band)) / band


def test_covariance_of_least_squares_against_monte_carlo() -> None:
    """Coefficients of 400 fits with AR(1) errors scatter as their covariance says: the effective
    number of samples.
    """
    rng, k = np.random.default_rng(2), 2000
    x = np.column_stack([np.ones(k), rng.normal(size=(k, 2)), np.sin(np.arange(k) / 300.0)])
    rho, fits = 0.9, []
    for _ in range(400):
        errors = lfilter([1.0], [1.0, -rho], rng.normal(size=k + 200))[200:] * 0.1
        fits.append(line(x, errors))
    drawn = np.array([one.coefficients for one in fits])
    said = np.sqrt(np.mean([np.diag(one.covariance) for one in fits], axis=0))
    # the constant and the slow column feel the correlation whole; fast ones less, for which the
    # covariance is wide std of a std from 400 draws is 3.5 %; the integrated time is cut short at
    # its first zero, by some 10 %
    np.testing.assert_allclose(drawn.std(axis=0)[[0, 3]], said[[0, 3]], rtol=0.2)
    assert np.all(drawn.std(axis=0)[1:3] < said[1:3])
    assert np.mean([one.correlated for one in fits]) == pytest.approx(
        (1 + rho) / (1 - rho), rel=0.15
    )


def test_correlations_are_summed_up_to_the_first_that_is_not_positive() -> None:
    """1 + 2 Σ ρ_k term by term: of a slow wave, whose ρ_k becomes positive again after half a
    period, and of noise.
    """
    rng = np.random.default_rng(3)
    for values in (
        np.sin(np.arange(600) / 20.0) + 0.1 * rng.normal(size=600),
        rng.normal(size=300),
    ):
        centred, expected = values - values.mean(), 1.0
        for k in range(1, len(values)):
            rho = float(centred[k:] @ centred[:-k]) / float(centred @ centred)
            if rho <= 0.0:
                break
            expected += 2.0 * rho
        assert correlated_samples(values) == pytest.approx(expected, rel=1e-9)


def test_uncorrelated_samples_count_one_each() -> None:
    rng = np.random.default_rng(3)
    assert correlated_samples(rng.normal(size=20000)) == pytest.approx(1.0, abs=0.1)
    assert correlated_samples(np.zeros(10)) == 1.0


def test_an_update_is_bayes_rule() -> None:
    """Against the textbook form with inverses, and with a coefficient that is known for certain."""
    rng = np.random.default_rng(4)
    x, y, mean = rng.normal(size=(30, 3)), rng.normal(size=30), rng.normal(size=3)
    root = rng.normal(size=(3, 3))
    covariance, r = root @ root.T, 0.7
    after, left = posterior_of(mean, covariance, x.T @ x, x.T @ y, r)
    precision = np.linalg.inv(covariance) + x.T @ x / r
    np.testing.assert_allclose(left, np.linalg.inv(precision), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        after, np.linalg.solve(precision, np.linalg.solve(covariance, mean) + x.T @ y / r)
    )
    covariance[2, :] = covariance[:, 2] = 0.0
    after, left = posterior_of(mean, covariance, x.T @ x, x.T @ y, r)
    assert after[2] == pytest.approx(mean[2], abs=1e-12)
    np.testing.assert_allclose(left[2], 0.0, atol=1e-12)


def test_surprise_is_chi_squared() -> None:
    """Of logs that are as expected: mean n and variance 2 n, over 2000 draws."""
    rng, n, r = np.random.default_rng(5), 3, 0.5
    x, covariance = rng.normal(size=(40, n)), np.diag([1.0, 0.2, 3.0])
    found = []
    for _ in range(2000):
        b = rng.normal(size=n) * np.sqrt(np.diag(covariance))
        y = x @ b + np.sqrt(r) * rng.normal(size=40)
        found.append(surprise(np.zeros(n), covariance, x.T @ x, x.T @ y, r))
    assert np.mean(found) == pytest.approx(n, rel=0.08)  # 3 std errors
    assert np.var(found) == pytest.approx(2 * n, rel=0.25)


@pytest.mark.parametrize("logs", [3, 9])
def test_the_spread_between_logs_is_that_of_their_coefficients(logs: int) -> None:
    """Without noise: mean and sample covariance of the lines times 1 + 1/n; of few logs only its
    diagonal is whole.
    """
    rng = np.random.default_rng(11)
    own = np.array([0.5, -2.0]) + rng.normal(size=(logs, 2)) * [0.3, 0.1]
    one = np.column_stack(
        [np.ones(400), np.tile([1.0, -1.0], 200)]
    )  # uncorrelated columns of size one
    joint = JointMap(
        joint="j", coefficients=(0.0, 0.0), covariance=((0.0, 0.0), (0.0, 0.0)), std=1.0
    )
    found, _ = random_effects(joint, [0, 1], [(one, one @ b, 0.01) for b in own])
    np.testing.assert_allclose(found.coefficients, own.mean(axis=0), rtol=1e-6)
    expected = np.cov(own.T, ddof=1) * (1.0 + 1.0 / logs)
    share = 0.0 if logs > 4 else 2.0 / (2.0 + logs - 1.0)
    expected[[0, 1], [1, 0]] *= 1.0 - share
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-3)
    pooled, _ = random_effects(joint, [0, 1], [(one, one @ b, 0.01) for b in own], pooled=True)
    np.testing.assert_allclose(pooled.coefficients, own.mean(axis=0), rtol=1e-6)


def test_a_direction_is_the_last_motion_beyond_the_dead_band() -> None:
    up_down = np.concatenate([np.linspace(0, 1, 50), np.full(50, 1.0), np.linspace(1, 0.5, 50)])
    noise = 0.01 * np.sin(np.arange(150) * 2.3)  # smaller than the dead band: nothing turns over
    found = direction(up_down + noise, 0.05)
    assert found[0] == 0.0
    assert np.all(found[10:50] > 0.5)
    assert np.all(found[50:100] > 0.5)  # a rest keeps it
    assert np.all(found[115:] < -0.5)
    assert np.all(np.abs(found) <= 1.0 + 1e-12)
    # the same path at half the pace: no rate in it
    slow = np.interp(np.arange(299) / 2.0, np.arange(150), up_down)
    np.testing.assert_allclose(direction(slow, 0.05)[::2], direction(up_down, 0.05), atol=1e-12)


def test_columns_of_the_basis_are_uncorrelated_and_of_size_one() -> None:
    """Over all logs together, WᵀXᵀX W/k = 1; a combination that is always zero is left out."""
    rng = np.random.default_rng(8)
    x = rng.normal(size=(300, 3)) @ np.array([[2.0, 1.0, 0.0], [0.0, 1e-2, 0.0], [0.0, 0.0, 5.0]])
    designs = [np.column_stack([part, part[:, 0] + part[:, 2]]) for part in (x[:100], x[100:])]
    w = _basis(designs)
    whole = np.vstack(designs) @ w
    assert w.shape == (4, 3)
    np.testing.assert_allclose(whole.T @ whole / len(whole), np.eye(3), atol=1e-9)


def test_how_many_samples_count_as_one() -> None:
    """1 + 2 Σ ρ_k up to where the correlation first ends: (1 + ρ)/(1 − ρ) of an AR(1), and 1 of
    white noise.
    """
    rng = np.random.default_rng(3)
    white = rng.normal(size=40_000)
    assert correlated_samples(white) == pytest.approx(1.0, abs=0.05)
    for rho in (0.5, 0.9):
        errors = lfilter([1.0], [1.0, -rho], white)
        assert correlated_samples(errors) == pytest.approx((1 + rho) / (1 - rho), rel=0.1)


def test_columns_that_are_nearly_the_same_leave_a_covariance() -> None:
    """Two columns that differ by less than XᵀX is rounded: positive semidefinite, and the same
    fitted angles.
    """
    rng = np.random.default_rng(6)
    for _ in range(30):
        x = rng.normal(size=(200, 4))
        twins = x[:, :2] + 10.0 ** rng.uniform(-9, -5, 2) * rng.normal(size=(200, 2))
        y = x @ np.array([1.0, -0.5, 0.2, 0.0]) + 0.01 * rng.normal(size=200)
        found = line(np.column_stack([x, twins]), y)
        size = np.sqrt(np.diag(found.covariance))
        assert np.linalg.eigvalsh(found.covariance / np.outer(size, size)).min() > -1e-9
        np.testing.assert_array_equal(found.covariance, found.covariance.T)
        assert found.std < 0.012
