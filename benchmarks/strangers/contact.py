"""A push on a simulated finger, seen."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from benchmarks.strangers.library import (
    Log,
    Rig,
    build_rig,
    build_scenario,
    estimate,
    simulate,
)
from benchmarks.strangers.scoring import Job, Record, Table
from distal import Estimate

NAME = "contact"
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


def contacts(result: Estimate) -> list[float]:
    """Return the times at which contacts with the first joint begin [s]: where the external torque
    exceeds five of its standard deviations, after it was below half of that.
    """
    stds = np.maximum(result.external_torque_stds[:, 0], 1e-300)
    ratio = np.abs(result.external_torques[:, 0]) / stds
    onsets = list[float]()
    touched = False
    for time, level in zip(result.time.tolist(), ratio.tolist()):
        if not touched and level > 5.0:
            onsets.append(time)
        touched = level > (2.5 if touched else 5.0)
    return onsets


def onset(seed: int) -> list[Record]:
    """Return how long after a push its onset is seen [ms], or how many are seen where there is
    none.
    """
    pushed = 3.0 + 0.37 * (seed % 7)
    log, rig = finger(seed, pushed + 3.5, pushed)
    result = estimate(log, rig)
    seen = [time for time in contacts(result) if time >= pushed]
    late = 1e3 * (seen[0] - pushed) if seen else float("inf")
    early = sum(0.5 < time < pushed for time in contacts(result))
    return [
        Record(
            NAME,
            "push of 0.07 N m",
            str(seed),
            "adaptive",
            min(late, 9999.0),
            float(late <= 100.0),
            early,
            None,
        )
    ]


def quiet(seed: int) -> list[Record]:
    """Return how many onsets are seen in a minute without any."""
    log, rig = finger(seed, 60.0, None)
    seen = [time for time in contacts(estimate(log, rig)) if time > 0.5]
    return [
        Record(
            NAME,
            "a minute without a push",
            str(seed),
            "adaptive",
            float(len(seen)),
            float(not seen),
            0.0,
            None,
        )
    ]


def jobs(quick: bool, first: int) -> list[Job]:
    """Return the jobs: 40 pushes, ten minutes without one."""
    made: list[Job] = [partial(onset, first + seed) for seed in range(8 if quick else 40)]
    made += [partial(quiet, first + 1000 + seed) for seed in range(2 if quick else 10)]
    return made


def tables(records: list[Record]) -> list[Table]:
    """Return the table of onsets."""
    found = list[Table]()
    onsets: dict[tuple[str, ...], tuple[float, ...]] = {}
    pushes = [one for one in records if one.case.startswith("push")]
    calm = [one for one in records if one.case.startswith("a minute")]
    if pushes and calm:
        lates = [one.rms for one in pushes]
        onsets[("finger",)] = (
            float(len(pushes)),
            100.0 * float(np.mean([one.inside for one in pushes])),
            float(np.median(lates)),
            float(len(calm)),
            sum(one.rms for one in calm) + sum(one.half for one in pushes),
        )
        heads = (
            ("pushes", 0),
            ("seen within 0.1 s [%]", 0),
            ("median delay [ms]", 0),
            ("minutes without", 0),
            ("false onsets", 0),
        )
        found.append(
            Table(
                f"strangers-{NAME}-onset",
                "a push of 0.07 N m on a simulated finger",
                ("rig",),
                heads,
                onsets,
            )
        )
    return found
