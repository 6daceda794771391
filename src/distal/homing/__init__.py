"""Homing: what the first moments of a run, in which the joint's angle is known, tell of this run."""

from distal.homing.apply import (
    calibrate_contact,
    calibrated,
    held,
    homing_prior,
    numbers_homed,
    plain_samples,
    torque_samples,
)
from distal.homing.reference import (
    TRUTH_NOISE,
    added_reference,
    at_known_angle,
    check_homing,
    homed,
    with_references,
)
from distal.homing.window import Window

__all__ = [
    "TRUTH_NOISE",
    "Window",
    "added_reference",
    "at_known_angle",
    "calibrate_contact",
    "calibrated",
    "check_homing",
    "held",
    "homed",
    "homing_prior",
    "numbers_homed",
    "plain_samples",
    "torque_samples",
    "with_references",
]
