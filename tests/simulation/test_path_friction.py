"""Friction along a tendon's path, stiction and a varying moment arm, in simulated motion."""

from __future__ import annotations

import numpy as np
import pytest

from distal import Log, Rig, estimate, fit, load_rig, simulate
from distal.simulation import build_scenario

MU, WRAP = 0.12, 1.5


def moved(rig: Rig, seed: int = 1) -> Log:
    """Return a log with the link held by a firm hand while the left slider goes slowly to and
    fro.
    """
    servo = {
        "position": {"mean": 8e-3, "amplitude": 4e-3, "frequency": 0.2},
        "stiffness": 5e3,
        "damping": 5.0,
    }
    raw = {
        "rig": "pulley-antagonist",
        "duration": 10.0,
        "drives": {"left": {"servo": servo}, "right": {"force": 4.0}},
        "joints": {"link": {"hand": {"angle": 0.0, "stiffness": 500.0}}},
    }
    return simulate(rig, build_scenario(raw, "moved"), seed)


def test_the_drive_feels_the_capstan_equation() -> None:
    """Drawn in, U = T e^{μβ}; let out, U = T e^{−μβ}."""
    path = {"friction": MU, "wrap": WRAP}
    none = {f"drives.{i}.friction.load": {"value": 0.0, "std": 0.0} for i in (0, 1)}
    rig = load_rig("pulley-antagonist").with_values(
        {**none, "tendons.0.path": path, "drives.0.damping": 0.0}
    )
    log = moved(rig)
    speed = np.gradient(log.truth["position_left"], log.time)
    ratio = log.truth["force_left"] / log.truth["tension_left"]
    fast = np.abs(speed) > 2e-3
    assert np.median(ratio[fast & (speed > 0)]) == pytest.approx(np.exp(MU * WRAP), rel=5e-3)
    assert np.median(ratio[fast & (speed < 0)]) == pytest.approx(np.exp(-MU * WRAP), rel=5e-3)


@pytest.mark.slow
def test_it_is_found_from_a_log() -> None:
    """Forces and displacements of one log, link moved by the drives, tell the friction of the path
    to 5 %.
    """
    path = {"friction": {"value": 0.06, "std": 0.05}, "wrap": WRAP}
    sure = {f"drives.{i}.friction.load": {"value": 0.0, "std": 0.0} for i in (0, 1)}
    rig = load_rig("pulley-antagonist").with_values(
        {**sure, "tendons.0.path": path, "tendons.1.path": path}
    )
    servo = {"stiffness": 5e3, "damping": 5.0}
    swing = {"mean": 7e-3, "amplitude": 4e-3, "frequency": 0.3}
    raw = {
        "rig": "pulley-antagonist",
        "duration": 10.0,
        "plant": {f"tendons.{i}.path.friction": MU for i in (0, 1)},
        "drives": {
            "left": {"servo": {"position": swing, **servo}},
            "right": {"servo": {"position": {**swing, "amplitude": -4e-3}, **servo}},
        },
    }
    log = simulate(rig, build_scenario(raw, "swing"), 3)
    found = fit([log], rig, ("tendons.*.path.friction", "joints.0.friction.coefficient"))
    assert found["tendons.*.path.friction"].value == pytest.approx(MU, rel=0.05)
    assert estimate(log, found.rig).rms_error() < estimate(log, rig).rms_error()


def test_stiction_holds_longer() -> None:
    """With an excess of 0.5 a link breaks away at 1.5 times the load, and slides as it would
    without.
    """
    rig = load_rig("pulley-antagonist")
    sticky = rig.with_values({"joints.0.friction.stribeck": {"excess": 0.5, "speed": "2 deg/s"}})
    ramp = {"points": [[0.0, 4.0], [8.0, 7.0]], "interpolation": "linear"}
    raw = {
        "rig": "pulley-antagonist",
        "duration": 8.0,
        "drives": {"left": {"force": ramp}, "right": {"force": 4.0}},
    }
    starts = []
    for each in (rig, sticky):
        log = simulate(each, build_scenario(raw, "ramp"), 1)
        turned = np.abs(log.truth["theta"] - log.truth["theta"][0]) > np.deg2rad(0.5)
        pull = log.truth["force_left"][int(np.argmax(turned))]
        starts.append((pull - 4.0) / (pull + 4.0))  # load over what the friction grows with
    assert starts[1] / starts[0] == pytest.approx(1.5, rel=0.06)
