"""Least squares on the homing move sees that a rig is described wrong, and its line is then what is reported."""

from __future__ import annotations

import numpy as np
import pytest

from distal import Log, diagnose, estimate, estimate_batch, load_rig, simulate
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
    ours, line = (estimate(wrong, RIG, name, compiled=False, homing=HOMING) for name in ("adaptive", "affine"))
    assert any("least squares" in note for note in ours.notes)
    late = wrong.time - wrong.time[0] >= HOMING
    np.testing.assert_allclose(ours.angles[late], line.angles[late], atol=1e-6)
    np.testing.assert_allclose(ours.angle_stds[late], line.angle_stds[late], rtol=1e-6)


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
