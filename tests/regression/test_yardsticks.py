"""Yardsticks are what ten lines of NumPy give."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from distal.regression import YARDSTICKS, Samples, yardstick_error
from distal.regression.least_squares import LAGS


def log_of(seed: int, count: int = 400) -> Samples:
    rng = np.random.default_rng(seed)
    time = np.arange(count) * 0.01
    drive = np.cumsum(np.sin(2.0 * time + rng.uniform(0, 6))) * 1e-2
    force = np.cos(3.0 * time + rng.uniform(0, 6))
    late = np.interp(time - 0.05, time, drive)
    angles = np.column_stack([0.8 * drive - 0.1 * force + 0.3, 0.5 * late + 0.05 * force])
    angles += 1e-3 * rng.normal(size=angles.shape)
    angles[: count // 10, 1] = np.nan
    nothing = np.zeros((count, 0))
    readings = np.column_stack([drive, force])
    return Samples(time, readings, nothing, angles, np.zeros((count, 2)))


def by_hand(name: str, training: list[Samples], test: Samples) -> float:
    def phi(log: Samples) -> Any:
        t, y = log.time, log.readings
        columns = [np.ones(len(t)), *y.T]
        if "lags" in name:
            columns += [np.interp(t - lag, t, c) for lag in LAGS for c in y.T]
        return np.column_stack(columns)

    squares = []
    for j in range(2):
        known = [np.isfinite(log.targets[:, j]) for log in training]
        a = np.vstack([phi(log)[k] for log, k in zip(training, known)])
        b = np.concatenate([log.targets[k, j] for log, k in zip(training, known)])
        error = phi(test) @ np.linalg.pinv(a) @ b - test.targets[:, j]
        squares.append(error[np.isfinite(error)] ** 2)
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def test_a_yardstick_is_ordinary_least_squares_and_lags_find_a_lag() -> None:
    logs = [log_of(1), log_of(2)], log_of(3)
    found = {name: yardstick_error(name, *logs) for name in YARDSTICKS}
    for name, error in found.items():
        assert error == pytest.approx(by_hand(name, *logs), rel=1e-6)
    assert found["least squares with lags"] < 0.5 * found["least squares"]


def test_an_angle_that_is_known_nowhere_has_no_error() -> None:
    log = log_of(1)
    unknown = replace(log, targets=np.full_like(log.targets, np.nan))
    assert np.isnan(yardstick_error("least squares", [unknown], log))
