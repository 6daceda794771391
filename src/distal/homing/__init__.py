"""Homing: adapt a filter to a run by its first moments, in which the joint's angle is known."""

from distal.homing.apply import (
    calibrate_contact,
    calibrated,
    held,
    homing_prior,
    numbers_homed,
    plain_samples,
    torque_samples,
)
from distal.homing.home import Homed, home
from distal.homing.least_squares import led_astray, with_straight_line
from distal.homing.reference import (
    TRUTH_NOISE,
    added_reference,
    at_known_angle,
    check_homing,
    homed,
    homing_filter,
    with_references,
)
from distal.homing.window import Window

__all__ = [
    "TRUTH_NOISE",
    "Homed",
    "Window",
    "added_reference",
    "at_known_angle",
    "calibrate_contact",
    "calibrated",
    "check_homing",
    "held",
    "home",
    "homed",
    "homing_filter",
    "homing_prior",
    "led_astray",
    "numbers_homed",
    "plain_samples",
    "torque_samples",
    "with_references",
    "with_straight_line",
]
