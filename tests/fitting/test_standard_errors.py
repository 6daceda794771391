"""What logs tell: marginal errors, what shows only together, what is held so that the rest is
told.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from distal.fitting.free_parameter import Free
from distal.fitting.likelihood import Derivatives
from distal.fitting.parameter_estimates import _next_held
from distal.fitting.standard_errors import Uncertainty, uncertainty_at

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


def identified(stds: list[float], information: Floats, meat: Floats | None = None) -> Uncertainty:
    n = len(stds)
    made = Derivatives(0.0, np.zeros(n), information, information if meat is None else meat, 10_000)
    return uncertainty_at(problem(stds), made, np.zeros(n))  # type: ignore[arg-type]


def test_errors_are_marginal_and_combine_logs_with_priors() -> None:
    stds = [0.1, 0.2]
    information = np.array([[900.0, 500.0], [500.0, 400.0]])
    found = identified(stds, information)
    whole = np.linalg.inv(information + np.diag([100.0, 25.0]))
    np.testing.assert_allclose(found.covariance, whole, rtol=1e-3)
    np.testing.assert_allclose(found.errors, np.sqrt(np.diag(whole)), rtol=1e-3)


def test_scores_that_are_correlated_widen_it_and_never_narrow_it() -> None:
    information = np.diag([1e4, 1e4])
    plain = identified([1.0, 1.0], information)
    wide, narrow = (
        identified([1.0, 1.0], information, 9.0 * information),
        identified([1.0, 1.0], information, 0.1 * information),
    )
    np.testing.assert_allclose(wide.errors, 3.0 * plain.errors, rtol=2e-3)
    np.testing.assert_allclose(narrow.errors, plain.errors, rtol=2e-3)


def test_what_shows_only_as_a_product_is_told_together() -> None:
    """Neither is known; with one held, the other is, to the product's error."""
    information = 1e6 * np.ones((2, 2))
    found = identified([0.1, 0.1], information)
    # each keeps 0.1/√2 of its prior: the product shares it out
    np.testing.assert_allclose(found.errors, 0.1 / np.sqrt(2.0), rtol=1e-3)
    assert found.together.all()
    wide = identified([0.1, 1.0], information)
    assert list(wide.determined) == [False, True]
    assert list(wide.together) == [True, False]
    held = np.array([True, False])
    assert wide.errors_holding(held)[1] == pytest.approx(1e-3, rel=0.05)
    assert wide.errors_holding(held)[0] == 0.0


def test_what_nothing_shows_is_left_and_not_held() -> None:
    found = identified([0.1, 0.1], np.diag([1e6, 1e-3]))
    assert list(found.determined) == [True, False]
    assert not found.together.any()


def test_the_least_told_is_held_until_the_rest_is_told() -> None:
    """Three numbers show only as their sum: two are held, and the third carries it."""
    stds, information = [0.1, 0.1, 1.0], 1e6 * np.ones((3, 3))
    made, found = problem(stds), identified(stds, information)
    left = np.zeros(3, dtype=bool)
    for _ in range(3):
        at = _next_held(made, found, left, np.ones(3, dtype=bool))  # type: ignore[arg-type]
        if at is None:
            break
        left[at] = True
    assert list(left) == [True, True, False]
    assert found.errors_holding(left)[2] == pytest.approx(1e-3, rel=0.05)


def test_a_number_without_a_prior_is_judged_by_its_value() -> None:
    sure, vague = (
        identified([np.nan, 0.1], np.diag([100.0, 1e4])),
        identified([np.nan, 0.1], np.diag([1.0, 1e4])),
    )
    assert sure.determined[0]
    assert not vague.determined[0]


def test_numbers_that_go_with_each_other_exactly_have_errors_too() -> None:
    """Of a singular covariance: with one of two held, nothing is left of the other."""
    covariance = np.array([[4.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 9.0]])
    nothing = np.zeros(3, dtype=bool)
    errors = Uncertainty(covariance, nothing, nothing).errors_holding(
        np.array([True, False, False])
    )
    assert errors == pytest.approx([0.0, 0.0, 3.0])
