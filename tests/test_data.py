"""Logs that another simulator made: the main job on input that nobody here simulated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from distal import ESTIMATORS, estimate, load_rig, read_log

# bounds: what is measured (see docs/estimators.md) rounded up by a quarter; worse is a regression
SERVO = {
    "adaptive": 0.35,
    "inextensible": 11.5,
    "elastic": 1.1,
    "ekf-2008": 0.85,
    "ekf": 0.38,
}
HAND = {
    "adaptive": 5.5,
    "inextensible": 6.0,
    "elastic": 6.5,
    "ekf-2008": 5.5,
    "ekf": 5.5,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", tuple(name for name in ESTIMATORS if name != "affine"))  # no log of this rig before it
@pytest.mark.parametrize(("log", "bounds"), [("servo", SERVO), ("hand", HAND)])
def test_every_estimator_runs_on_the_mujoco_logs(data: Path, name: str, log: str, bounds: dict[str, float]) -> None:
    folder = data / "mujoco_rig"
    rig = load_rig("pulley-antagonist")
    read = read_log(folder / f"mujoco_tension_{log}.csv", rig, folder / f"mujoco_tension_{log}.truth.csv")
    result = estimate(read, rig, name)
    assert len(result) == 1200
    assert np.rad2deg(result.rms_error()) < bounds[name]


@pytest.mark.parametrize(
    ("friction", "bound"), [(0.15, 1.75), ({"value": 0.05, "std": 0.15}, 2.0)], ids=["given", "hardly known"]
)
def test_adaptive_follows_a_hand(data: Path, friction: object, bound: float) -> None:
    """The project's goals, with a torque that nobody measures and sheath friction given or hardly known."""
    folder = data / "mujoco_rig"
    values = {"drives.0.friction.load": friction, "drives.1.friction.load": friction}
    rig = load_rig("pulley-antagonist").with_values({**values, "joints.0.external_torque.std": "0.1 N m"})
    read = read_log(folder / "mujoco_tension_hand.csv", rig, folder / "mujoco_tension_hand.truth.csv")
    result = estimate(read, rig, "adaptive")
    assert np.rad2deg(result.rms_error()) < bound
    assert result.inside_band() >= 0.88
    assert 1.96 * result.theta_std.mean() < 4.0 * result.rms_error()  # and not by width alone


def test_adaptive_servo(data: Path) -> None:
    folder = data / "mujoco_rig"
    rig = load_rig("pulley-antagonist")
    read = read_log(folder / "mujoco_tension_servo.csv", rig, folder / "mujoco_tension_servo.truth.csv")
    result = estimate(read, rig, "adaptive")
    assert np.rad2deg(result.rms_error()) < 0.35
    assert result.inside_band() >= 0.88
