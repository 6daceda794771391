"""A gear that the rig file lacks, or has too much, is named with its ratio."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from distal import Log, Rig, diagnose, estimate, load_rig, read_log, simulate
from distal.diagnosis.against_truth import causes
from distal.diagnosis.gears import out_of_reach
from distal.logs import write_log

ERROR = np.deg2rad(20.0)
"""What such gears make of the angle."""


@pytest.fixture(scope="module")
def rig() -> Rig:
    """The bench's rig, to whose file nobody wrote that the encoder is before a gear."""
    bench = load_rig("lab-bench")
    return bench.with_values(
        {"sensors.motor_angle.gear": 1.0, "sensors.motor_angle.resolution": "0.006 deg"}
    )


@pytest.fixture(scope="module")
def log() -> Log:
    return simulate("lab-bench", "lab-bench", 0).select(slice(0, 800))


def scaled(log: Log, factor: float) -> Log:
    return replace(
        log, channels={**log.channels, "motor_angle": factor * log.channels["motor_angle"]}
    )


@pytest.mark.parametrize(
    ("factor", "ratio", "said"),
    [
        (30.0, 30.0, "like a gear of about {} that the rig file does not have"),
        (7.0, 7.0, "like a gear of about {} that the rig file does not have"),
        (1 / 30.0, 30.0, "about {} times too small, as if a gear were taken off twice"),
    ],
)
def test_the_ratio_is_that_by_which_the_log_was_scaled(
    rig: Rig, log: Log, factor: float, ratio: float, said: str
) -> None:
    """To 5 %: friction and stretch are between motor and joint."""
    wrong = scaled(log, factor)
    found = diagnose(estimate(wrong, rig), wrong, rig)
    text = next(finding.text for finding in found.findings if finding.kind == "looks like")
    number = text.split("about ")[1].split()[0]
    assert text == f"motor_angle looks {said.format(number)}"
    assert float(number) == pytest.approx(ratio, rel=0.05)
    assert not found.consistent


@pytest.mark.parametrize("gear", [1, 15, 200])
def test_a_gear_that_is_wrong_in_the_rig_file(log: Log, tmp_path: Path, gear: int) -> None:
    """The log was written with 30:1, and the file says another one, or none."""
    bench = load_rig("lab-bench")
    write_log(log, bench, tmp_path / "log.csv")
    other = bench.with_values({"sensors.motor_angle.gear": gear})
    finding = causes(read_log(tmp_path / "log.csv", other), other, ERROR)[0]
    instead = "that the rig file does not have" if gear == 1 else f", where the rig file has {gear}"
    number = finding.text.split("about ")[1].split()[0].rstrip(",")
    assert finding.text == f"motor_angle looks like a gear of about {number} {instead}".replace(
        " ,", ","
    )
    assert float(number) == pytest.approx(30, rel=0.05)


def test_a_log_of_another_program(rig: Rig) -> None:
    """Motor and joint as a test of its own makes them: the joint lags behind by stretch, and the
    encoder is noisy.
    """
    rng, time = np.random.default_rng(0), np.arange(0.0, 8.0, 0.01)
    motor = 1.5 * np.sin(1.3 * time)
    tendon, drive = rig.tendons[0], rig.drives[0]
    assert drive.kind == "capstan"
    angle = motor * drive.radius.value / tendon.total_arm - 0.05 * np.sign(np.cos(1.3 * time))
    truth = {"theta": angle + np.deg2rad(0.1) * rng.normal(size=len(time))}
    channels = {"motor_angle": 19.0 * motor, "motor_torque": 0.1 * np.sin(2.9 * time)}
    finding = causes(Log(time, channels, truth), rig, ERROR)[0]
    assert (finding.kind, finding.subject) == ("looks like", "motor_angle")
    ratio = float(finding.text.split("about ")[1].split()[0])
    assert ratio == pytest.approx(19.0, rel=0.05)


def test_a_right_log_has_none(rig: Rig, log: Log) -> None:
    assert causes(log, rig, ERROR) == out_of_reach(log, rig) == []
    assert causes(replace(log, truth={}), rig, ERROR) == []
    still = {name: np.zeros(len(log)) for name in log.channels}
    assert causes(replace(log, channels=still), rig, ERROR) == []


def test_degrees_are_no_gear(rig: Rig, log: Log) -> None:
    assert causes(scaled(log, 57.29578), rig, ERROR)[0].text == "motor_angle looks like degrees"


def test_without_the_joints_angle_the_least_ratio_is_named(rig: Rig, log: Log) -> None:
    """The joint can turn between its stops: what the motor asks for beyond that is a gear's, or a
    unit's.
    """
    wrong = replace(scaled(log, 30.0), truth={})
    (finding,) = out_of_reach(wrong, rig)
    least = float(finding.text.split("gear of ")[1].split()[0])
    assert 2.0 < least < 30.0
    assert finding.text in [one.text for one in diagnose(estimate(wrong, rig), wrong, rig).findings]
