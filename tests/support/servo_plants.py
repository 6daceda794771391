"""Plants whose drives are servos of place, stepped sample by sample; they share no code with
`distal.model`.

A servo follows what is sent to it with a lag of first order at 10 Hz, 10 ms late, no faster than it
can, and takes its own sensor's word for where it is. `Ropes` steps the plant of `hands_plants`, its
numbers drawn within what its user's rig file leaves open.
"""

from __future__ import annotations

from collections import deque
from math import exp, pi
from typing import Any, Protocol

import numpy as np

from distal import Rig
from distal.arrays import Floats
from tests.support import hands_plants
from tests.support.hands_plants import ROPE, RopesPlant

PERIOD, PARTS = 0.01, 10
"""Of a sample [s], and steps of a servo in it."""

BANDWIDTH, DELAY = 10.0, 0.01
"""Of a servo [Hz], [s]."""

FASTEST = {"slider": 0.15, "capstan": 15.0}
"""Of a servo [m/s], [rad/s]."""


class Plant(Protocol):
    """A plant at rest, its rig as its user knows it, and the arms of its drives at its joints [rad
    per place].
    """

    rig: Rig
    angles: Floats
    positions: Floats

    def move(self, positions: Floats) -> None:
        """Move the drives to places, within one part of a sample."""

    def read(self) -> dict[str, float]:
        """Return what the sensors read now."""


class Servos:
    """The drives' own controllers in front of a plant."""

    def __init__(self, plant: Plant, errors: Any = None, speeds: bool = False) -> None:
        self.plant, self.speeds = plant, speeds
        self.errors = errors or (lambda positions: np.zeros_like(positions))
        begin = (
            np.zeros_like(plant.positions)
            if speeds
            else plant.positions + self.errors(plant.positions)
        )
        self.queue: deque[Floats] = deque([begin] * round(DELAY / PERIOD))
        self.rate = np.zeros_like(plant.positions)
        self.share = 1 - exp(-2 * pi * BANDWIDTH * PERIOD / PARTS)
        kinds = [drive.kind for drive in plant.rig.drives]
        self.most = np.array([FASTEST[kind] for kind in kinds]) * PERIOD / PARTS

    def step(self, sent: Floats) -> tuple[Floats, dict[str, float]]:
        """Send places, or speeds, let a period pass, and return the true angles and what the
        sensors read then.
        """
        self.queue.append(np.array(sent, dtype=np.float64))
        goal, plant = self.queue.popleft(), self.plant
        for _ in range(PARTS):
            away = goal - (
                self.rate if self.speeds else plant.positions + self.errors(plant.positions)
            )
            if self.speeds:
                self.rate = self.rate + self.share * away
                moved = self.rate * PERIOD / PARTS
            else:
                moved = self.share * away
            plant.move(plant.positions + np.clip(moved, -self.most, self.most))
        read = plant.read()
        errors = dict(zip([drive.name for drive in plant.rig.drives], self.errors(plant.positions)))
        for sensor in plant.rig.sensors_of("position"):
            read[sensor.name] += errors[sensor.of]
        return plant.angles.copy(), read


def with_servos(rig: Rig) -> Rig:
    """Return a rig whose file says how its drives follow places."""
    servo = {"bandwidth": BANDWIDTH, "delay": DELAY}
    drives = {
        f"drives.{i}.servo": {**servo, "fastest": FASTEST[drive.kind]}
        for i, drive in enumerate(rig.drives)
    }
    return rig.with_values(drives)


class Ropes:
    """A joint that two motors pull by ropes that creep, with backlash between encoders and
    spools.
    """

    def __init__(self, seed: int) -> None:
        self.rig = with_servos(hands_plants.ropes_rig())
        rng = self.rng = np.random.default_rng([seed, 93])
        gap = ROPE["gap"] * (1 + 0.3 * rng.uniform(-1, 1))
        stiffness = ROPE["stiffness"] * (1 + 0.1 * rng.uniform(-1, 1))
        dry = 1 + 0.2 * rng.uniform(-1, 1)
        self.plant = RopesPlant([0.09, 0.09], PERIOD / PARTS, gap, stiffness, dry)
        self.positions = np.array([0.09, -0.09])

    @property
    def angles(self) -> Floats:
        """The joint's angle."""
        return np.array([self.plant.angle])

    def move(self, positions: Floats) -> None:
        """Turn the motors."""
        self.positions = positions
        self.plant.move((positions * [1.0, -1.0]).tolist())

    def read(self) -> dict[str, float]:
        """Return the motors' angles and the cells' tensions."""
        pulls, noise, read = self.plant.pulls(), self.rng.normal(size=4), dict[str, float]()
        for i, (name, gain) in enumerate((("flexor", 1.01), ("extensor", 0.99))):
            read[f"{name}_angle"] = float(self.positions[i]) + 1e-4 * noise[i]
            read[f"{name}_cell"] = gain * pulls[i] + 0.03 * noise[2 + i]
        return read
