"""References as they come: held until their next sample, late, or away for some frames."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from distal import Rig, read_log
from distal.errors import DistalWarning
from distal.logs import held_samples, jumps_away

TIME = np.arange(0.0, 8.0, 0.01)
ANGLE = 0.6 * np.sin(2.0 * TIME) + 0.1 * np.sin(5.3 * TIME + 1.0)


def held(values: np.ndarray, rate: float) -> np.ndarray:
    """Return a sensor's values of a rate [Hz] in each row, held until the next one."""
    first = np.searchsorted(TIME, np.floor(TIME * rate + 1e-9) / rate - 1e-9)
    return values[first]


def test_a_held_sample_counts_once_and_a_rounded_one_always() -> None:
    assert np.mean(held_samples(held(ANGLE, 30.0))) == pytest.approx(0.7, abs=0.02)
    noise = np.random.default_rng(4).normal(0.0, 0.003, len(ANGLE))
    for values, steps in ((ANGLE, (1e-9, 0.001, 0.02)), (ANGLE + noise, (0.0005, 0.002, 0.006))):
        for step in steps:
            rounded = np.round(values / step) * step
            assert not held_samples(rounded).any()
            assert held_samples(held(rounded, 30.0)).any()
    assert not held_samples(np.full(50, 1.0)).any()
    assert not held_samples(np.array([np.nan, 1.0])).any()


@pytest.mark.parametrize("frames", [1, 3, 12])
def test_a_marker_that_is_seen_the_wrong_way_round_is_missing(frames: int) -> None:
    values = ANGLE + np.random.default_rng(1).normal(0.0, 1e-3, len(ANGLE))
    wrong = np.zeros(len(values), dtype=bool)
    for begin in (70, 210, 555):
        wrong[begin : begin + frames] = True
    np.testing.assert_array_equal(jumps_away(np.where(wrong, -values, values)), wrong)
    assert not jumps_away(values).any()
    steps = np.repeat(np.random.default_rng(2).normal(0.0, 0.3, 80), 10)
    assert not jumps_away(steps).any()


def test_a_log_with_a_late_held_camera_is_compared_as_it_was_seen(pulley_rig: Rig) -> None:
    """By the `delay` of the rig's reference sensor, which the source of the truth says."""
    camera = {"name": "camera", "measures": "angle", "of": pulley_rig.joint_names[0], "delay": 0.04}
    sensors = [*(sensor.model_dump() for sensor in pulley_rig.sensors), camera]
    rig, k = pulley_rig.with_values({"sensors": sensors}), np.arange(len(TIME))
    readings = held(np.interp(TIME - 0.04, TIME, ANGLE), 25.0)
    values = (
        TIME,
        1e-3 + 1e-5 * k,
        1e-3 - 1e-5 * k,
        2 + 0.1 * (k % 7),
        2 + 0.1 * (k % 5),
        readings,
    )
    frame = pl.DataFrame(dict(zip(("t", "x1", "x2", "u1", "u2", "camera"), values)))
    log = read_log(frame, rig)
    known = np.isfinite(log.truth["theta"])
    assert np.mean(known) == pytest.approx(0.25, abs=0.02)
    assert "40 ms late" in str(log.truth_source)
    error = log.truth["theta"][known] - ANGLE[known]
    assert np.sqrt(np.mean(error[2:-2] ** 2)) < 5e-3  # a straight line between 25 samples a second
    readings[300:308] *= -1.0
    with pytest.warns(DistalWarning, match="camera jumps away and back 1 times, to its mirror"):
        log = read_log(frame.with_columns(camera=readings), rig)
    assert not np.isfinite(log.truth["theta"][296:304]).any()
