"""Hands that people own: their power-on calibration, and live angles from their own SDKs."""

from distal.hands.calibrate import Calibrated, calibrate
from distal.hands.findings import Fault, FaultKind
from distal.hands.routine import Routine, RoutineOptions

__all__ = ["Calibrated", "Fault", "FaultKind", "Routine", "RoutineOptions", "calibrate"]
