"""A simulated finger between two tendons that may be pushed."""

from __future__ import annotations

from typing import Any

import numpy as np

from distal import Log, Rig, simulate
from distal.rig import build_rig
from distal.simulation import build_scenario

PUSH = 0.07
"""Torque of the push [N m]."""


def finger_rig() -> Rig:
    """Return a finger between two tendons with load cells, as its user knows it."""
    drives, tendons, sensors = [], [], []
    for name, side in (("flexor", 1), ("extensor", -1)):
        drives.append(
            {
                "name": name,
                "kind": "slider",
                "mass": "50 g",
                "damping": "2 kg/s",
                "nominal_force": {"value": 6.0, "std": 3.0},
                "friction": {"load": {"value": 0.02, "std": 0.01}},
            }
        )
        tendons.append(
            {
                "name": name,
                "joint": "finger",
                "drive": name,
                "side": side,
                "damping": "0.5 N s/m",
                "insertion": {"kind": "pulley", "radius": "9 mm"},
                "stiffness": {"value": "5e3 N/m", "std": "10 %"},
            }
        )
        sensors += [
            {
                "name": f"x_{name}",
                "measures": "position",
                "of": name,
                "noise": "5 um",
                "linearity": "0.03 mm",
                "rate": 200.0,
            },
            {"name": f"u_{name}", "measures": "force", "of": name, "noise": "0.1 N", "rate": 200.0},
        ]
    raw: dict[str, Any] = {
        "name": "finger with load cells",
        "joints": [
            {
                "name": "finger",
                "inertia": "3e-5 kg m^2",
                "damping": "1e-3 N m s",
                "initial": {"value": 0.0, "std": "5 deg"},
                "friction": {
                    "coefficient": {"value": 0.15, "std": 0.05},
                    "radius": "1.5 mm",
                    "preload": "2 N",
                },
                "external_torque": {"std": "0.03 N m", "correlation_time": "1 s"},
            }
        ],
        "drives": drives,
        "tendons": tendons,
        "sensors": sensors,
    }
    return build_rig(raw, "finger")


def finger(seed: int, duration: float, pushed: float | None) -> tuple[Log, Rig]:
    """Return a log of a finger that is turned to and fro, pushed for 3 s from `pushed` on; and its
    rig.
    """
    rng = np.random.default_rng([seed, 71])
    time, position, arm, rig = 0.0, 0.0, 9e-3, finger_rig()
    squeeze = 1.2e-3
    turns: dict[str, list[list[str]]] = {
        name: [["0 s", f"{squeeze} m"]] for name in ("flexor", "extensor")
    }
    while time < duration:
        aim = float(rng.uniform(-0.6, 0.6))
        for wait in (
            abs(aim - position) / rng.uniform(0.3, 1.0) + 0.05,
            float(rng.uniform(0.3, 1.5)),
        ):
            time += wait
            for name, side in (("flexor", 1), ("extensor", -1)):
                turns[name].append([f"{time:.3f} s", f"{squeeze + side * arm * aim:.6f} m"])
        position = aim
    raw: dict[str, Any] = {"rig": "finger", "duration": f"{duration} s", "plant": {}}
    raw["drives"] = {
        name: {"servo": {"position": turn, "stiffness": "5e4 N/m"}} for name, turn in turns.items()
    }
    drawn = {"joints.0.friction.coefficient": (0.15, 0.05)} | {
        f"tendons.{i}.stiffness": (5e3, 500.0) for i in (0, 1)
    }
    for path, (value, std) in drawn.items():
        raw["plant"][path] = value + std * float(np.clip(rng.normal(), -2, 2))
    if pushed is not None:
        sign = float(rng.choice([-1.0, 1.0]))
        steps = [
            ["0 s", "0 N m"],
            [f"{pushed} s", f"{sign * PUSH} N m"],
            [f"{pushed + 3.0} s", "0 N m"],
        ]
        raw["joints"] = {rig.joints[0].name: {"torque": steps}}
    return simulate(rig, build_scenario(raw), seed), rig
