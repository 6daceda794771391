"""What a map sees, against a naive twin in NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from distal.rig import HALF_WIDTHS, IN_RADIAL, TIME_CONSTANTS, LearnedMap
from tests.learned_maps import along, drawn_map

Floats = NDArray[np.float64]


def walk(samples: int, count: int, seed: int) -> Floats:
    rng = np.random.default_rng(seed)
    return np.cumsum(0.1 * rng.normal(size=(samples, count)), axis=0)


def naive(
    learned: LearnedMap, time: Floats, readings: Floats
) -> dict[str, tuple[list[Floats], float]]:
    """Return features and doubts as the equations say, sample by sample, and to what they agree."""
    arrays, moving, count = learned.arrays, list(learned.moving), readings.shape[1]
    efforts = np.array([k < len(learned.channels) and k not in moving for k in range(count)])
    held = np.where(np.isfinite(readings[0]), readings[0], arrays["centre"])
    z = (held - arrays["centre"]) / arrays["scale"]
    halves = arrays["play"][0] * np.array(HALF_WIDTHS)
    low, high = z - halves[:, None], z + halves[:, None]
    states = np.array([z for _ in TIME_CONSTANTS])
    phis, doubts, fars = [], [], []
    before = time[0]
    for now, row in zip(time, readings):
        far = np.abs((row - arrays["centre"]) / arrays["scale"]) > 4.8916  # 1e-6 of a normal value
        held = np.where(np.isfinite(row) & ~(far & efforts), row, held)
        z = (held - arrays["centre"]) / arrays["scale"]
        reach = z - halves[:, None], z + halves[:, None]
        low, high = np.clip(low, *reach), np.clip(high, *reach)
        slips = (z - (low + high) / 2) / halves[:, None]
        for k, constant in enumerate(TIME_CONSTANTS):
            states[k] += (1 - np.exp(-(now - before) / constant)) * (z - states[k])
        before = now
        inputs = np.concatenate([z, slips[IN_RADIAL][moving]]) / arrays["lengths"]
        kernel = np.exp(-((arrays["points"] - inputs) ** 2).sum(axis=1) / 2)
        explained = arrays["root"] @ kernel
        amplitude = np.sqrt(1 + (inputs[:count] ** 2).sum())
        phis.append(np.concatenate([[1], z, *slips, *(z - states), amplitude * explained]))
        doubts.append(((high - low) / (2 * halves[:, None])).ravel())
        fars.append([amplitude**2 * max(1 - explained @ explained, 0.0)])
    return {"features": (phis, 1e-12), "doubt": (doubts, 1e-12), "far": (fars, 1e-9)}


@pytest.mark.parametrize("beside", [True, False])
def test_they_are_those_of_the_equations(beside: bool) -> None:
    learned = drawn_map(("a", "b"), ("x", "y", "f"), beside)
    time = np.cumsum(np.random.default_rng(2).uniform(0.005, 0.02, size=300))
    readings = walk(300, len(learned.arrays["centre"]), 3)
    readings[0, 1] = readings[40:90, 0] = readings[200:, 2] = np.nan
    seen = along(learned, time, readings)
    for name, (values, tolerance) in naive(learned, time, readings).items():
        np.testing.assert_allclose(seen[name], values, atol=tolerance)
