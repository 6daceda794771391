"""What logs tell: marginal errors, and what shows only together."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from distal.fitting.free_parameters import Free
from distal.fitting.objective import Derivatives
from distal.fitting.parameter_estimates import _staying, covariance_at, errors_holding

Floats = NDArray[np.float64]


def problem(stds: list[float]) -> SimpleNamespace:
    """Numbers that start at 1 with these stds, their coordinates in units of the value."""
    parts = tuple(
        (Free(name, (name,), (1.0,), std, 1.0, 0.0, np.inf, coarse=0.0), None)
        for name, std in zip("abc", stds)
    )
    limits = np.where(np.isnan(stds), np.inf, stds)
    return SimpleNamespace(
        parts=parts,
        size=len(stds),
        prior_stds=limits,
        prior_information=np.diag(1.0 / limits**2),
    )


def covariance_of(stds: list[float], information: Floats, meat: Floats | None = None) -> Floats:
    n = len(stds)
    made = Derivatives(0.0, np.zeros(n), information, information if meat is None else meat, 10_000)
    return covariance_at(problem(stds), made, np.zeros(n))  # type: ignore[arg-type]


def test_errors_are_marginal_and_combine_logs_with_priors() -> None:
    stds = [0.1, 0.2]
    information = np.array([[900.0, 500.0], [500.0, 400.0]])
    found = covariance_of(stds, information)
    whole = np.linalg.inv(information + np.diag([100.0, 25.0]))
    np.testing.assert_allclose(found, whole, rtol=1e-3)


def test_scores_that_are_correlated_widen_it_and_never_narrow_it() -> None:
    information = np.diag([1e4, 1e4])
    plain = covariance_of([1.0, 1.0], information)
    wide, narrow = (
        covariance_of([1.0, 1.0], information, 9.0 * information),
        covariance_of([1.0, 1.0], information, 0.1 * information),
    )
    np.testing.assert_allclose(wide, 9.0 * plain, rtol=4e-3)
    np.testing.assert_allclose(narrow, plain, rtol=4e-3)


def test_what_shows_only_as_a_product_shares_it_out() -> None:
    """Each keeps 0.1/√2 of its prior, and the product is known."""
    covariance = covariance_of([0.1, 0.1], 1e6 * np.ones((2, 2)))
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), 0.1 / np.sqrt(2.0), rtol=1e-3)
    assert np.sqrt(covariance.sum()) == pytest.approx(1e-3, rel=0.01)


def test_what_nothing_shows_is_known_as_before() -> None:
    """By its prior; without one, by nothing."""
    covariance = covariance_of([0.1, 0.1, np.nan], np.diag([1e6, 1e-3, 1.0]))
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [1e-3, 0.1, 1.0], rtol=1e-3)


def test_what_stays_at_its_prior() -> None:
    """What is told to 0.95 of its prior's std, not to 0.7; of two that show only as a product one,
    and then the other is told.
    """
    stds = [0.1, 0.1, 0.1]
    told = np.diag(np.square(0.1 * np.array([0.95, 0.7, 0.01])))
    assert list(_staying(problem(stds), told)) == [True, False, False]  # type: ignore[arg-type]
    product = covariance_of([0.1, 0.1], 1e6 * np.ones((2, 2)))
    left = _staying(problem([0.1, 0.1]), product)  # type: ignore[arg-type]
    assert left.sum() == 1
    assert errors_holding(product, left).sum() == pytest.approx(1e-3, rel=0.05)
    # known better than half of their priors, both are free
    assert not _staying(problem([1.0, 1.0]), product).any()  # type: ignore[arg-type]


def test_errors_of_a_singular_covariance() -> None:
    """With one of two that go with each other exactly known, nothing is left of the other."""
    covariance = np.array([[4.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 9.0]])
    errors = errors_holding(covariance, np.array([True, False, False]))
    assert errors == pytest.approx([0.0, 0.0, 3.0])
