"""Robot hands with their own SDKs: power-on calibration, joint angles and goals, live."""

from distal.hands.calibrate import Calibrated, calibrate
from distal.hands.hand import Hand, HandHealth
from distal.hands.motors import Motors, OrcaMotors
from distal.hands.power_on_routine import Routine, RoutineOptions
from distal.hands.tendon_faults import Fault, FaultKind

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
