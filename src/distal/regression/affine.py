"""The obvious map: the joints' angles as a straight line of what the sensors read, with directions of motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from distal.regression.learn import Kind, Terms
from distal.rig import CONSTANT, Affine

Floats = NDArray[np.float64]

DEAD_BAND = 6.0
"""Half-width of the play that finds a direction, in standard deviations of the position sensor."""

BETTER = 0.95
"""Directions are used where they bring the RMS error on left-out logs below this share of that without them."""


def affine_kind(channels: Sequence[str], positions: Sequence[str], joints: Sequence[str], noise: Floats) -> Kind:
    """Return how joints' angles are learned from readings alone.

    Args:
        channels: names of the sensors.
        positions: those of drives' places.
        joints: names of the joints.
        noise: standard deviation of each sensor's random error [SI], (m,).
    """
    linear = (CONSTANT, *channels)
    turns = tuple(f"slip({name})" for name in positions)
    sets = (
        Terms("a straight line of what the sensors read", linear, DEAD_BAND, of_noise=True),
        Terms("a straight line, with directions of motion", (*linear, *turns), DEAD_BAND, of_noise=True),
    )
    return Kind(
        Affine,
        "affine",
        tuple(channels),
        tuple(joints),
        noise,
        sets,
        BETTER,
        by_motion=True,
        unknown_outside=False,
    )
