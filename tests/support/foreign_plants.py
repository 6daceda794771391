"""Rigs of strangers, as plants with physics that distal's model does not have; they share no code
with it.

`finger_log`: a motor winds one cable that runs through a Bowden sheath with friction along its way;
an extension spring pulls the joint back; the motor's current and encoder counts are measured.
`hand_log`: two motors pull a joint by ropes that creep, with backlash in the gears. What moves is a
chain of places that rest until what pulls them exceeds friction, so that the plants are
quasi-static: exact for motions of some hertz.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from distal import Log, Rig, load_rig
from distal.arrays import Floats

RATE = 100.0
DURATION = 30.0


def motion(rng: np.random.Generator, low: float, high: float, duration: float) -> Floats:
    """Return a smooth motion between two places with rests: sums of sines, held now and then,
    (k,).
    """
    time = np.arange(round(duration * RATE)) / RATE
    rates = rng.uniform(0.05, 0.45, 4)
    weights = rng.uniform(0.4, 1.0, 4)
    waves = sum(
        w * np.sin(2 * np.pi * f * time + rng.uniform(0, 2 * np.pi)) for w, f in zip(weights, rates)
    )
    raw = (waves / weights.sum() + 1.0) / 2.0
    for _ in range(3):
        at = int(rng.integers(len(raw) - 200))
        raw[at : at + 150] = raw[at]
    kernel = np.hanning(25)
    smooth = np.convolve(np.pad(raw, 12, mode="edge"), kernel / kernel.sum(), mode="valid")
    positions: Floats = low + (high - low) * np.clip(smooth, 0.0, 1.0)
    return positions


@cache
def finger_log(seed: int, duration: float = DURATION) -> Log:
    """Return a log of the finger; the plant's numbers are the same for all seeds, the motion and
    load are not.
    """
    rng = np.random.default_rng([seed, 41])
    turn = motion(rng, 0.0, 1.35, duration)
    spool, arm = 0.0082, 0.0093
    parts, wrap, coefficient = 8, 2.1, 0.11
    stiffness = 6500.0 * parts
    spring, rest, preload = 0.042, -0.15, 0.006
    nodes, angle = np.zeros(parts + 1), 0.0
    angles, torques = np.empty(len(turn)), np.empty(len(turn))
    share = np.expm1(coefficient * wrap / parts)
    tensions = np.full(parts, 1.0)
    # before the log the motor winds the cable to where it begins: else the joint jumps by 8° after
    # the first sample
    winding = np.linspace(0.0, turn[0], round(RATE))[:-1]
    for k, position in enumerate([*winding, *turn], -len(winding)):
        nodes[0] = spool * position
        for _ in range(60):
            before = nodes.copy()
            for i in range(1, parts):
                pull, hold = (
                    stiffness * (nodes[i - 1] - nodes[i]),
                    stiffness * (nodes[i] - nodes[i + 1]),
                )
                limit = share * max(min(pull, hold), 0.0) + 1e-3
                extra = pull - hold
                if abs(extra) > limit:
                    nodes[i] += (extra - np.sign(extra) * limit) / (2 * stiffness)
            # the finger: spring and load against the cable, with its own friction
            lever = arm * (1.0 + 0.08 * np.cos(angle))
            pull = stiffness * (nodes[parts - 1] - nodes[parts])
            extra = max(pull, 0.0) * lever - spring * (angle - rest) - preload
            limit = 0.0025
            if abs(extra) > limit:
                angle += (extra - np.sign(extra) * limit) / (2 * (stiffness * lever**2 + spring))
            nodes[parts] = arm * (angle + 0.08 * np.sin(angle))
            if np.abs(nodes - before).max() < 1e-9:
                break
        if k < 0:
            continue
        tensions = stiffness * np.maximum(nodes[:-1] - nodes[1:], 0.0)
        angles[k] = angle
        speed = (turn[k] - turn[k - 1]) * RATE if k else 0.0
        torques[k] = tensions[0] * spool + 0.004 * np.tanh(speed / 0.02) + 0.001 * speed
    counts = 2 * np.pi / 2048
    time = np.arange(len(turn)) / RATE
    measured = {
        "motor_angle": np.round((turn + 0.012) / counts) * counts,
        "motor_torque": np.round((1.06 * torques + 1.5e-3 * rng.normal(size=len(turn))) / 5e-4)
        * 5e-4,
    }
    return Log(
        time,
        measured,
        {"theta": angles + np.deg2rad(0.05) * rng.normal(size=len(turn))},
        f"finger {seed}",
    )


def finger_rig() -> Rig:
    """Return the rig file that somebody would write who has a calliper and data sheets."""
    return load_rig(Path(__file__).with_name("finger.toml"))


@cache
def hand_log(seed: int, duration: float = DURATION) -> Log:
    """Return a log of a joint with two motors, ropes that creep 2 % of their length a minute, and
    backlash in the gears.
    """
    rng = np.random.default_rng([seed, 42])
    mean = motion(rng, -0.7, 0.7, duration)
    squeeze = motion(rng, 0.10, 0.22, duration)
    time = np.arange(len(mean)) / RATE
    radius, arm, stiffness = 0.010, 0.012, 9000.0
    motors = {"flexor": mean + squeeze, "extensor": -mean + squeeze}
    angle = 0.0
    creep = {"flexor": 0.0, "extensor": 0.0}
    behind = {name: values[0] for name, values in motors.items()}
    gap, angles = 0.008, np.empty(len(time))
    torques = {name: np.empty(len(time)) for name in motors}
    for k in range(len(time)):
        pulls = {}
        for _ in range(40):
            for name, side in (("flexor", 1.0), ("extensor", -1.0)):
                behind[name] = min(max(behind[name], motors[name][k] - gap), motors[name][k] + gap)
                stretch = radius * behind[name] - side * arm * angle - creep[name]
                pulls[name] = stiffness * max(stretch, 0.0) * (1.0 + 40.0 * max(stretch, 0.0))
            extra = arm * (pulls["flexor"] - pulls["extensor"]) - 0.03 * np.sin(angle)
            limit = 0.003 + 0.0006 * (pulls["flexor"] + pulls["extensor"])
            if abs(extra) <= limit:
                break
            angle += 0.5 * (extra - np.sign(extra) * limit) / (2 * stiffness * arm**2)
        for name in motors:
            # a standard solid: creeps towards a fiftieth of a length of 0.3 m at 20 N
            aim = 3e-4 * pulls[name] / 20.0
            creep[name] += (aim - creep[name]) / 40.0 / RATE
            speed = (motors[name][k] - motors[name][k - 1]) * RATE if k else 0.0
            torques[name][k] = radius * pulls[name] * (
                1.0 + 0.06 * np.tanh(speed / 0.02)
            ) + 0.01 * np.tanh(speed / 0.02)
        angles[k] = angle
    measured = {}
    for name, side in (
        ("flexor", 1.0),
        ("extensor", -1.0),
    ):  # a motor on side −1 winds as it turns to −
        measured[f"{name}_angle"] = side * motors[name] + 0.02 + 3e-4 * rng.normal(size=len(time))
        measured[f"{name}_torque"] = side * torques[name] + 4e-3 * rng.normal(size=len(time))
    return Log(
        time,
        measured,
        {"theta": angles + np.deg2rad(0.05) * rng.normal(size=len(time))},
        f"hand {seed}",
    )


def hand_rig() -> Rig:
    """Return the rig file that somebody would write for the joint with two motors."""
    return load_rig(Path(__file__).with_name("hand.toml"))
