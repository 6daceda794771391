"""What is said of fitted numbers that are far from what the rig file expected."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from distal.fitting.doubts import far_from_priors, noise_growth
from distal.fitting.fitted import FittedNumber
from distal.fitting.free import Free
from distal.fitting.numbers import fitted_numbers
from distal.fitting.uncertainty import Uncertainty


@pytest.mark.parametrize(
    ("logarithmic", "std", "value", "said"),
    [
        (True, 4e4, 10e3, False),  # half, where a factor of three was stated
        (True, 4e4, 2e3, True),  # a tenth: more than the square of that factor
        (True, 4e4, 190e3, True),
        (False, 4e3, 30e3, False),  # 2.5 standard deviations
        (False, 4e3, 37e3, True),
    ],
)
def test_a_number_far_from_its_prior_is_named(logarithmic: bool, std: float, value: float, said: bool) -> None:
    path = "tendons.0.stiffness"
    free = Free("stiffness", (path,), (20e3,), std, 20e3, 1.0, 1e9, "N/m", logarithmic=logarithmic)
    found = FittedNumber("stiffness", (path,), "N/m", 20e3, std, value, 1.0, True, False, (value,))
    problem: Any = SimpleNamespace(free=(free,))
    lines = far_from_priors([found], problem)
    assert bool(lines) is said
    assert all(
        "stiffness = " in line and "standard deviations from what the rig file expected" in line for line in lines
    )


def test_a_number_as_it_came_keeps_the_ratios_of_what_shares_it() -> None:
    """Two tendons of 20 and 10 N/mm, fitted together to 22 and 11: as they came they are 20 and 10."""
    paths = ("tendons.0.stiffness", "tendons.1.stiffness")
    found = FittedNumber("stiffness", paths, "N/m", 20e3, 4e3, 22e3, 1.0, True, False, (22e3, 11e3))
    back = found.as_it_came
    assert back.value == 20e3
    assert back.values == pytest.approx((20e3, 10e3))
    assert not back.identified


@pytest.mark.parametrize(
    ("path", "kept", "grown", "factor"),
    [
        ("sensors.0.noise", False, 11.0, 11.0),
        ("sensors.0.noise", False, 3.9, 1.0),  # a noise may be four times what its sheet says
        ("sensors.0.noise", True, 11.0, 1.0),  # the reference's own, which the file keeps
        ("joints.0.unmodelled", False, 11.0, 1.0),
    ],
)
def test_noise_that_grows_too_much_multiplies_standard_errors(
    path: str, kept: bool, grown: float, factor: float
) -> None:
    free = Free("noise", (path,), (0.2,), 0.2, 0.2, 1e-3, 1e3, "N", logarithmic=True, noise=True, kept_by_file=kept)
    problem: Any = SimpleNamespace(parts=((free, None),))
    assert noise_growth(problem, np.array([free.coordinate(0.2 * grown)])) == pytest.approx(factor)


@pytest.mark.parametrize(("grown", "error"), [(1.0, 0.02), (8.0, 0.16), (40.0, 0.5)])
def test_standard_errors_grow_with_the_noise_up_to_the_priors(grown: float, error: float) -> None:
    """A fit that ended with a sensor's noise 8 times what the rig says reports 8 times the standard error of a number."""
    number = Free("k", ("tendons.0.stiffness",), (1.0,), 0.5, 1.0, 0.0, 10.0, "N/m")
    noise = Free("n", ("sensors.0.noise",), (0.2,), 0.2, 0.2, 1e-3, 1e3, "N", logarithmic=True, noise=True)
    z = np.array([number.coordinate(1.3), noise.coordinate(0.2 * grown)])
    covariance = np.diag([0.02 / number.slope(z[0]), 0.01]) ** 2
    known = Uncertainty(covariance, np.ones(2, bool), np.zeros(2, bool), ())
    problem: Any = SimpleNamespace(
        free=(number, noise),
        parts=((number, None), (noise, None)),
        data=(SimpleNamespace(log=SimpleNamespace(source="a log")),),
        columns=lambda log: [0, 1],
    )
    found: Any = SimpleNamespace(z=z, converged=True, interrupted=False)
    first = fitted_numbers(problem, found, known, np.zeros(2, bool), np.zeros(2, bool))[0]
    assert first.value == pytest.approx(1.3)
    assert first.error == pytest.approx(error, rel=1e-6)
