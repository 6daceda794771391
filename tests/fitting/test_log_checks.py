"""Calibration logs in which drives are held are logs like others; a sensor that is dead is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.strangers.rough_plants import described, log_of

from distal import Log, Rig, estimate, load_rig
from distal.errors import FitError
from distal.fitting.log_checks import check_logs
from distal.rig import build_rig


def held(log: Log, *names: str) -> Log:
    """Return a log in which some sensors do not change at all."""
    still = {name: np.full(len(log), log.channels[name][0]) for name in names}
    return replace(log, channels={**log.channels, **still})


@pytest.fixture(scope="module")
def rig() -> Rig:
    return build_rig(described("held", 0)[0], "wrist")


def test_a_drive_that_is_held_in_one_log_and_moves_in_another(rig: Rig) -> None:
    one, whole = log_of("held", 0, 0), log_of("held", 0, 3)
    check_logs([held(one, "phi1", "tau1"), whole], rig)
    check_logs([held(one, "phi1"), whole], rig)  # its motor still holds against the others


@pytest.mark.parametrize("dead", [("tau0",), ("phi1",)])
def test_a_sensor_that_never_changes(rig: Rig, dead: tuple[str, ...]) -> None:
    """In no log, or, of a force, while its drive moves."""
    one, whole = log_of("held", 0, 0), log_of("held", 0, 3)
    with pytest.raises(FitError, match=f"sensor '{dead[0]}' is constant .* is it connected"):
        check_logs([held(one, *dead), held(whole, *dead) if dead == ("phi1",) else whole], rig)


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (57.3, "degrees read as radians"),
        (15.0, "is the unit, or a radius, wrong"),
        (1 / 15.0, "is the unit, or a radius, wrong"),
        (1 / 57.3, "radians read as degrees"),
    ],
)
def test_a_truth_that_moves_too_far_or_too_little(factor: float, said: str) -> None:
    """A factor of about 57 is a unit; another one may be a radius too."""
    rig = load_rig("capstan-joint")
    time = np.arange(0.0, 4.0, 0.01)
    motor = 0.5 * np.sin(2 * np.pi * 0.5 * time)
    channels = {"motor_angle": motor, "motor_torque": np.full(len(time), 0.01) + 1e-4 * np.sin(time)}
    expected = estimate(Log(time, channels), rig, "elastic").theta
    with pytest.raises(FitError, match=said):
        check_logs([Log(time, channels, {"theta": factor * expected})], rig)


def test_a_truth_may_have_another_zero() -> None:
    """Only how it moves is compared: an encoder that reads 170° at the drives' zero is no wrong truth."""
    rig = load_rig("capstan-joint")
    time = np.arange(0.0, 4.0, 0.01)
    motor = 0.5 * np.sin(2 * np.pi * 0.5 * time)
    channels = {"motor_angle": motor, "motor_torque": np.full(len(time), 0.01) + 1e-4 * np.sin(time)}
    expected = estimate(Log(time, channels), rig, "elastic").theta
    check_logs([Log(time, channels, {"theta": expected + 3.0})], rig)
