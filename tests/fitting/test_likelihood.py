"""−ln p of innovations and its derivatives, against textbook forms and finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from distal.fitting.likelihood import (
    Derivatives,
    Innovations,
    Weighing,
    cost_of,
    derivatives_of,
    evened,
    scales_of,
    shares_of,
)
from tests.helpers import finite_difference

Floats = NDArray[np.float64]

COUNT = 400


def weighing(counts: Floats | None = None, tolerance: float = np.inf) -> Weighing:
    return Weighing(
        np.full(2, tolerance),
        np.array([1.0, 0.5]),
        np.array([COUNT, COUNT]) if counts is None else counts,
    )


def run(z: Floats) -> Innovations:
    """A linear model with a variance that depends on the second coordinate."""
    rng = np.random.default_rng(2)
    design = rng.normal(size=(COUNT, 2))
    values = np.column_stack(
        [design @ np.array([z[0], 0.3]) - 0.2, 0.5 * z[0] + rng.normal(size=COUNT)]
    )
    return Innovations(values, np.full((COUNT, 2), 0.8 * np.exp(z[1])))


Z = np.array([0.4, 0.1])
RUN = run(Z)
OUTLIERS, UNLIMITED = np.full(2, 9.0), np.full(2, np.inf)


def derivatives_at(z: Floats, weighing: Weighing, width: float = 1e-4) -> Derivatives:
    ends = [run(z + step) for step in width * np.eye(2)]
    return derivatives_of(run(z), ends, np.full(2, width), weighing)


def test_it_is_the_likelihood_of_a_normal_distribution() -> None:
    nu, spread = RUN.values, RUN.variances
    expected = 0.5 * np.sum(np.array([1.0, 0.5]) * (nu**2 / spread + np.log(spread)))
    assert cost_of(RUN, weighing()) == pytest.approx(expected)
    assert cost_of(Innovations(nu, -spread), weighing()) == np.inf


def test_a_filter_that_left_all_bounds() -> None:
    """Innovations whose squares are no numbers cost infinitely much; as an end of a step they have
    no slope.
    """
    wild = Innovations(np.full_like(RUN.values, 1e200), RUN.variances)
    assert cost_of(wild, weighing()) == np.inf
    widths = np.array([1e-4, 0.0])
    found = derivatives_of(RUN, [wild, run(Z + np.diag(widths)[0])], widths, weighing())
    assert found.gradient[0] == 0.0
    assert np.isfinite(found.information).all()
    assert found.information[1, 1] == 0.0  # it is not varied


def test_an_outlier_counts_as_in_the_filter() -> None:
    """Beyond ν² = 9 S the variance grows with it: ½ (9 + ln ν²/9)."""
    values, variances = np.full((COUNT, 2), np.nan), np.ones((COUNT, 2))
    values[0, 0] = 30.0
    single = Weighing(OUTLIERS, np.ones(2), np.array([1.0, 0.0]))
    expected = 0.5 * (9.0 + np.log(100.0))
    assert cost_of(Innovations(values, variances), single) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("tolerance", "log_spread", "scaled"),
    [(np.inf, 0.1, False), (2.0, 0.1, False), (np.inf, -3.0, True)],
)
def test_the_gradient_is_that_of_the_cost(
    tolerance: float, log_spread: float, scaled: bool
) -> None:
    """Also where c is found at each point: it is held in the slopes, since it is where the
    likelihood is largest.
    """

    def weighed(z: Floats) -> Weighing:
        scale = scales_of([run(z)], UNLIMITED) if scaled else np.ones(2)
        assert not scaled or (scale > 2.0).all()
        return replace(weighing(tolerance=tolerance), scale=scale)

    z = np.array([0.4, log_spread])
    found = derivatives_at(z, weighed(z), 2e-4)
    slopes = finite_difference(lambda at: np.array([cost_of(run(at), weighed(at))]), z)
    np.testing.assert_allclose(found.gradient, slopes[0], rtol=1e-3, atol=1e-4 * scaled)
    assert np.linalg.eigvalsh(found.information).min() > 0.0


def test_fishers_information_of_a_variance() -> None:
    """½ Σ w (∂ ln S)², and nothing between mean and variance."""
    found = derivatives_at(Z, weighing())
    assert found.information[1, 1] == pytest.approx(0.5 * COUNT * 1.5, rel=1e-6)
    assert found.information[0, 1] == pytest.approx(0.0, abs=1e-6)


def test_how_many_values_are_compared_does_not_matter() -> None:
    """Half of the values of a channel stand for all; of hardly any each counts for at most
    twenty.
    """
    values = RUN.values.copy()
    values[::2, 0] = np.nan
    half = Innovations(values, RUN.variances)
    np.testing.assert_allclose(evened(half, weighing()), [2.0, 1.0])
    assert cost_of(half, weighing()) == pytest.approx(cost_of(RUN, weighing()), rel=0.1)
    values[3:, 0] = np.nan
    assert evened(half, weighing())[0] == pytest.approx(20.0)


def test_the_scale_of_residuals_is_their_mean_ratio() -> None:
    """White residuals 3 standard deviations large have c = 9, smaller ones than expected 1, and
    outliers hardly count.
    """
    values = np.array([3.0, 0.5]) * np.random.default_rng(4).normal(size=(20_000, 2))
    ones = np.ones_like(values)
    found = scales_of([Innovations(values, ones)], UNLIMITED)
    assert found == pytest.approx([9.0, 1.0], rel=0.03)
    values[::100, 0] = 1e3
    assert scales_of([Innovations(values, ones)], OUTLIERS)[0] == pytest.approx(9.0, rel=0.15)
    silent = Innovations(np.nan * ones, ones)
    assert scales_of([silent], OUTLIERS) == pytest.approx([1.0, 1.0])


def test_the_share_of_white_and_of_lasting_residuals() -> None:
    """White ones count in full; ones that last for a span of 200 samples count a 200th."""
    rng = np.random.default_rng(5)
    times, spans = np.arange(40_000) / 100.0, np.repeat(rng.normal(size=200), 200)
    values = np.column_stack([rng.normal(size=40_000), spans])
    white, lasting = shares_of([Innovations(values, np.full_like(values, 4.0))], [times])
    assert white > 0.8
    assert lasting == pytest.approx(1.0 / 200.0)
