"""Sensors: what is measured, with which errors, and where a log holds it; a kind of sensor is a
file.
"""

from distal.rig.sensors.base import COUNTS, Measurand, Motion, Role
from distal.rig.sensors.motions import drive_travel
from distal.rig.sensors.registry import (
    MEASURED,
    REFERENCES,
    UNITS,
    Sensor,
    checked_parts,
    gain_of,
    log_factor,
    log_unit,
    measurand_of,
    one_number_each,
    part_of,
    step_of,
    travel_of,
)

__all__ = [
    "COUNTS",
    "MEASURED",
    "REFERENCES",
    "UNITS",
    "Measurand",
    "Motion",
    "Role",
    "Sensor",
    "checked_parts",
    "drive_travel",
    "gain_of",
    "log_factor",
    "log_unit",
    "measurand_of",
    "one_number_each",
    "part_of",
    "step_of",
    "travel_of",
]
