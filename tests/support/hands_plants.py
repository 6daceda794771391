"""Two rigs as labs have them, with several of the commonest physics at once; the plants share no
code with `distal.model`.

`bowden_log`: a finger pulled by one cable in a Bowden sheath against an extension spring, slack at
home, a motor with a gear of 50:1 whose current cogs, its encoder in counts. `ropes_log`: two motors
with load cells pull a joint by ropes that creep, with backlash between encoders and spools. The
joints are quasi-static with dry friction of their own; cables are of `tests/support/cable.py`.
"""

from __future__ import annotations

from functools import cache
from math import cos, exp, pi, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal import Log, Rig
from distal.logs import FROM_SENSOR, TruthSource
from distal.rig import build_rig
from tests.support.cable import Cable

Floats = NDArray[np.float64]

RATE, DURATION = 100.0, 30.0

SPOOL, ARM, STIFFNESS, SLACK = 8e-3, 9.5e-3, 6000.0, 0.45e-3
LOW, HIGH = 0.0, 1.45
"""Stops of the finger [rad]."""
COUNTS, GEAR, TORQUE_CONSTANT = 2000, 50.0, 0.012
"""Of the motor: counts per turn of its own shaft, its turns for one of the spool, N m/A at its own
shaft.
"""
PLANT = TruthSource(position="the plant")
OFFSET = np.deg2rad(0.15)
"""Of the encoder at the joint in calibration logs."""


def ramps(rng: np.random.Generator, low: float, high: float, duration: float) -> Floats:
    """Return ramps between random places, with rests, smoothed over 0.2 s, (k,)."""
    count = round(duration * RATE)
    positions = [low + (high - low) * 0.1]
    while len(positions) < count + 200:
        aim, speed = rng.uniform(low, high), rng.uniform(0.25, 1.2)
        steps = max(2, round(abs(aim - positions[-1]) / speed * RATE))
        positions += list(np.linspace(positions[-1], aim, steps))[1:]
        positions += [aim] * int(rng.integers(20, 100))
    kernel = np.hanning(21)
    smooth: Floats = np.convolve(np.array(positions), kernel / kernel.sum(), mode="valid")[:count]
    return smooth


def hand(rng: np.random.Generator, size: float, duration: float) -> Floats:
    """Return the torque of a hand that pushes now and then, (k,) [N m]."""
    count = round(duration * RATE)
    push = np.zeros(count)
    at = 200
    while at < count - 100:
        length = int(rng.integers(80, 300))
        push[at : at + length] = rng.uniform(-size, size)
        at += length + int(rng.integers(100, 400))
    kernel = np.hanning(31)
    smooth: Floats = np.convolve(push, kernel / kernel.sum(), mode="same")
    return smooth


def spring_torque(angle: float) -> float:
    """Return the torque of the finger's extension spring: between a point of the link and one of
    the base [N m].
    """
    radius, distance, stiffness, free, preload, line = 8e-3, 24e-3, 320.0, 16.5e-3, 0.5, -0.75
    x, y = radius * cos(angle - line) - distance, radius * sin(angle - line)
    length = sqrt(x * x + y * y)
    force = max(preload + stiffness * (length - free), 0.0)
    return -force * radius * distance * sin(angle - line) / length


def turned(cable: Cable, drive: float, angle: float, extra: float, friction: float) -> float:
    """Return where the finger comes to rest: tension, spring, stops and `extra` in balance but for
    friction.
    """

    def net(at: float) -> float:
        _, tension = cable.tensions(drive, SLACK + ARM * at)
        total = tension * ARM + spring_torque(at) + extra
        return total - 6.0 * max(at - HIGH, 0.0) - 6.0 * min(at - LOW, 0.0)

    for _ in range(12):
        now = net(angle)
        left = max(now - friction, 0.0) + min(now + friction, 0.0)
        if abs(left) < 1e-6:
            break
        slope = (net(angle + 1e-5) - now) / 1e-5
        angle -= left / min(slope, -0.01)
    return angle


@cache
def bowden_log(seed: int, kind: str, duration: float = DURATION) -> Log:
    """Return a log of the finger: kind ``ramps``, ``calibration``, ``stops`` or ``hand``."""
    rng = np.random.default_rng([seed, 61])
    reach = (0.12, 1.65) if kind not in ("stops",) else (-0.05, 2.0)
    turn = ramps(rng, *reach, duration)
    extra = hand(rng, 0.03, duration) if kind == "hand" else np.zeros(len(turn))
    cable, angle = Cable(STIFFNESS, 0.12, 3.0), 0.0
    angles, torques, parts = np.empty(len(turn)), np.empty(len(turn)), 2
    before = turn[0]
    for k, position in enumerate(turn):
        for part in range(parts):
            drive = SPOOL * (before + (position - before) * (part + 1) / parts)
            angle = turned(cable, drive, angle, extra[k], 0.002)
            cable.settle(drive, SLACK + ARM * angle)
        tension, _ = cable.tensions(SPOOL * position, SLACK + ARM * angle)
        speed = (position - before) * RATE
        motor = tension * SPOOL + 0.006 * np.tanh(speed / 0.02) + 0.002 * speed
        torques[k] = motor + 0.003 * np.cos(7 * GEAR * position + 0.6)
        angles[k], before = angle, position
    time = np.arange(len(turn)) / RATE
    current = torques / (TORQUE_CONSTANT * GEAR) + 0.003 * rng.normal(size=len(turn))
    encoder = OFFSET if kind == "calibration" else 0.0
    step = 2 * pi / (COUNTS * GEAR)
    counted = step * np.round(turn / step)
    channels = {"motor": counted, "current": TORQUE_CONSTANT * GEAR * current}
    theta = angles + encoder + np.deg2rad(0.03) * rng.normal(size=len(turn))
    return Log(
        time,
        channels,
        {"theta": theta},
        f"finger {kind} {seed}",
        FROM_SENSOR if kind == "calibration" else PLANT,
    )


def bowden_rig() -> Rig:
    """Return the rig file of somebody with a calliper, data sheets and the list of a rig file's
    options.
    """
    raw: dict[str, Any] = {
        "name": "finger with a Bowden cable",
        "joints": [
            {
                "name": "finger",
                "inertia": "3e-5 kg m^2",
                "damping": "2e-3 N m s",
                "initial": {"value": "5 deg", "std": "10 deg"},
                "stops": ["0 deg", "83 deg"],
                "stop_stiffness": "6 N m/rad",
                "friction": {
                    "coefficient": {"value": 0.2, "std": 0.1},
                    "radius": "1.5 mm",
                    "preload": "2 N",
                },
                "extension_spring": {
                    "stiffness": {"value": "320 N/m", "std": "10 %"},
                    "free_length": "16.5 mm",
                    "radius": "8 mm",
                    "distance": "24 mm",
                    "line_angle": {"value": "-43 deg", "std": "3 deg"},
                    "preload": {"value": "0.5 N", "std": "0.2 N"},
                },
            }
        ],
        "drives": [
            {
                "name": "motor",
                "kind": "capstan",
                "inertia": "1e-4 kg m^2",
                "radius": "8 mm",
                "damping": {"value": "2e-3 N m s", "std": "1e-3 N m s"},
                "friction": {"constant": {"value": "5e-3 N m", "std": "3e-3 N m"}},
                "cogging": {
                    "periods": 350,
                    "cosine": {"value": 0.0, "std": "3e-3 N m"},
                    "sine": {"value": 0.0, "std": "3e-3 N m"},
                },
            }
        ],
        "tendons": [
            {
                "name": "flexor",
                "joint": "finger",
                "drive": "motor",
                "side": 1,
                "insertion": {"kind": "pulley", "radius": {"value": "9.3 mm", "std": "0.4 mm"}},
                "stiffness": {"value": "7e3 N/m", "std": "25 %"},
                "slack": {"value": "0.4 mm", "std": "0.2 mm"},
                "path": {"friction": {"value": 0.1, "std": 0.04}, "wrap": "3 rad", "nodes": 2},
            }
        ],
        "sensors": [
            {
                "name": "motor",
                "measures": "position",
                "of": "motor",
                "rate": RATE,
                "resolution": 2 * pi / COUNTS / GEAR,
            },
            {
                "name": "current",
                "measures": "force",
                "of": "motor",
                "rate": RATE,
                "noise": "2e-3 N m",
            },
            {
                "name": "encoder",
                "measures": "angle",
                "of": "finger",
                "rate": RATE,
                "noise": "0.03 deg",
                "bias": {"value": 0.0, "std": "0.2 deg"},
            },
        ],
    }
    return build_rig(raw, "finger")


ROPE = {"arm": 11e-3, "spool": 9e-3, "stiffness": 8000.0, "gap": np.deg2rad(0.5)}
CREEP = {"share": 0.35, "time": 45.0}
"""2 % a minute of a stretch of some tenths of a millimetre would not show; of the load's share,
this is what ropes do.
"""


@cache
def ropes_log(seed: int, kind: str, duration: float = DURATION) -> Log:
    """Return a log of the joint with two motors: kind ``calibration``, ``ramps`` or ``holds``."""
    rng = np.random.default_rng([seed, 62])
    mean = ramps(rng, -0.7, 0.7, duration)
    if kind == "holds":
        marks = np.sort(rng.integers(0, len(mean), 8))
        for a, b in zip(marks[::2], marks[1::2]):
            mean[a:b] = mean[a]
        kernel = np.hanning(41)
        mean = np.convolve(np.pad(mean, 20, mode="edge"), kernel / kernel.sum(), mode="valid")
    squeeze = 0.09 + 0.03 * np.sin(2 * pi * 0.06 * np.arange(len(mean)) / RATE + rng.uniform(0, 6))
    motors = {"flexor": mean + squeeze, "extensor": -mean + squeeze}
    sides, arm, spool = {"flexor": 1.0, "extensor": -1.0}, ROPE["arm"], ROPE["spool"]
    behind = {name: float(values[0]) for name, values in motors.items()}
    strain, half = {"flexor": 1.5e-4, "extensor": 1.5e-4}, ROPE["gap"] / 2
    angle, angles = float(mean[0]) * spool / arm, np.empty(len(mean))
    cells = {name: np.empty(len(mean)) for name in motors}
    fade = exp(-1 / RATE / CREEP["time"])
    for k in range(len(mean)):
        for name, values in motors.items():
            behind[name] = min(max(behind[name], values[k] - half), values[k] + half)

        def pull(name: str, at: float) -> float:
            return ROPE["stiffness"] * max(
                spool * behind[name] - sides[name] * arm * at - strain[name], 0.0
            )

        for _ in range(8):
            net = arm * (pull("flexor", angle) - pull("extensor", angle)) - 0.02 * sin(angle)
            friction = 0.002 + 2e-4 * (pull("flexor", angle) + pull("extensor", angle))
            left = max(net - friction, 0.0) + min(net + friction, 0.0)
            taut = sum(pull(name, angle) > 0.0 for name in motors)
            angle += left / (taut * ROPE["stiffness"] * arm**2 + 0.02)
        for name in motors:
            cells[name][k] = pull(name, angle)
            aim = CREEP["share"] * cells[name][k] / ROPE["stiffness"]
            strain[name] = fade * strain[name] + (1 - fade) * aim
        angles[k] = angle
    measured: dict[str, Floats] = {}
    for name in motors:
        measured[f"{name}_angle"] = motors[name] * sides[name] + 1e-4 * rng.normal(size=len(mean))
        gain = {"flexor": 1.01, "extensor": 0.99}[name]
        measured[f"{name}_cell"] = gain * cells[name] + 0.03 * rng.normal(size=len(mean))
    time = np.arange(len(mean)) / RATE
    theta = angles + np.deg2rad(0.03) * rng.normal(size=len(mean))
    return Log(
        time,
        measured,
        {"theta": theta},
        f"ropes {kind} {seed}",
        FROM_SENSOR if kind == "calibration" else PLANT,
    )


def ropes_rig() -> Rig:
    """Return the rig file for the joint with two motors."""
    drives, tendons, sensors = [], [], []
    for name, side in (("flexor", 1), ("extensor", -1)):
        drives.append(
            {
                "name": name,
                "kind": "capstan",
                "inertia": "1e-4 kg m^2",
                "radius": "9 mm",
                "backlash": {"width": {"value": "0.5 deg", "std": "0.2 deg"}},
            }
        )
        tendons.append(
            {
                "name": f"{name}_rope",
                "joint": "knuckle",
                "drive": name,
                "side": side,
                "insertion": {"kind": "pulley", "radius": {"value": "11 mm", "std": "0.2 mm"}},
                "stiffness": {"value": "8.5e3 N/m", "std": "15 %"},
                "creep": {
                    "share": {"value": 0.3, "std": 0.15},
                    "time": {"value": "60 s", "std": "20 s"},
                },
            }
        )
        sensors += [
            {
                "name": f"{name}_angle",
                "measures": "position",
                "of": name,
                "rate": RATE,
                "noise": "1e-4 rad",
            },
            {
                "name": f"{name}_cell",
                "measures": "tension",
                "of": f"{name}_rope",
                "rate": RATE,
                "noise": "0.03 N",
                "gain": {"value": 1.0, "std": "1 %"},
            },
        ]
    encoder = {
        "name": "encoder",
        "measures": "angle",
        "of": "knuckle",
        "rate": RATE,
        "noise": "0.03 deg",
    }
    raw: dict[str, Any] = {
        "name": "joint with two motors",
        "joints": [
            {
                "name": "knuckle",
                "inertia": "5e-5 kg m^2",
                "damping": "2e-3 N m s",
                "initial": {"value": 0.0, "std": "40 deg"},
                "friction": {
                    "coefficient": {"value": 0.15, "std": 0.08},
                    "radius": "2 mm",
                    "preload": "5 N",
                },
                "spring": {"stiffness": {"value": "0.02 N m/rad", "std": "0.01 N m/rad"}},
            }
        ],
        "drives": drives,
        "tendons": tendons,
        "sensors": [*sensors, encoder],
    }
    return build_rig(raw, "ropes")
