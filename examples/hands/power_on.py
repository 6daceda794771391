"""Calibrate a hand as it is switched on, then print its joints' angles: `python power_on.py hand.toml calibrated.toml`.

For an ORCA hand (`pip install orca-core`); of an Aero Hand take the motors of `aero_motors.py` instead. Clear the
fingers' way first. Ctrl-C stops the motors where they are.
"""

from __future__ import annotations

import sys
import time

from orca_core import OrcaHand

from distal.hands import Hand

rig, out = sys.argv[1:3]
orca = OrcaHand()
orca.connect()
orca.enable_torque()
hand = Hand(orca, rig)
found = hand.power_on(show=lambda motor: print("moving", motor), record="routine.csv")
for fault in found.faults:
    print(fault.sentence)
found.save(out)
while True:
    hand.update()
    print(
        {joint: round(angle, 1) for joint, angle in hand.get_joint_positions().items()},
        hand.health().sentence,
    )
    time.sleep(0.01)
