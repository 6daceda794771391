"""Least squares on the homing move sees that a rig is described wrong, and its line is then what is
reported.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal import (
    Log,
    at_known_angle,
    diagnose,
    estimate,
    estimate_batch,
    load_rig,
    load_scenario,
    scenario_rig,
    simulate,
)
from distal.homing.apply import errors_last
from distal.homing.least_squares import line_is_better
from distal.simulation import build_scenario

HOMING = 2.0
RIG = load_rig("pulley-antagonist")


def run(radius: float, seed: int = 1) -> Log:
    """A log of a plant whose radius is other than the rig says."""
    arm = radius * RIG.tendons[0].insertion.radius.value
    left = {"weight": {"mean": "3 N", "amplitude": "1 N", "frequency": "0.5 Hz"}}
    raw = {"rig": RIG.name, "duration": 6.0, "drives": {"left": left, "right": {"weight": "3 N"}}}
    raw["plant"] = {f"tendons.{i}.insertion.radius": arm for i in (0, 1)}
    return simulate(RIG, build_scenario(raw, "stranger"), seed)


@pytest.fixture(scope="module")
def wrong() -> Log:
    return run(1.6)


def test_a_rig_that_is_wrong_says_what_least_squares_says(wrong: Log) -> None:
    ours, line = (
        estimate(wrong, RIG, name, compiled=False, homing=HOMING) for name in ("adaptive", "affine")
    )
    assert any("least squares" in note for note in ours.notes)
    late = wrong.time - wrong.time[0] >= HOMING
    np.testing.assert_allclose(ours.angles[late], line.angles[late], atol=1e-6)
    np.testing.assert_allclose(ours.angle_stds[late], line.angle_stds[late], rtol=1e-6)


def test_known_offsets_of_the_sensors_are_those_of_the_line(wrong: Log) -> None:
    """The filter takes known offsets off its drives' places, and a straight line of raw readings
    does not.
    """
    positions = [i for i, sensor in enumerate(RIG.sensors) if sensor.measures == "position"]
    rig = RIG.with_values({f"sensors.{i}.bias.value": 2e-3 for i in positions})
    ours, line = (
        estimate(wrong, rig, name, compiled=False, homing=HOMING) for name in ("adaptive", "affine")
    )
    assert any("least squares" in note for note in ours.notes)
    late = wrong.time - wrong.time[0] >= HOMING
    np.testing.assert_allclose(ours.angles[late], line.angles[late], atol=1e-6)


@pytest.mark.parametrize(
    ("sizes", "of_line", "surprise", "better"),
    [
        ([3.0], [1.0], [9.0], True),
        ([3.0], [1.0], [1.0], False),  # within its own band
        ([1.4], [1.0], [9.0], False),  # not clearly
        ([3.0, 1.0], [1.0, 1.0], [9.0, 1.0], True),
        ([3.0, 1.0], [1.0, 2.0], [9.0, 1.0], False),  # the line would spoil the other joint
        ([3.0, np.nan], [1.0, np.nan], [9.0, np.nan], True),  # one that is not known does not count
    ],
)
def test_what_decides(
    sizes: list[float], of_line: list[float], surprise: list[float], better: bool
) -> None:
    assert line_is_better(np.array(sizes), np.array(of_line), np.array(surprise)) == better


def test_with_a_map_errors_last_a_third_of_the_window_at_most_a_second() -> None:
    assert [errors_last(length) for length in (0.2, 1.5, 6.0)] == [0.1, 0.5, 1.0]


def test_such_a_run_is_diagnosed_like_others(wrong: Log) -> None:
    result = estimate(wrong, RIG, compiled=False, homing=HOMING)
    assert not diagnose(result, wrong, RIG, homing=HOMING, compiled=False).consistent


def test_a_rig_that_is_right_is_left_alone() -> None:
    result = estimate(run(1.0), RIG, compiled=False, homing=HOMING)
    assert not any("least squares" in note for note in result.notes)


@pytest.mark.slow
def test_a_batch_may_have_both(wrong: Log) -> None:
    """Runs side by side share a kernel; one that reports least squares has its own."""
    logs = [run(1.0), wrong, run(1.0, 2)]
    for one, log in zip(estimate_batch(logs, RIG, homing=HOMING), logs):
        alone = estimate(log, RIG, homing=HOMING)
        np.testing.assert_allclose(one.angles, alone.angles, rtol=1e-9, atol=1e-12)
        assert one.notes == alone.notes


def test_a_reference_that_stands_still_teaches_no_line() -> None:
    """The joint moves during the move while it is said to be at rest: the angle must not stand
    still with it.
    """
    scenario = load_scenario("template")
    rig = scenario_rig(scenario)
    log, homed = at_known_angle(simulate(rig, scenario, 1), rig, 0.5, 0.0, 0.02)
    result = estimate(log, homed, homing=0.5, compiled=False)
    assert np.ptp(result.theta) > np.deg2rad(20.0)
    assert result.theta_std[-1] > np.deg2rad(0.05)
