"""Sensor models: quantisation, linearity bound, noise level."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distal import Rig, load_rig
from distal.arrays import Floats
from distal.rig import Sensor
from distal.sensor_models import (
    LINEARITY_STD,
    SensorErrors,
    drawn_curve,
    linearity_curve,
    quantised,
    quantised_values,
    systematic_variance,
    variance,
)
from tests.helpers import measure

TRAVEL = (-5e-3, 15e-3)


def sensor(rig: Rig, **values: float) -> Sensor:
    clean = {"noise": 0.0, "linearity": 0.0, "resolution": 0.0, "bias": 0.0, **values}
    return rig.with_values({f"sensors.x1.{name}": value for name, value in clean.items()}).sensors[
        0
    ]


def drawn(seed: int, largest: float, true: Floats) -> Floats:
    weights, phases = drawn_curve(TRAVEL, largest, np.random.default_rng(seed))
    parameters = {"low": TRAVEL[0], "high": TRAVEL[1], "weights": weights, "phases": phases}
    curve: Floats = np.array(linearity_curve(ca.DM(true), parameters)).ravel()
    return curve


TRUE = np.linspace(*TRAVEL, 20_001)


def read(rig: Rig, seed: int = 0, true: Floats = TRUE, **values: float) -> Floats:
    """Return what a sensor with these errors alone reads."""
    return measure(sensor(rig, **values), true, TRAVEL, np.random.default_rng(seed))


def test_noise_level(paper_rig: Rig) -> None:
    error = read(paper_rig, noise=5e-6) - TRUE
    # 20,001 draws: the standard deviation is known to 0.5 %, the mean to 0.035 µm
    assert error.std() == pytest.approx(5e-6, rel=0.02)
    assert abs(error.mean()) < 1.4e-7
    assert abs(np.corrcoef(error[1:], error[:-1])[0, 1]) < 0.03


def test_quantisation(paper_rig: Rig) -> None:
    step = 1e-4
    found = read(paper_rig, resolution=step)
    assert np.abs(found - TRUE).max() <= step / 2 * (1 + 1e-9)
    np.testing.assert_allclose(found / step, np.round(found / step), atol=1e-9)
    assert (found - TRUE).std() == pytest.approx(
        np.sqrt(variance(sensor(paper_rig, resolution=step))), rel=0.01
    )


def test_ties_round_up_in_numbers_and_in_symbols() -> None:
    values, step = ca.SX.sym("values", 5), ca.SX.sym("step")
    symbolic = ca.Function("quantised", [values, step], [quantised(values, step)])
    readings = np.array([-1.5, -0.5, 0.5, 1.5, 2.5])
    for size, expected in ((1.0, [-1.0, 0.0, 1.0, 2.0, 3.0]), (0.0, readings)):
        np.testing.assert_array_equal(quantised_values(readings, size), expected)
        np.testing.assert_array_equal(np.array(symbolic(readings, size)).ravel(), expected)


@given(st.integers(0, 2**32 - 1))
def test_linearity_is_bounded_reached_and_smooth(seed: int) -> None:
    curve = drawn(seed, 1e-4, TRUE)
    assert np.abs(curve).max() == pytest.approx(1e-4, rel=1e-3)
    # three half waves at the most over the travel: the slope is at most π j/travel times the sum of
    # the amplitudes
    assert np.abs(np.gradient(curve, TRUE)).max() < 3 * np.pi * 4e-4 / (TRAVEL[1] - TRAVEL[0])


def test_linearity_is_the_same_at_the_same_place(paper_rig: Rig) -> None:
    there_and_back = np.concatenate([TRUE, TRUE[::-1]])
    found = read(paper_rig, true=there_and_back, linearity=1e-4)
    np.testing.assert_array_equal(found[: len(TRUE)], found[len(TRUE) :][::-1])


def test_linearity_std_is_that_of_many_curves(paper_rig: Rig) -> None:
    """What filters take for it, 0.6 of the bound, against 2,000 drawn curves."""
    grid = np.linspace(*TRAVEL, 201)
    curves = [drawn(seed, 1.0, grid) for seed in range(2000)]
    assert np.std(curves) == pytest.approx(LINEARITY_STD, abs=0.05)
    assert systematic_variance(sensor(paper_rig, linearity=1e-4)) == pytest.approx((0.6e-4) ** 2)


def test_bias(paper_rig: Rig) -> None:
    np.testing.assert_allclose(read(paper_rig, bias=2e-4) - TRUE, 2e-4, atol=1e-15)


def test_switching_one_error_off_keeps_the_others(paper_rig: Rig) -> None:
    """Runs with and without linearity differ by the linearity alone."""
    errors = ({"noise": 5e-6, "linearity": 1e-4}, {"noise": 5e-6}, {"linearity": 1e-4})
    with_it, without, alone = (read(paper_rig, 5, **each) for each in errors)
    np.testing.assert_allclose(with_it - without, alone - TRUE, atol=1e-12)


def test_samples_one_by_one_read_as_a_whole_run_does() -> None:
    """A control loop gets what a log would hold, sample by sample."""
    true = 4e-3 * np.sin(np.linspace(0, 9, 700))
    for sensor in load_rig("paper-2008").sensors:
        errors = SensorErrors(sensor, TRAVEL, np.random.default_rng(5))
        steps = [errors.read(true[k : k + 1])[0] for k in range(len(true))]
        whole = measure(sensor, true, TRAVEL, np.random.default_rng(5))
        np.testing.assert_array_equal(steps, whole)
