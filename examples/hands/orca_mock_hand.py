"""orca_core's mock hand with motors that turn, rub and meet the ends of the joints' ranges, to try
distal without a hand: `python orca_mock_hand.py` (`pip install orca_core`).

It calibrates the hand by the power-on routine and closes orca_core's loop on virtual encoders.
"""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np
from orca_core.hardware_hand import MockOrcaHand

from distal.bridges.orca import VirtualEncoders
from distal.hands import Hand, RoutineOptions
from distal.rig import from_orca

SERVO, TENDON = 6.0, 1.3
"""Stiffness of a motor's servo, and of a tendon at its spool [N m/rad]."""

FRICTION, TORQUE_CONSTANT = 0.03, 0.5
"""Torque that moves a motor [N m]; its torque by its current [N m/A]."""

FASTEST = 0.05
"""Turn of a motor in a period [rad]."""


def moving_hand() -> tuple[Any, Any]:
    """Return the hand, calibrated as orca_core does it, and its rig; a thread moves the motors."""
    hand = MockOrcaHand()
    hand.connect()
    rig = from_orca(hand.config.config_path).rig
    numbers = hand.config.motor_ids
    joints = {motor: joint for joint, motor in hand.config.joint_to_motor_map.items()}
    ends = np.zeros((len(numbers), 2))
    for k, number in enumerate(numbers):
        low, high = hand.config.joint_roms_dict[joints[number]]
        drive = rig.drive(f"motor_{number}")
        tendon = rig.tendons_of(drive.name)[0]
        ratio = abs(tendon.arms()[joints[number]]) / drive.lever
        sign = next(s.sign for s in rig.sensors_of("position") if s.of == drive.name)
        ends[k] = 3.0 + np.sort(sign * ratio * np.deg2rad([low, high]))
    spans = [np.ptp(hand.config.joint_roms_dict[joints[number]]) for number in numbers]
    ratios = np.ptp(ends, axis=1) / spans
    hand.calibration = replace(
        hand.calibration,
        motor_limits_dict=dict(zip(numbers, ends.tolist())),
        joint_to_motor_ratios_dict=dict(zip(numbers, ratios.tolist())),
        calibrated=True,
    )
    hand._wrap_offsets_dict = dict.fromkeys(numbers, 0.0)
    rng = np.random.default_rng(0)
    goals = ends.mean(axis=1)
    places = goals.copy()

    def write(ids: Any, positions: Any) -> None:
        goals[[numbers.index(number) for number in ids]] = positions

    def move() -> None:
        nonlocal places
        while True:
            inside = np.clip(goals, ends[:, 0], ends[:, 1])
            aim = inside + (goals - inside) * SERVO / (SERVO + TENDON)
            before = places
            places = before + np.clip(aim - before, -FASTEST, FASTEST)
            pressed = places - np.clip(places, ends[:, 0], ends[:, 1])
            rubbed = FRICTION * np.clip((places - before) / 1e-3, -1, 1)
            currents = (TENDON * pressed + rubbed) / TORQUE_CONSTANT + rng.normal(0, 2e-3, len(aim))
            hand.motor_client._pos.update(zip(numbers, places.tolist()))
            hand.motor_client._cur.update(zip(numbers, (1e3 * currents).tolist()))
            time.sleep(0.01)

    hand.write_motor_pos = write
    threading.Thread(target=move, daemon=True).start()
    return hand, rig


if __name__ == "__main__":
    hand, rig = moving_hand()
    options = RoutineOptions(order=[rig.drive_names])  # all motors at once
    found = Hand(hand, rig).power_on(options)
    found.save("calibrated.toml")
    encoders = VirtualEncoders(hand, "calibrated.toml")
    encoders.connect()
    encoders.start_stream()
    loop = encoders.loop()
    loop.start()
    for degrees in range(41):
        loop.set_target({"index_mcp": degrees})
        time.sleep(0.02)
    print(loop.get_measured_joints(), encoders.hand.health().sentence)
    loop.stop()
    encoders.disconnect()
