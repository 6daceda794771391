"""A filter and readings alone share the answer by their variances."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from distal import Log, Rig
from distal.errors import CommandError
from distal.estimators import RegressionEstimator, make_estimator, usual_estimator
from distal.fitting.candidates import Candidate, answer_maps
from distal.fitting.learned_maps import HeldOut, MapFit, answering, pooled
from distal.regression import Samples
from distal.rig import check_scales
from tests.learned_maps import drawn_map

TIME = np.arange(4.0)


def held_out(errors: float, variance: float, first: int = 0) -> HeldOut:
    time = TIME[first:]
    return HeldOut(time, np.full(len(time), errors), np.full(len(time), variance))


@pytest.fixture
def line(pulley_rig: Rig) -> MapFit:
    """Readings alone, which err by 0.2 on one log and by 0.4 on another."""
    joint = pulley_rig.joint_names[0]
    channels = tuple(sensor.name for sensor in pulley_rig.sensors[:2])
    learned = drawn_map((joint,), channels, False)
    errors = {joint: [held_out(0.2, 0.04), held_out(-0.4, 0.09)]}
    return MapFit("readings", (learned,), pulley_rig, errors)


def test_shares_go_by_variances_and_the_band_by_the_pool(line: MapFit) -> None:
    """0.01 beside 0.04 and 0.09: the filter has 0.8 of the angle on one log, 0.9 on the other."""
    joint = line.start.joint_names[0]
    learned = drawn_map((joint,), line.maps[0].channels)
    errors = {joint: [held_out(0.1, 0.01, 1), held_out(0.2, 0.01, 1)]}
    beside = MapFit("filter", (learned,), line.start, errors)
    of_log = Samples(TIME, np.zeros((4, 2)), np.zeros((4, 1)), np.zeros((4, 1)), np.ones((4, 1)))
    target = np.full((4, 1), np.sqrt(0.3))
    target[0] = np.nan  # the filter's first seconds do not count
    data = {i: replace(of_log, targets=target) for i in range(2)}
    # the encoder's own offset, 0.05, is off the filter's targets
    truth = {"theta": np.full(4, 0.05 + np.sqrt(0.3))}
    channels = {sensor.name: np.zeros(4) for sensor in line.start.sensors}
    logs = [Log(TIME, channels, truth)] * 2
    alone, both = pooled(beside, line, data, logs)
    assert alone.maps[0].answers
    moved = line.maps[0].arrays["mean"] - alone.maps[0].arrays["mean"]
    np.testing.assert_allclose(moved[:, 0], 0.05)
    np.testing.assert_array_equal(moved[:, 1:], 0.0)
    for log, a, b, spread, w in zip(
        both.errors[joint], (0.1, 0.2), (0.2, -0.4), (0.04, 0.09), (0.8, 0.9)
    ):
        np.testing.assert_array_equal(log.time, TIME[1:])
        np.testing.assert_allclose(log.errors, w * a + (1 - w) * b)
        square = w * (0.01 + a**2) + (1 - w) * (spread + b**2)
        np.testing.assert_allclose(log.variances, square - (w * a + (1 - w) * b) ** 2)
    assert both.maps[0].rms == pytest.approx((np.sqrt((0.12**2 + 0.14**2) / 2),))


def test_without_a_filter_readings_alone_answer(line: MapFit) -> None:
    """In every command, and what moves a motor is refused."""
    options = SimpleNamespace(homing=None)
    training = SimpleNamespace(rig=line.start, options=options, groups=("0", "1"))
    nothing = Candidate("none", line.start, None, False, np.inf, {})
    (alone,) = answer_maps(nothing, training, line)
    assert alone.maps[0].answers
    rig = line.start.with_map(readings=alone.maps)
    assert usual_estimator(rig) == "regression"
    assert isinstance(make_estimator(None, rig, compiled=False), RegressionEstimator)
    with pytest.raises(CommandError, match="could not follow the logs"):
        check_scales(rig, "a command", "torque")
    beside = rig.with_map(filter=[drawn_map(alone.maps[0].joints, alone.maps[0].channels)])
    assert usual_estimator(beside) == "adaptive"
    assert (
        usual_estimator(line.start.with_map(readings=line.maps)) == "adaptive"
    )  # no fit said that they answer


def test_one_log_teaches_no_correction_of_a_filter(line: MapFit) -> None:
    options = SimpleNamespace(homing=None)
    training = SimpleNamespace(rig=line.start, options=options, groups=("0",))
    ran = Candidate("first", line.start, None, False, np.inf, {0: None})  # type: ignore[dict-item]
    assert answer_maps(ran, training, line) == (line,)
    shared = answering(line, {})
    rig = line.start.with_map(readings=shared.maps)
    assert rig.map is not None
    assert not rig.map.pooled
