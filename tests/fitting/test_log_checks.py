"""Calibration logs in which drives are held are logs like others; a sensor that is dead is not."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from distal import Log, Rig, estimate, load_rig
from distal.errors import FitError
from distal.fitting.log_checks import check_logs
from distal.rig import build_rig
from tests.support.rough_plants import described, log_of


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


@pytest.mark.parametrize("source", ["", "column 'encoder'"])
def test_a_truth_of_the_wrong_sign_is_named_with_where_it_is_from(source: str) -> None:
    """A log built in Python may not say where: then nothing stands in brackets."""
    rig = load_rig("template")
    time = np.arange(0.0, 10.0, 0.01)
    stroke, arm = 3e-3 * np.sin(time), 0.01
    channels = {"x1": stroke, "x2": -stroke, "u1": 20.0 + 0 * time, "u2": 20.0 + 0.1 * stroke}
    log = Log(time, channels, {"theta": -stroke / arm}, "mine.csv", truth_source=source)
    named = f" ({source})" if source else ""
    with pytest.raises(
        FitError,
        match=re.escape(f"mine.csv: the truth of the joint{named} moves against the drives")
        + ".*a sign is wrong: turn that of the angle sensor or",
    ):
        check_logs([replace(log, channels={**channels, "u1": 20.0 + stroke})], rig)


@pytest.mark.parametrize("dead", [("tau0",), ("phi1",)])
def test_a_sensor_that_never_changes(rig: Rig, dead: tuple[str, ...]) -> None:
    """In no log, or, of a force, while its drive moves."""
    one, whole = log_of("held", 0, 0), log_of("held", 0, 3)
    with pytest.raises(FitError, match=f"sensor '{dead[0]}' is constant .* is it connected"):
        check_logs([held(one, *dead), held(whole, *dead) if dead == ("phi1",) else whole], rig)


def of_a_motor() -> tuple[Log, Rig]:
    """Return a log of a capstan's joint that is where its drive says, and the rig."""
    rig = load_rig("capstan-joint")
    time = np.arange(0.0, 4.0, 0.01)
    motor = 0.5 * np.sin(2 * np.pi * 0.5 * time)
    log = Log(time, {"motor_angle": motor, "motor_torque": 0.01 + 1e-4 * np.sin(time)})
    return replace(log, truth={"theta": estimate(log, rig, "elastic").theta}), rig


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
    log, rig = of_a_motor()
    with pytest.raises(FitError, match=said):
        check_logs([replace(log, truth={"theta": factor * log.truth["theta"]})], rig)


def test_of_a_chain_the_joint_with_the_wrong_sign_is_named() -> None:
    from distal.simulation import load_scenario, scenario_rig, simulate_plant

    scenario = load_scenario("finger")
    log = simulate_plant(scenario_rig(scenario), scenario, 1)
    check_logs([log], scenario_rig(scenario))
    turned = replace(log, truth={**log.truth, "theta_pip": -log.truth["theta_pip"]})
    with pytest.raises(FitError, match=r"the truth of the joint pip .* moves against the drives"):
        check_logs([turned], scenario_rig(scenario))


def test_a_truth_may_have_another_zero() -> None:
    """Only how it moves is compared: an encoder that reads 170° at the drives' zero is no wrong
    truth.
    """
    log, rig = of_a_motor()
    check_logs([replace(log, truth={"theta": log.truth["theta"] + 3.0})], rig)


def test_a_truth_without_values_is_refused_where_it_is_the_only_joints() -> None:
    """Of several joints one may be unknown in a log; of one joint a truth that is nowhere known is
    a mistake.
    """
    log, rig = of_a_motor()
    for known, said in ((0, "has 0 values; at least 10 are needed"), (9, "has 9 values")):
        few = np.where(np.arange(len(log)) < known, 0.1, np.nan)
        with pytest.raises(FitError, match=said):
            check_logs([replace(log, truth={"theta": few})], rig)


def test_signs_of_joints_that_fewer_drives_cannot_tell_apart() -> None:
    """Two drives, three joints: the least angles that explain the drives, θ = Rᵀ (R Rᵀ)⁻¹ s, turn
    pip against its known angle, though the known angles move both tendons as they are read.
    """
    arms = {"one": {"mcp": 10, "dip": 18}, "two": {"mcp": -15, "pip": -6}}
    raw: dict[str, Any] = {
        "name": "shared",
        "log": {"time": {"column": "t", "unit": "s"}},
        "joints": [
            {"name": name, "parent": "base", "inertia": "1e-5 kg m^2", "initial": "0 deg"}
            for name in ("mcp", "pip", "dip")
        ],
        "drives": [{"name": name, "kind": "slider", "mass": "20 g"} for name in arms],
        "tendons": [
            {
                "name": name,
                "drive": name,
                "crossings": [
                    {
                        "joint": joint,
                        "kind": "pulley",
                        "radius": f"{abs(arm)} mm",
                        "side": int(np.sign(arm)),
                    }
                    for joint, arm in crossed.items()
                ],
                "stiffness": "20 N/mm",
            }
            for name, crossed in arms.items()
        ],
        "sensors": [
            {"name": f"x_{name}", "measures": "position", "of": name, "unit": "m", "noise": "1 um"}
            for name in arms
        ],
    }
    rig = build_rig(raw, "shared")
    time = np.arange(0.0, 5.0, 0.01)
    wave = 0.5 * np.sin(time)
    angles = {"theta_mcp": -0.3 * wave, "theta_pip": wave, "theta_dip": wave}
    read = {
        f"x_{name}": 1e-3 * sum(arm * angles[f"theta_{joint}"] for joint, arm in crossed.items())
        for name, crossed in arms.items()
    }
    check_logs([Log(time, read, angles)], rig)
    with pytest.raises(FitError, match="the truth of the joint pip moves against the drives"):
        check_logs([Log(time, {**read, "x_two": -read["x_two"]}, angles)], rig)
