"""A reference that is known for a while: it is read until then, and only compared with
afterwards.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from distal import Log, Rig, at_known_angle, estimate, load_rig
from distal.errors import EstimationError
from distal.homing import homing_filter
from tests.support.plant_and_rig import logs_of, start_rig, without_truth


def test_a_reference_helps_and_does_not_leak(rig: Rig, log: Log) -> None:
    """With homing the first second is known; what follows does not depend on the truth that is only
    compared with.
    """
    blind, homed = estimate(log, rig), estimate(log, rig, homing=1.0)
    first = log.time < 0.9
    assert np.max(homed.theta_std[first]) < 0.5 * np.max(blind.theta_std[first])
    assert np.isnan(homed.truth[first]).all()
    early, truth = log.time < 1.0, log.truth["theta"]
    lying = replace(log, truth={"theta": np.where(early, truth, truth + 1.0)})
    np.testing.assert_array_equal(homed.theta, estimate(lying, rig, homing=1.0).theta)
    for name in ("inextensible", "elastic"):
        plain, shifted = (estimate(log, rig, name, homing=homing).theta for homing in (None, 1.0))
        offset = np.mean((plain - truth)[early])
        np.testing.assert_allclose(shifted, plain - offset, atol=1e-12)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return start_rig()


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    return logs_of(rig, {}, 33, ("servo",), 4.0)[0]


def test_home_is_a_known_angle_without_an_encoder(rig: Rig, log: Log) -> None:
    """What it says within the window is the angle that was given, as sure as was said, and it knows
    no truth.
    """
    log = without_truth(log)
    blind = estimate(log, rig)
    angle = float(blind.theta[5]) + 0.05
    for std, share in ((np.deg2rad(0.1), 0.9), (np.deg2rad(30.0), 0.0)):
        at_home, described = at_known_angle(log, rig, 0.1, angle, std)
        found = estimate(at_home, described, homing=0.1)
        moved = (found.theta[9] - blind.theta[9]) / 0.05
        assert (moved > share) if share else (abs(moved) < 0.3)
        assert found.truth is None or np.isnan(found.truth).all()
        assert "home" not in found.measured
    # without homing it is not read
    np.testing.assert_array_equal(estimate(at_home, rig).theta, blind.theta)


def test_a_truth_is_still_compared_with_after_the_window(rig: Rig, log: Log) -> None:
    at_home, _ = at_known_angle(log, rig, 0.5, 0.1)
    early = log.time < 0.5
    np.testing.assert_array_equal(at_home.truth["theta"][early], np.full(early.sum(), 0.1))
    np.testing.assert_array_equal(at_home.truth["theta"][~early], log.truth["theta"][~early])


def test_home_angles_that_are_none(rig: Rig, log: Log) -> None:
    for angle, std in ((np.nan, 0.0), (1e6, 0.0), (0.0, -1.0), (0.0, np.inf)):
        with pytest.raises(EstimationError, match="a homing angle is at most"):
            at_known_angle(log, rig, 0.5, angle, std)


def test_where_a_joint_stands_is_known_exactly_unless_it_is_said_otherwise() -> None:
    """Only with a std is there an offset between that angle and the joint's own, and it begins with
    that std.
    """
    rig = load_rig("capstan-joint")
    known, estimator = (homing_filter(rig, std, compiled=False) for std in (0.0, 0.02))
    assert "bias_home" not in known.state_names
    offset = estimator.state_names.index("bias_home")
    assert estimator.states.stds[offset] == pytest.approx(0.02)
    assert estimator.channels[-1] == "home"
