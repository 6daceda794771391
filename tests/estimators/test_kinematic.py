from __future__ import annotations

import numpy as np
import pytest

from distal import Log, Rig, estimate, load_rig


def still_log(n: int = 50, **channels: np.ndarray) -> Log:
    base = {"x1": np.zeros(n), "x2": np.zeros(n), "u1": np.full(n, 2.0), "u2": np.full(n, 2.0)}
    return Log(0.01 * np.arange(n), {**base, **channels})


def test_it_is_the_ratio_on_a_pulley_from_the_initial_angle_on(
    pulley_rig: Rig,
) -> None:
    rig = pulley_rig.with_values({"joints.0.initial": "-25 deg"})
    x = 3e-3 + np.linspace(0, 4e-3, 50)
    result = estimate(still_log(x1=x, x2=0.01 - x), rig, "inextensible")
    np.testing.assert_allclose(result.theta, np.deg2rad(-25) + (x - x[0]) / 9.53e-3, rtol=1e-12)


def test_each_tendon_and_their_mean(paper_rig: Rig) -> None:
    """r sin θ = x nearly, for a pinned tendon; the mean is that of both."""
    x = np.linspace(0, 4e-3, 50)
    result = estimate(still_log(x1=x, x2=-0.5 * x), paper_rig, "inextensible")
    assert result.state_names == ("theta", "tendon_angle_left", "tendon_angle_right")
    np.testing.assert_allclose(np.sin(result.means[:, 1]) * 9.53e-3, x, atol=2e-5)
    np.testing.assert_allclose(result.means[:, 0], result.means[:, 1:].mean(axis=1), rtol=1e-12)


def test_elastic_removes_the_stretch(pulley_rig: Rig) -> None:
    """A held link, pulled harder: inextensible sees motion, elastic none once the low-pass has
    settled.
    """
    n = 200
    pull = np.where(np.arange(n) < 50, 2.0, 6.0)
    log = still_log(n, x1=pull / 806, u1=pull, x2=np.full(n, 2 / 806))
    rigid, elastic = (estimate(log, pulley_rig, name) for name in ("inextensible", "elastic"))
    assert np.rad2deg(rigid.theta[-1]) == pytest.approx(np.rad2deg(4 / 806 / 9.53e-3 / 2), rel=1e-6)
    assert abs(np.rad2deg(elastic.theta[-1])) < 1e-6


def test_elastic_on_a_capstan_shares_the_torque() -> None:
    """Torque M at radius R stretches one cable by M/(2Rk) and relaxes the other by as much."""
    rig = load_rig("capstan-joint")
    torque = np.where(np.arange(300) < 50, 0.0, 0.05)
    angle = torque / (2 * 5e-3 * 2.3e4) / 5e-3
    log = Log(0.005 * np.arange(300), {"motor_angle": angle, "motor_torque": torque})
    assert abs(np.rad2deg(estimate(log, rig, "elastic").theta[-1])) < 1e-4
    assert np.rad2deg(estimate(log, rig, "inextensible").theta[-1]) > 0.5


def test_std_of_what_it_knows(pulley_rig: Rig) -> None:
    result = estimate(still_log(), pulley_rig, "inextensible")
    sensor = np.hypot(5e-6, 0.6e-4)
    expected = np.sqrt(np.deg2rad(3.0) ** 2 + 2 * sensor**2 / 9.53e-3**2 / 2)
    assert result.theta_std[-1] == pytest.approx(expected, rel=1e-6)


def test_a_lost_sensor_leaves_the_other_tendon(pulley_rig: Rig) -> None:
    sensors = [sensor for sensor in pulley_rig.model_dump()["sensors"] if sensor["name"] != "x2"]
    rig, x = pulley_rig.with_values({"sensors": sensors}), np.linspace(0, 4e-3, 50)
    result = estimate(still_log(x1=x), rig, "inextensible")
    assert result.state_names == ("theta", "tendon_angle_left")
    np.testing.assert_allclose(result.theta, x / 9.53e-3, rtol=1e-12)
