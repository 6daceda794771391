"""`distal.hands.Hand` beside orca-core's own mock hand, in real time: `python -m
benchmarks.orca_mock [SECONDS]`.

orca-core is heavy and has a web server: it is for an environment of its own (`pip install
orca-core`). Its mock motors are moved by a plant of `tests.support.servo_hands`; some reads fail,
and one motor restarts: it is silent and its encoder jumps.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from tests.support.servo_hands import PERIOD, TORQUE_CONSTANT, orca_like

from distal.hands import Hand
from distal.rig import from_orca

LOST, REBOOT, SILENT = 0.02, 20.0, 2.0
"""Share of reads that fail; when a motor restarts, and for how long it says nothing [s]."""


class PlantClient:
    """Steps a plant beside the mock client and puts what it reads into the mock's own registers."""

    def __init__(self, orca: Any, seed: int) -> None:
        self.known, self.hands = orca_like([seed])
        self.orca, self.client, self.rng = orca, orca.motor_client, np.random.default_rng(seed)
        joints = {abs(motor): joint for joint, motor in orca.config.joint_to_motor_map.items()}
        order = [joints[number] for number in orca.config.motor_ids]
        self.columns = [self.known.joints.index(joint) for joint in order]
        d = self.hands.d
        for joint, low_high in orca.config.joint_roms_dict.items():
            j = self.known.joints.index(joint)
            d.low[0, j], d.high[0, j] = np.deg2rad(low_high)
        self.goals = self.hands.positions + d.zeros * d.signs
        self.fails = 0

    def step(self, at: float) -> None:
        """Let a period pass."""
        read = self.hands.step(self.hands.d.signs * self.goals)
        for number, j in zip(self.orca.config.motor_ids, self.columns):
            self.client._pos[number] = float(read["positions"][0, j])
            self.client._cur[number] = 1e3 * float(read["currents"][0, j])
        silent = REBOOT < at < REBOOT + SILENT
        # what the mock offers to make a read fail
        lost = self.rng.random() < LOST or (silent and self.rng.random() < 0.5)
        self.client.last_read_ok = not lost
        self.fails += lost


def main() -> None:
    """Run and print."""
    from orca_core.hardware_hand import MockOrcaHand

    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    orca = MockOrcaHand()
    orca.connect()
    begun = time.perf_counter()
    imported = from_orca(orca.config.config_path)
    made = time.perf_counter()
    hand = Hand(orca, imported.rig)
    print(
        f"import {made - begun:.2f} s, first kernel {time.perf_counter() - made:.1f} s, "
        f"{len(imported.missing)} guesses"
    )
    plant = PlantClient(orca, 5)
    spent, late, words = [], 0, dict[str, int]()
    begin = time.perf_counter()
    for k in range(round(seconds / PERIOD)):
        plant.goals[0] = plant.hands.positions[0] + 0.0
        wave = 0.6 * np.sin(2 * np.pi * 0.3 * k * PERIOD + np.arange(len(plant.goals[0])))
        plant.goals[0] = plant.hands.d.zeros[0] * plant.hands.d.signs[0] + wave
        plant.step(k * PERIOD)
        before = time.perf_counter()
        reading = hand.update(k * PERIOD)
        hand.get_joint_positions(), hand.get_joint_stds()
        hand.health()
        spent.append(time.perf_counter() - before)
        words[reading.health] = words.get(reading.health, 0) + 1
        due = begin + (k + 1) * PERIOD
        late += time.perf_counter() > due + PERIOD
        time.sleep(max(0.0, due - time.perf_counter()))
    took = 1e3 * np.array(spent)
    print(
        f"{len(spent)} steps at {1 / PERIOD:.0f} Hz, {late} late; in our code "
        f"{np.median(took):.3f} ms, 99 %: "
        f"{np.quantile(took, 0.99):.3f}, longest {took.max():.2f} ms"
    )
    print(f"{plant.fails} reads failed; health {words}; {hand.health().sentence}")
    print(f"torque constant of the catalogue {TORQUE_CONSTANT} N m/A")


if __name__ == "__main__":
    main()
