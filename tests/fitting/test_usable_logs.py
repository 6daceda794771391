"""Calibration logs in which drives are held are logs like others; a sensor that is dead is not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from distal import Log, Rig, estimate, load_rig
from distal.errors import EstimationError, FitError, LogError
from distal.fitting.usable_logs import check_logs
from tests.diagnosis.test_known_motion import TIME, angles_at, log_of


def held(log: Log, *names: str) -> Log:
    """Return a log in which some sensors do not change at all."""
    still = {name: np.full(len(log), log.channels[name][0]) for name in names}
    return replace(log, channels={**log.channels, **still})


@pytest.fixture(scope="module")
def finger() -> Rig:
    """Return a finger of four drives, for the logs of `log_of`."""
    return load_rig("finger-2n")


def test_a_drive_that_is_held_in_one_log_and_moves_in_another(finger: Rig) -> None:
    whole = log_of()
    check_logs([held(whole, "x_mcp_f", "F_mcp_f"), whole], finger)
    check_logs([held(whole, "x_mcp_f"), whole], finger)  # it still holds against the others


@pytest.mark.parametrize("dead", ["F_mcp_f", "x_mcp_f"])
def test_a_sensor_that_never_changes(finger: Rig, dead: str) -> None:
    """Of a force, while its drive moves, or in no log."""
    whole = log_of()
    other = held(whole, dead, "F_mcp_e") if dead == "x_mcp_f" else whole
    with pytest.raises(FitError, match=f"sensor '{dead}' is constant .* is it connected"):
        check_logs([held(whole, dead), other], finger)


def test_of_a_chain_the_joint_with_the_wrong_sign_is_named(finger: Rig) -> None:
    mcp, pip = angles_at(TIME).T
    check_logs([replace(log_of(), truth={"theta_mcp": mcp, "theta_pip": pip})], finger)
    turned = replace(log_of(), truth={"theta_mcp": mcp, "theta_pip": -pip})
    with pytest.raises(FitError, match="the truth of the joint pip moves against the drives"):
        check_logs([turned], finger)


@pytest.fixture(scope="module")
def motor() -> Rig:
    return load_rig("capstan-joint")


@pytest.fixture(scope="module")
def log(motor: Rig) -> Log:
    """Return a log of a capstan's joint that is where its drive says."""
    time = np.arange(0.0, 4.0, 0.01)
    angle = 0.5 * np.sin(2 * np.pi * 0.5 * time)
    read = {"motor_angle": angle, "motor_torque": 0.01 + 1e-4 * np.sin(time)}
    log = Log(time, read, source="mine.csv")
    return replace(log, truth={"theta": estimate(log, motor, "elastic").theta})


@pytest.mark.parametrize("source", ["", "column 'encoder'"])
def test_a_truth_of_the_wrong_sign_is_named_with_where_it_is_from(
    motor: Rig, log: Log, source: str
) -> None:
    """A log built in Python may not say where: then nothing stands in brackets."""
    named = f" ({source})" if source else ""
    said = re.escape(f"mine.csv: the truth of the joint{named} moves against the drives")
    with pytest.raises(
        FitError, match=said + ".*a sign is wrong: turn that of the angle sensor or"
    ):
        check_logs([replace(log, truth={"theta": -log.truth["theta"]}, truth_source=source)], motor)


@pytest.mark.parametrize(
    ("factor", "known", "said"),
    [
        # a factor of about 57 is a unit; another one may be a radius too
        (57.3, 400, "degrees read as radians"),
        (15.0, 400, "is the unit, or a radius, wrong"),
        (1 / 15.0, 400, "is the unit, or a radius, wrong"),
        (1 / 57.3, 400, "radians read as degrees"),
        (0.0, 400, "is constant while the drives move"),
        # of several joints one may be unknown in a log; of one joint that is a mistake
        (1.0, 0, "has 0 values; at least 10 are needed"),
        (1.0, 9, "has 9 values"),
    ],
)
def test_a_truth_that_cannot_be(motor: Rig, log: Log, factor: float, known: int, said: str) -> None:
    theta = np.where(np.arange(len(log)) < known, factor * log.truth["theta"], np.nan)
    with pytest.raises(FitError, match=said):
        check_logs([replace(log, truth={"theta": theta})], motor)


def test_a_draft_is_not_judged_by_its_own_sizes(motor: Rig, log: Log) -> None:
    """Its signs and sizes are those of these logs; a dead encoder is none of any rig."""
    far = replace(log, truth={"theta": -15.0 * log.truth["theta"]})
    check_logs([far], motor, drafted=True)
    with pytest.raises(FitError, match="is constant while the drives move"):
        check_logs([replace(log, truth={"theta": 0.0 * log.truth["theta"]})], motor, drafted=True)


def test_a_truth_may_have_another_zero(motor: Rig, log: Log) -> None:
    """Only how it moves is compared: an encoder that reads 170° at the drives' zero is no wrong
    truth.
    """
    check_logs([replace(log, truth={"theta": log.truth["theta"] + 3.0})], motor)


def test_a_position_without_a_value_is_named(motor: Rig, log: Log) -> None:
    empty = {**log.channels, "motor_angle": np.full(len(log), np.nan)}
    with pytest.raises(EstimationError, match="'motor_angle' has no value at all"):
        check_logs([replace(log, channels=empty)], motor)


def test_logs_that_tell_nothing(motor: Rig, log: Log) -> None:
    still = held(log, "motor_angle")
    with pytest.raises(FitError, match=r"mine\.csv: nothing moves"):
        check_logs([still], motor)
    with pytest.raises(FitError, match="holds the same as"):
        check_logs([log, log], motor)
    # what is no more than the noise of its sensor is no motion, however wide
    noisy = motor.with_values({"sensors.motor_angle.noise": "10 deg"})
    rest = np.random.default_rng(5).normal(0.0, np.deg2rad(10.0), len(log))
    with pytest.raises(FitError, match=r"mine\.csv: nothing moves"):
        check_logs([replace(log, channels={**log.channels, "motor_angle": rest})], noisy)


def test_stamps_in_milliseconds(motor: Rig, log: Log) -> None:
    with pytest.raises(LogError, match=r"stamps are 10 s apart.*unit"):
        check_logs([replace(log, time=1e3 * log.time)], motor)


def test_signs_of_joints_that_fewer_drives_cannot_tell_apart() -> None:
    """One drive, three joints: springs and drive say that dip turns with the others, and it turns
    back; all known angles together move the tendon as it is read.
    """
    rig = load_rig("finger-underactuated")
    time = TIME[:400]
    wave = 0.3 * np.sin(time)
    tension = 3.0 + np.cos(time)
    known = {"theta_mcp": wave, "theta_pip": wave, "theta_dip": -0.5 * wave}
    tendon = rig.tendons[0]
    way = sum(arm * known[f"theta_{joint}"] for joint, arm in tendon.arms().items())
    phi = (way + tension / tendon.stiffness.value) / 6e-3
    read = {"phi_flexor": phi, "tau_flexor": 6e-3 * tension}
    check_logs([Log(time, read, known)], rig)
    with pytest.raises(FitError, match="the truth of the joint mcp moves against the drives"):
        check_logs([Log(time, {**read, "phi_flexor": -phi}, known)], rig)
    degrees = {name: np.rad2deg(angles) for name, angles in known.items()}
    with pytest.raises(FitError, match="degrees read as radians"):
        check_logs([Log(time, read, degrees)], rig)
