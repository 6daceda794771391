"""−ln p of innovations and its derivatives, against textbook forms and finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from distal.fitting.likelihood import (
    Innovations,
    Weighing,
    cost_of,
    derivatives_of,
    evened,
    scales_of,
    shares_of,
)

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


def at(z: Floats, widths: Floats) -> list[Innovations]:
    return [run(z + step) for step in np.diag(widths)]


def test_it_is_the_likelihood_of_a_normal_distribution() -> None:
    made = run(np.array([0.4, 0.1]))
    nu, spread = made.values, made.variances
    expected = 0.5 * np.sum(np.array([1.0, 0.5]) * (nu**2 / spread + np.log(spread)))
    assert cost_of(made, weighing()) == pytest.approx(expected)
    broken = Innovations(nu, np.where(spread > 0, -1.0, spread))
    assert cost_of(broken, weighing()) == np.inf


def test_a_filter_that_left_all_bounds() -> None:
    """Innovations whose squares are no numbers cost infinitely much; as an end of a step they have
    no slope.
    """
    z, made = np.array([0.4, 0.1]), run(np.array([0.4, 0.1]))
    wild = Innovations(np.full_like(made.values, 1e200), made.variances)
    assert cost_of(wild, weighing()) == np.inf
    _, second = at(z, np.full(2, 1e-4))
    derivatives = derivatives_of(made, [wild, second], np.full(2, 1e-4), weighing())
    assert derivatives.gradient[0] == 0.0
    assert np.isfinite(derivatives.information).all()


def test_an_outlier_counts_as_in_the_filter() -> None:
    """Beyond ν² = 9 S the variance grows with it: ½ (9 + ln ν²/9)."""
    values, variances = np.full((COUNT, 2), np.nan), np.ones((COUNT, 2))
    values[0, 0] = 30.0
    single = Weighing(np.full(2, 9.0), np.ones(2), np.array([1.0, 0.0]))
    assert cost_of(Innovations(values, variances), single) == pytest.approx(
        0.5 * (9.0 + np.log(100.0))
    )


@pytest.mark.parametrize("tolerance", [np.inf, 2.0])
def test_the_gradient_is_that_of_the_cost(tolerance: float) -> None:
    z, widths = np.array([0.4, 0.1]), np.full(2, 2e-4)
    found = derivatives_of(run(z), at(z, widths), widths, weighing(tolerance=tolerance))
    for k, step in enumerate(np.diag(np.full(2, 1e-6))):
        slope = (
            cost_of(run(z + step), weighing(tolerance=tolerance))
            - cost_of(run(z - step), weighing(tolerance=tolerance))
        ) / 2e-6
        assert found.gradient[k] == pytest.approx(slope, rel=1e-3)
    assert np.linalg.eigvalsh(found.information).min() > 0.0


def test_fishers_information_of_a_variance() -> None:
    """½ Σ w (∂ ln S)², and nothing between mean and variance."""
    z, widths = np.array([0.4, 0.1]), np.full(2, 1e-4)
    found = derivatives_of(run(z), at(z, widths), widths, weighing())
    assert found.information[1, 1] == pytest.approx(0.5 * COUNT * 1.5, rel=1e-6)
    assert found.information[0, 1] == pytest.approx(0.0, abs=1e-6)
    still = derivatives_of(run(z), at(z, widths), np.array([1e-4, 0.0]), weighing())
    assert still.information[1, 1] == 0.0


def test_how_many_values_are_compared_does_not_matter() -> None:
    """Half of the values of a channel stand for all; of hardly any each counts for at most
    twenty.
    """
    made = run(np.array([0.4, 0.1]))
    values = made.values.copy()
    values[::2, 0] = np.nan
    even = evened(Innovations(values, made.variances), weighing())
    np.testing.assert_allclose(even, [2.0, 1.0])
    half, whole = (
        cost_of(Innovations(values, made.variances), weighing()),
        cost_of(made, weighing()),
    )
    assert half == pytest.approx(whole, rel=0.1)
    values[3:, 0] = np.nan
    few = evened(Innovations(values, made.variances), weighing())
    assert few[0] == pytest.approx(20.0)


def test_the_scale_of_residuals_is_their_mean_ratio() -> None:
    """White residuals 3 standard deviations large have c = 9, smaller ones than expected 1, and
    outliers hardly count.
    """
    rng = np.random.default_rng(4)
    values = np.column_stack([3.0 * rng.normal(size=20_000), 0.5 * rng.normal(size=20_000)])
    run = Innovations(values, np.ones_like(values))
    assert scales_of([run], np.full(2, np.inf)) == pytest.approx([9.0, 1.0], rel=0.03)
    wild = values.copy()
    wild[::100, 0] = 1e3
    assert scales_of([Innovations(wild, run.variances)], np.full(2, 9.0))[0] == pytest.approx(
        9.0, rel=0.15
    )
    silent = Innovations(np.full((5, 2), np.nan), np.ones((5, 2)))
    assert scales_of([silent], np.full(2, 9.0)) == pytest.approx([1.0, 1.0])


def test_the_scale_is_where_the_likelihood_is_largest() -> None:
    """d/dc of ½ Σ (ν²/(c S) + ln c S) is 0 at c = mean ν²/S: the gradient at that c is the slope of
    −ln p itself.
    """
    z, limit = np.array([0.4, -3.0]), np.full(2, np.inf)

    def cost(at: Floats) -> float:
        made = run(at)
        return cost_of(made, replace(weighing(), scale=scales_of([made], limit)))

    widths = np.full(2, 2e-4)
    scale = scales_of([run(z)], limit)
    assert (scale > 2.0).all()
    found = derivatives_of(run(z), at(z, widths), widths, replace(weighing(), scale=scale))
    for k, step in enumerate(np.diag(np.full(2, 1e-6))):
        assert found.gradient[k] == pytest.approx(
            (cost(z + step) - cost(z - step)) / 2e-6, rel=1e-3, abs=1e-4
        )


def test_the_share_of_white_and_of_lasting_residuals() -> None:
    """White ones count in full; ones that last for a span of 200 samples count a 200th."""
    rng = np.random.default_rng(5)
    times, spans = np.arange(40_000) / 100.0, np.repeat(rng.normal(size=200), 200)
    values = np.column_stack([rng.normal(size=40_000), spans])
    white, lasting = shares_of([Innovations(values, np.full_like(values, 4.0))], [times])
    assert white > 0.8
    assert lasting == pytest.approx(1.0 / 200.0)


def test_a_likelihood_of_half_the_worth_knows_half_as_much() -> None:
    z, widths = np.array([0.4, 0.1]), np.full(2, 1e-4)
    whole = derivatives_of(run(z), at(z, widths), widths, weighing())
    half = derivatives_of(
        run(z), at(z, widths), widths, replace(weighing(), share=0.5 * weighing().share)
    )
    np.testing.assert_allclose(half.information, 0.5 * whole.information, rtol=1e-12)
    np.testing.assert_allclose(half.gradient, 0.5 * whole.gradient, rtol=1e-12)
