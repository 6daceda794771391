"""A simulated finger between two tendons that may be pushed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from distal import Log, Rig, load_rig, simulate
from distal.simulation import build_scenario

PUSH = 0.07
"""Torque of the push [N m]."""


def finger_rig() -> Rig:
    """Return a finger between two tendons with load cells, as its user knows it."""
    return load_rig(Path(__file__).with_name("pushed_finger.toml"))


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
