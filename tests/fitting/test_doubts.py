"""What is said of fitted numbers that are far from what the rig file expected."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from distal.fitting.parameter_search import far_from_priors
from distal.fitting.parameters_and_priors import FittedParameter, Free


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
def test_a_number_far_from_its_prior_is_named(
    logarithmic: bool, std: float, value: float, said: bool
) -> None:
    path = "tendons.0.stiffness"
    free = Free("stiffness", (path,), (20e3,), std, 20e3, 1.0, 1e9, "N/m", logarithmic=logarithmic)
    found = FittedParameter("stiffness", (path,), "N/m", 20e3, std, value, 1.0, False, (value,))
    problem: Any = SimpleNamespace(free=(free,))
    lines = far_from_priors([found], problem)
    assert bool(lines) is said
    assert all(
        "stiffness = " in line and "standard deviations from what the rig file expected" in line
        for line in lines
    )


def test_a_number_as_it_came_keeps_the_ratios_of_what_shares_it() -> None:
    """Two tendons of 20 and 10 N/mm, fitted together to 22 and 11: as they came they are 20 and
    10.
    """
    paths = ("tendons.0.stiffness", "tendons.1.stiffness")
    found = FittedParameter("stiffness", paths, "N/m", 20e3, 4e3, 22e3, 1.0, False, (22e3, 11e3))
    back = found.as_it_came
    assert back.value == 20e3
    assert back.values == pytest.approx((20e3, 10e3))
