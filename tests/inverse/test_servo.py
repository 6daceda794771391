"""Servos that give way: what logs with goals tell of them, and what is sent so that they do not
matter.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from distal import Inverse, LiveInverse, Log, Rig, load_rig, read_log
from distal.from_logs.drive_and_tendon_sizes import servos_of
from distal.logs import write_log

STIFFNESS, DEAD_BAND = 1.7, 0.006


def servo_rig(**servo: object) -> Rig:
    """Return a motor at a joint, with a servo."""
    rig = load_rig("capstan-joint")
    return rig.with_values({f"drives.{rig.drives[0].name}.servo": {"goal": "sent", **servo}})


def log_of(rig: Rig, seed: int = 1) -> Log:
    """Return a log of such a servo: u = F/K + δ d + T ds/dt + s."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 20.0, 0.01)
    position, force = np.sin(0.9 * time), 0.05 * np.cos(1.7 * time) + 0.02
    speed = np.gradient(position, time)
    goal = position + force / STIFFNESS + DEAD_BAND * np.sign(speed) + 0.03 * speed
    names = {sensor.measures: sensor.name for sensor in rig.sensors}
    read = {
        names["position"]: position + 1e-4 * rng.normal(size=len(time)),
        names["force"]: force + 1e-3 * rng.normal(size=len(time)),
    }
    return Log(time, read, {}, "servo", goals={rig.drives[0].name: goal})


def test_stiffness_and_dead_band_are_found_where_goals_are_logged() -> None:
    rig = servo_rig()
    found = servos_of([log_of(rig), log_of(rig, 2)], rig)
    path = f"drives.{rig.drives[0].name}.servo"
    assert found[f"{path}.stiffness"] == pytest.approx(STIFFNESS, rel=0.03)
    assert found[f"{path}.dead_band"] == pytest.approx(DEAD_BAND, rel=0.1)
    log = log_of(rig)
    for little in (log.select(slice(50)), Log(log.time, log.channels)):
        assert servos_of([little], rig) == {}


def test_goals_are_read_and_written_in_the_column_that_the_rig_names(tmp_path: Path) -> None:
    rig = servo_rig()
    log, name = log_of(rig), rig.drives[0].name
    write_log(log, rig, tmp_path / "log.csv")
    assert "sent" in (tmp_path / "log.csv").read_text(encoding="utf-8").splitlines()[0]
    read = read_log(tmp_path / "log.csv", rig)
    np.testing.assert_allclose(read.goals[name], log.goals[name], rtol=1e-9)
    assert read.select(slice(5)).goals[name].shape == (5,)


def test_commands_are_further_by_what_a_servo_gives_way() -> None:
    """u − s = F/K + δ d, offline and live."""
    time = np.arange(0.0, 4.0, 0.01)
    angles = 0.3 * np.sin(1.5 * time)[:, None]
    stiff = Inverse(servo_rig(), compiled=False)(time, angles)
    soft = Inverse(servo_rig(stiffness=STIFFNESS), compiled=False)(time, angles)
    np.testing.assert_allclose(soft.sent - stiff.sent, stiff.forces / STIFFNESS, atol=1e-12)
    np.testing.assert_allclose(soft.positions, stiff.positions)
    dead = Inverse(servo_rig(dead_band=DEAD_BAND), compiled=False)(time, angles)
    moving = (np.abs(stiff.speeds) > 0.3) & (time > 0.5)[:, None]
    np.testing.assert_allclose(
        (dead.sent - stiff.sent)[moving], (DEAD_BAND * np.sign(stiff.speeds))[moving], atol=1e-3
    )
    live = [
        LiveInverse(rig, compiled=False) for rig in (servo_rig(), servo_rig(stiffness=STIFFNESS))
    ]
    for k in range(40):
        sample = np.zeros(len(live[0].channels))
        commands = [one.step(0.01 * k, [0.02], sample) for one in live]
    given = commands[1].positions - commands[0].positions
    np.testing.assert_allclose(given, commands[0].forces / STIFFNESS, atol=1e-9)
