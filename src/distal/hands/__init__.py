"""Robot hands with their own SDKs: power-on calibration, joint angles and goals, live.

In: motors' positions and torques of a hand; out: its joints' angles, and what its motors are sent.
A routine finds zeros by the ends of the joints' ranges before (docs/how-to/my-hand.md).

    from distal.hands import RoutineOptions

    print(RoutineOptions())
"""

from distal.hands.calibrate import Calibrated, Fault, FaultKind, calibrate
from distal.hands.hand import Hand, HandHealth, Motors, OrcaMotors
from distal.hands.power_on_routine import Routine, RoutineOptions

__all__ = [
    "Calibrated",
    "Fault",
    "FaultKind",
    "Hand",
    "HandHealth",
    "Motors",
    "OrcaMotors",
    "Routine",
    "RoutineOptions",
    "calibrate",
]
