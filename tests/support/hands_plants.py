"""Two rigs as labs have them, with several of the commonest physics at once; the plants share no
code with `distal.model`.

`bowden_log`: a finger pulled by one cable in a Bowden sheath against an extension spring, slack at
home, a motor with a gear of 50:1 whose current cogs, its encoder in counts. `ropes_log`: two motors
with load cells pull a joint by ropes that creep, with backlash between encoders and spools. The
joints are quasi-static with dry friction of their own; cables are of `tests/support/cable.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from math import cos, exp, pi, sin, sqrt
from pathlib import Path

import numpy as np

from distal import Log, Rig, load_rig
from distal.arrays import Floats
from distal.logs import FROM_SENSOR, TruthSource
from tests.support.cable import Cable

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
    return load_rig(Path(__file__).with_name("bowden.toml"))


ROPE = {"arm": 11e-3, "spool": 9e-3, "stiffness": 8000.0, "gap": np.deg2rad(0.5)}
CREEP = {"share": 0.35, "time": 45.0}
"""2 % a minute of a stretch of some tenths of a millimetre would not show; of the load's share,
this is what ropes do.
"""


class RopesPlant:
    """A joint at rest between two ropes that creep, with backlash between encoders and spools.

    Args:
        wound: angles of the motors [rad], by which each draws its rope in.
        step: time between moves [s].
        gap: of the backlash [rad].
        stiffness: of the ropes [N/m].
        dry: factor on the joint's friction.
    """

    def __init__(
        self,
        wound: Sequence[float],
        step: float,
        gap: float = ROPE["gap"],
        stiffness: float = ROPE["stiffness"],
        dry: float = 1.0,
    ) -> None:
        self.gap, self.stiffness, self.dry = gap, stiffness, dry
        self.fade = exp(-step / CREEP["time"])
        self.behind, self.strain = list(wound), [1.5e-4, 1.5e-4]
        self.angle = (wound[0] - wound[1]) / 2 * ROPE["spool"] / ROPE["arm"]

    def pulls(self) -> list[float]:
        """Return the tensions of flexor and extensor."""
        turned = ROPE["arm"] * self.angle
        ends = [ROPE["spool"] * self.behind[0] - turned, ROPE["spool"] * self.behind[1] + turned]
        return [self.stiffness * max(end - strain, 0.0) for end, strain in zip(ends, self.strain)]

    def move(self, wound: Sequence[float]) -> list[float]:
        """Turn the motors; the joint comes to rest at once. Return the tensions, from which the
        ropes creep.
        """
        half, arm = self.gap / 2, ROPE["arm"]
        self.behind = [min(max(b, w - half), w + half) for b, w in zip(self.behind, wound)]
        for _ in range(8):
            pulls = self.pulls()
            net = arm * (pulls[0] - pulls[1]) - 0.02 * sin(self.angle)
            friction = self.dry * (0.002 + 2e-4 * sum(pulls))
            left = max(net - friction, 0.0) + min(net + friction, 0.0)
            taut = sum(pull > 0.0 for pull in pulls)
            self.angle += left / (taut * self.stiffness * arm**2 + 0.02)
        pulls = self.pulls()
        aims = [CREEP["share"] * pull / self.stiffness for pull in pulls]
        self.strain = [self.fade * s + (1 - self.fade) * aim for s, aim in zip(self.strain, aims)]
        return pulls


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
    time = np.arange(len(mean)) / RATE
    squeeze = 0.09 + 0.03 * np.sin(2 * pi * 0.06 * time + rng.uniform(0, 6))
    wound = np.column_stack([mean + squeeze, squeeze - mean])
    plant, angles, cells = (
        RopesPlant(wound[0].tolist(), 1 / RATE),
        list[float](),
        list[list[float]](),
    )
    for row in wound.tolist():
        cells.append(plant.move(row))
        angles.append(plant.angle)
    measured: dict[str, Floats] = {}
    for i, (name, side, gain) in enumerate((("flexor", 1, 1.01), ("extensor", -1, 0.99))):
        measured[f"{name}_angle"] = side * wound[:, i] + 1e-4 * rng.normal(size=len(mean))
        cell = np.array(cells)[:, i]
        measured[f"{name}_cell"] = gain * cell + 0.03 * rng.normal(size=len(mean))
    return Log(
        time,
        measured,
        {"theta": angles + np.deg2rad(0.03) * rng.normal(size=len(mean))},
        f"ropes {kind} {seed}",
        FROM_SENSOR if kind == "calibration" else PLANT,
    )


def ropes_rig() -> Rig:
    """Return the rig file for the joint with two motors."""
    return load_rig(Path(__file__).with_name("ropes.toml"))
