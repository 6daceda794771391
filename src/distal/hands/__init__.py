"""Robot hands with their own SDKs: power-on calibration, joint angles and goals, live."""

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
