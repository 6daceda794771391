"""Marginal standard errors, also of what shows only together."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from distal.fitting.likelihood import Derivatives
from distal.fitting.parameter_search import covariance_at
from distal.fitting.parameters_and_priors import Free

Floats = NDArray[np.float64]


def problem(stds: list[float]) -> SimpleNamespace:
    """Numbers that start at 1 with these stds, their coordinates in units of the value."""
    parts = tuple(
        (Free(name, (name,), (1.0,), std, 1.0, 0.0, np.inf), None) for name, std in zip("abc", stds)
    )
    limits = np.where(np.isnan(stds), np.inf, stds)
    return SimpleNamespace(
        parts=parts,
        size=len(stds),
        prior_stds=limits,
        prior_information=np.diag(1.0 / limits**2),
    )


def covariance_of(stds: list[float], information: Floats) -> Floats:
    made = Derivatives(0.0, np.zeros(len(stds)), information)
    return covariance_at(problem(stds), made)  # type: ignore[arg-type]


def test_errors_are_marginal_and_combine_logs_with_priors() -> None:
    stds = [0.1, 0.2]
    information = np.array([[900.0, 500.0], [500.0, 400.0]])
    found = covariance_of(stds, information)
    whole = np.linalg.inv(information + np.diag([100.0, 25.0]))
    np.testing.assert_allclose(found, whole, rtol=1e-3)


def test_what_shows_only_as_a_product_shares_it_out() -> None:
    """Each keeps 0.1/√2 of its prior, and the product is known."""
    covariance = covariance_of([0.1, 0.1], 1e6 * np.ones((2, 2)))
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), 0.1 / np.sqrt(2.0), rtol=1e-3)
    assert np.sqrt(covariance.sum()) == pytest.approx(1e-3, rel=0.01)


def test_what_nothing_shows_is_known_as_before() -> None:
    """By its prior; without one, by nothing."""
    covariance = covariance_of([0.1, 0.1, np.nan], np.diag([1e6, 1e-3, 1.0]))
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [1e-3, 0.1, 1.0], rtol=1e-3)
