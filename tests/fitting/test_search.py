"""The search on problems whose answer is known: least squares, bounds, a bent valley, fixed
coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from distal.fitting import parameter_search
from distal.fitting.likelihood import Derivatives
from distal.fitting.parameter_search import (
    covariance_at,
    first_widths,
    hessian,
    search,
    widths_at,
)
from distal.fitting.parameters_and_priors import Free
from tests.helpers import finite_difference

Floats = NDArray[np.float64]


@pytest.fixture(autouse=True)
def without_kinks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Searches go on to the answer, since these functions have no kinks."""
    monkeypatch.setattr(parameter_search, "ENOUGH", 1e-3)
    monkeypatch.setattr(parameter_search, "ITERATIONS", 60)


class Curve:
    """−ln p = ½ |r(z)|² + prior, with exact slopes: what a `Problem` gives, of a function that is
    known.
    """

    def __init__(
        self,
        residuals: Callable[[Floats], Floats],
        size: int,
        std: float = 1e3,
        low: float = -np.inf,
    ) -> None:
        self._residuals, self.size, self.calls = residuals, size, 0
        self.asked = list[Floats]()
        free = Free("x", ("x",), (1.0,), std, 1.0, low, np.inf)
        self.parts = tuple((free, None) for _ in range(size))
        self.prior_stds = np.full(size, std)
        self.prior_information = np.eye(size) / std**2
        self.bounds = np.array([free.bounds for _ in range(size)])

    def costs(self, points: Sequence[Floats]) -> Floats:
        self.calls += len(points)
        squares = [self._residuals(z) @ self._residuals(z) for z in points]
        priors = [np.sum((z / self.prior_stds) ** 2) for z in points]
        return 0.5 * (np.array(squares) + priors)

    def derivatives(self, z: Floats, widths: Floats) -> Derivatives:
        self.asked.append(widths)
        base = self._residuals(z)
        jacobian = finite_difference(self._residuals, z) * (widths > 0.0)
        gradient = jacobian.T @ base + z / self.prior_stds**2
        information = jacobian.T @ jacobian
        return Derivatives(float(self.costs([z])[0]), gradient, information)


def test_least_squares_is_found_with_its_prior() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(30, 4)), 10.0 * rng.normal(size=30)
    problem = Curve(lambda z: a @ z - b, 4, std=2.0)
    found = search(problem, np.zeros(4))  # type: ignore[arg-type]
    expected = a.T @ a + np.eye(4) / 4.0
    assert found.converged
    near = 0.1 * np.sqrt(np.diag(np.linalg.inv(a.T @ a))).max()
    np.testing.assert_allclose(found.z, np.linalg.solve(expected, a.T @ b), atol=near)
    information = hessian(problem, found.derivatives)  # type: ignore[arg-type]
    np.testing.assert_allclose(information, expected, rtol=1e-5)
    covariance = covariance_at(problem, found.derivatives)  # type: ignore[arg-type]
    np.testing.assert_allclose(covariance, np.linalg.inv(expected), rtol=1e-5, atol=1e-9)
    assert found.cost == pytest.approx(problem.costs([found.z])[0])


def test_fixed_coordinates_stay_and_the_others_go_where_these_leave_them() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(20, 3)), 10.0 * rng.normal(size=20)
    problem = Curve(lambda z: a @ z - b, 3)
    fixed = np.array([False, True, False])
    found = search(problem, np.array([0.0, 0.7, 0.0]), fixed=fixed)  # type: ignore[arg-type]
    assert found.z[1] == 0.7
    # a slope of what stays costs a run over all logs
    assert len(problem.asked) > 1
    np.testing.assert_array_equal(np.array(problem.asked) > 0.0, [~fixed] * len(problem.asked))
    rest = np.linalg.lstsq(a[:, ~fixed], b - 0.7 * a[:, 1], rcond=None)[0]
    np.testing.assert_allclose(found.z[~fixed], rest, atol=0.05)


def test_a_bound_holds() -> None:
    """(1 − low)/scale is the lowest coordinate of a number that starts at 1 and is at least
    `low`.
    """
    problem = Curve(lambda z: 10.0 * np.array([z[0] + 5.0, z[1] - 2.0]), 2, low=0.25)
    found = search(problem, np.zeros(2))  # type: ignore[arg-type]
    np.testing.assert_allclose(found.z, [-0.75, 2.0], atol=1e-3)
    assert found.converged


def test_a_bent_valley_is_followed_to_its_end_or_where_it_is_told_to_stop() -> None:
    """Rosenbrock's, from where steepest descent takes thousands of steps."""
    problem = Curve(lambda z: np.array([100.0 * (z[1] - z[0] ** 2), 10.0 * (1.0 - z[0])]), 2)
    begin = np.array([-1.2, 1.0])
    found = search(problem, begin)  # type: ignore[arg-type]
    assert found.converged
    np.testing.assert_allclose(found.z, [1.0, 1.0], atol=0.03)
    short = search(problem, begin, most=2)  # type: ignore[arg-type]
    assert not short.converged
    assert not short.interrupted

    def stop(iteration: int, cost: float) -> None:
        raise KeyboardInterrupt

    assert search(problem, begin, stop).interrupted  # type: ignore[arg-type]


def test_slopes_are_taken_over_what_a_number_is_known_to() -> None:
    """As a power of two of the value; two numbers that show only as a product have the same
    share.
    """
    problem = Curve(lambda z: np.array([100.0 * (z[0] + z[1])]), 2)
    here = problem.derivatives(np.zeros(2), first_widths(problem))  # type: ignore[arg-type]
    widths = widths_at(problem, np.zeros(2), here)  # type: ignore[arg-type]
    assert widths[0] == widths[1]
    assert 0.5 * 0.3 / 100.0 <= widths[0] <= 2.0 * 0.3 / 100.0
    assert np.log2(widths[0]) == round(np.log2(widths[0]))


def test_an_interruption_before_anything_is_known_leaves_the_prior() -> None:
    """What comes after a search needs derivatives of the right size, however early the user stops
    it.
    """

    class Stopped(Curve):
        def derivatives(self, z: Floats, widths: Floats) -> Derivatives:
            raise KeyboardInterrupt

    problem = Stopped(lambda z: z - 1.0, 3, std=2.0)
    found = search(problem, np.zeros(3))  # type: ignore[arg-type]
    assert found.interrupted
    information = hessian(problem, found.derivatives)  # type: ignore[arg-type]
    np.testing.assert_allclose(information, np.eye(3) / 4.0, rtol=1e-6, atol=1e-9)


def test_slopes_are_taken_over_a_share_of_the_value() -> None:
    """In coordinates: of a positive number all of its value over the scale, at least a tenth; else
    1, the scale itself.
    """
    positive, log = (
        Free("k", ("k",), (4.0,), 1.0, 2.0, 0.0, np.inf),
        Free("e", ("e",), (4.0,), 1.0, 2.0, 1e-9, np.inf),
    )
    assert [positive.unit(z) for z in (0.0, 1.0, -1.99)] == pytest.approx([2.0, 3.0, 0.1])
    assert Free("a", ("a",), (4.0,), 1.0, 2.0, -np.inf, np.inf).unit(1.0) == 1.0
    assert replace(log, logarithmic=True).unit(1.0) == 1.0


def test_a_filters_search_ends_where_its_kinks_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of −ln p that only falls, e^{−2z}: with a filter a gain of 0.3 is not followed, with
    equations one of 1e-3 is.
    """
    curves = [Curve(lambda z: 3.0 * np.exp(-z), 1, std=1e9) for _ in range(2)]
    ends = [search(curve, np.array([-3.0])) for curve in curves[1:]]  # type: ignore[arg-type]
    monkeypatch.setattr(parameter_search, "ENOUGH", 0.3)
    ends.insert(0, search(curves[0], np.array([-3.0])))  # type: ignore[arg-type]
    assert ends[0].converged
    assert curves[1].calls > curves[0].calls
