"""Hands that people own: their power-on calibration, and live angles from their own SDKs."""

from distal.hands.calibrate import Calibrated, calibrate
from distal.hands.findings import Fault, FaultKind
from distal.hands.hand import Hand, HandHealth
from distal.hands.motors import AeroMotors, Motors, OrcaMotors
from distal.hands.moved import moved_since
from distal.hands.routine import Routine, RoutineOptions

__all__ = [
    "AeroMotors",
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
    "moved_since",
]
