"""Homing: adapt a filter to a run by its first seconds, in which the joint's angle is known."""

from distal.homing.apply import plain_samples, torque_samples
from distal.homing.reference import (
    added_reference,
    at_known_angle,
    check_homing,
    homing_filter,
    with_references,
)
from distal.homing.window import Window

__all__ = [
    "Window",
    "added_reference",
    "at_known_angle",
    "check_homing",
    "homing_filter",
    "plain_samples",
    "torque_samples",
    "with_references",
]
