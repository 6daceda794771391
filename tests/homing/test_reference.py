"""A reference that is known for a while: it is read until then, and only compared with
afterwards.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal import Log, Rig, at_known_angle, estimate, load_rig
from distal.errors import EstimationError
from distal.homing import homing_filter
from tests.support.plant_and_rig import logs_of, start_rig


def test_a_reference_helps_and_does_not_leak() -> None:
    """With homing the first second is known; what follows does not depend on the truth that is only
    compared with.
    """
    rig = start_rig()
    log = logs_of(rig, {"joints.0.friction.coefficient": 0.6}, 32, ("servo",), 6.0)[0]
    blind, homed = estimate(log, rig), estimate(log, rig, homing=1.0)
    first = log.time < 0.9
    assert np.max(homed.theta_std[first]) < 0.5 * np.max(blind.theta_std[first])
    assert np.isnan(homed.truth[first]).all()
    lying = {"theta": np.where(log.time < 1.0, log.truth["theta"], log.truth["theta"] + 1.0)}
    other = estimate(
        Log(log.time, log.channels, lying, log.source, log.truth_source), rig, homing=1.0
    )
    np.testing.assert_array_equal(homed.theta, other.theta)
    for name in ("inextensible", "elastic"):
        shifted = estimate(log, rig, name, homing=1.0)
        early = estimate(log, rig, name).theta[log.time < 1.0] - log.truth["theta"][log.time < 1.0]
        np.testing.assert_allclose(
            shifted.theta, estimate(log, rig, name).theta - early.mean(), atol=1e-12
        )


def stands_at_home() -> tuple[Log, Rig]:
    """A joint that stands at 0.2 rad for half a second and then moves; its prior says 0 ± 3°, and
    there is no encoder.
    """
    rig = start_rig()
    log = logs_of(rig, {}, 33, ("servo",), 4.0)[0]
    return Log(log.time, log.channels, {}, log.source), rig


def test_home_is_a_known_angle_without_an_encoder() -> None:
    """What it says within the window is the angle that was given, as sure as was said, and it knows
    no truth.
    """
    log, rig = stands_at_home()
    blind = estimate(log, rig)
    angle = float(blind.theta[5]) + 0.05
    for std, share in ((np.deg2rad(0.1), 0.9), (np.deg2rad(30.0), 0.0)):
        at_home, described = at_known_angle(log, rig, 0.1, angle, std)
        found = estimate(at_home, described, homing=0.1)
        moved = (found.theta[9] - blind.theta[9]) / 0.05
        assert (moved > share) if share else (abs(moved) < 0.3)
        assert found.truth is None or np.isnan(found.truth).all()
        assert "home" not in found.measured
    np.testing.assert_array_equal(
        estimate(at_home, rig).theta, blind.theta
    )  # without homing it is not read


def test_a_truth_is_still_compared_with_after_the_window() -> None:
    rig = start_rig()
    log = logs_of(rig, {}, 33, ("servo",), 2.0)[0]
    at_home, _ = at_known_angle(log, rig, 0.5, 0.1)
    early = log.time < 0.5
    np.testing.assert_array_equal(at_home.truth["theta"][early], np.full(early.sum(), 0.1))
    np.testing.assert_array_equal(at_home.truth["theta"][~early], log.truth["theta"][~early])


def test_home_angles_that_are_none() -> None:
    log, rig = stands_at_home()
    for angle, std in ((np.nan, 0.0), (1e6, 0.0), (0.0, -1.0), (0.0, np.inf)):
        with pytest.raises(EstimationError, match="a homing angle is at most"):
            at_known_angle(log, rig, 0.5, angle, std)


def test_where_a_joint_stands_is_known_exactly_unless_it_is_said_otherwise() -> None:
    """Only with a std is there an offset between that angle and the joint's own, and it begins with
    that std.
    """
    rig = load_rig("capstan-joint")
    assert not [
        name
        for name in homing_filter(rig, compiled=False).state_names
        if name.startswith("bias_home")
    ]
    estimator = homing_filter(rig, 0.02, compiled=False)
    (index,) = [i for i, name in enumerate(estimator.state_names) if name.startswith("bias_home")]
    assert estimator.states.stds[index] == pytest.approx(0.02)
    assert estimator.channels[-1] == "home"
