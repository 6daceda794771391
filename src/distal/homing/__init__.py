"""Homing: what the first moments of a run, in which the joint's angle is known, tell of this run."""

from distal.homing.apply import begun_homed, calibrated, held, numbers_homed, plain_samples, touched
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
    "begun_homed",
    "calibrated",
    "check_homing",
    "held",
    "homed",
    "numbers_homed",
    "plain_samples",
    "touched",
    "with_references",
]
