"""What a map sees, against a naive twin in NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from distal.regression import Shape, features_along
from distal.rig import HALF_WIDTHS, IN_RADIAL, TIME_CONSTANTS
from tests.learned_maps import drawn_map

Floats = NDArray[np.float64]


def frame_of(learned: object, shape: Shape) -> Floats:
    arrays = learned.arrays  # type: ignore[attr-defined]
    return np.concatenate([arrays[name].ravel(order="F") for name in shape.frame.names])


def walk(samples: int, count: int, seed: int) -> Floats:
    rng = np.random.default_rng(seed)
    return np.cumsum(0.1 * rng.normal(size=(samples, count)), axis=0)


def naive(learned: object, time: Floats, readings: Floats, channels: int) -> dict[str, Floats]:
    """Return features and doubts as the equations say, sample by sample."""
    arrays = learned.arrays  # type: ignore[attr-defined]
    moving = learned.moving  # type: ignore[attr-defined]
    count = readings.shape[1]
    held = np.where(np.isfinite(readings[0]), readings[0], arrays["centre"])
    z = (held - arrays["centre"]) / arrays["scale"]
    halves = arrays["play"][0] * np.array(HALF_WIDTHS)
    low = np.array([z - half for half in halves])
    high = np.array([z + half for half in halves])
    states = np.array([z for _ in TIME_CONSTANTS])
    phis, doubts, fars = [], [], []
    before = time[0]
    for now, row in zip(time, readings):
        far = np.abs((row - arrays["centre"]) / arrays["scale"]) > 4.8916  # 1e-6 of a normal value
        is_effort = [k < channels and k not in moving for k in range(count)]
        held = np.where(np.isfinite(row) & ~(far & is_effort), row, held)
        z = (held - arrays["centre"]) / arrays["scale"]
        for k, half in enumerate(halves):
            low[k] = np.clip(low[k], z - half, z + half)
            high[k] = np.clip(high[k], z - half, z + half)
        slips = [(z - (a + b) / 2) / half for a, b, half in zip(low, high, halves)]
        for k, constant in enumerate(TIME_CONSTANTS):
            states[k] += (1 - np.exp(-(now - before) / constant)) * (z - states[k])
        before = now
        inputs = np.concatenate([z, slips[IN_RADIAL][list(moving)]]) / arrays["lengths"]
        kernel = np.exp(-((arrays["points"] - inputs) ** 2).sum(axis=1) / 2)
        explained = arrays["root"] @ kernel
        amplitude = np.sqrt(1 + (inputs[:count] ** 2).sum())
        phis.append(
            np.concatenate([[1], z, *slips, *(z - s for s in states), amplitude * explained])
        )
        doubts.append(np.concatenate([(b - a) / (2 * h) for a, b, h in zip(low, high, halves)]))
        fars.append(amplitude**2 * max(1 - explained @ explained, 0.0))
    return {"features": np.array(phis), "doubt": np.array(doubts), "far": np.array(fars)}


@pytest.mark.parametrize("beside", [True, False])
def test_they_are_those_of_the_equations(beside: bool) -> None:
    learned = drawn_map(("a", "b"), ("x", "y", "f"), beside)
    shape = Shape.of(learned)
    time = np.cumsum(np.random.default_rng(2).uniform(0.005, 0.02, size=300))
    readings = walk(300, shape.count, 3)
    readings[0, 1] = readings[40:90, 0] = readings[200:, 2] = np.nan
    along = features_along(shape, frame_of(learned, shape), time, readings)
    expected = naive(learned, time, readings, shape.channels)
    np.testing.assert_allclose(along["features"], expected["features"], atol=1e-12)
    np.testing.assert_allclose(along["doubt"], expected["doubt"], atol=1e-12)
    np.testing.assert_allclose(along["far"][:, 0], expected["far"], atol=1e-9)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 1000), start=st.floats(-1.0, 1.0))
def test_a_plays_interval_holds_it_wherever_it_began(seed: int, start: float) -> None:
    learned = drawn_map(("a",), ("x",), False)
    shape = Shape.of(learned)
    readings = walk(60, 1, seed)
    frame = frame_of(learned, shape)
    along = features_along(shape, frame, 0.01 * np.arange(60), readings)
    z = (readings[:, 0] - learned.arrays["centre"]) / learned.arrays["scale"]
    for k, half in enumerate(learned.arrays["play"][0] * np.array(HALF_WIDTHS)):
        place = z[0] + start * half
        for now, slip, doubt in zip(z, along["features"][:, 2 + k], along["doubt"][:, k]):
            place = min(max(place, now - half), now + half)
            assert abs((now - place) / half - slip) <= doubt + 1e-9
    assert np.all(np.diff(along["doubt"], axis=0) <= 1e-12)  # it is only ever told better


def test_far_from_the_points_the_radial_part_is_the_priors() -> None:
    learned = drawn_map(("a",), ("x", "y"), False)
    shape = Shape.of(learned)
    readings = np.array([[0.0, 0.0], [50.0, 50.0]])
    along = features_along(shape, frame_of(learned, shape), np.array([0.0, 0.01]), readings)
    assert along["far"][1, 0] == pytest.approx(along["amplitude"][1, 0] ** 2)
    assert along["far"][1, 0] > 100 * along["far"][0, 0]
