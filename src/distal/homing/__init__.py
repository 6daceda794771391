"""Homing: adapt a filter to a run by its first seconds, in which the joint's angle is known."""

from distal.homing.home import (
    added_reference,
    at_known_angle,
    check_homing,
    home,
    homing_filter,
    plain_samples,
    samples_of_readings,
    with_prior_maps,
    with_references,
)

__all__ = [
    "added_reference",
    "at_known_angle",
    "check_homing",
    "home",
    "homing_filter",
    "plain_samples",
    "samples_of_readings",
    "with_prior_maps",
    "with_references",
]
