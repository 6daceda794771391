"""Samples in which a joint rests in a stop: how it does so is the stop's own affair, and teaches
nothing of the rest.
"""

from __future__ import annotations

import numpy as np

from distal.arrays import Bools, Floats
from distal.rig import Rig

NEAR_STOP = float(np.deg2rad(0.5))
"""A joint is in a stop where it is so near to it [rad], beside what its encoder's offset is unsure
by.
"""

AFTER_STOP = 0.05
"""It has left a stop so long after [s]."""


def in_stops(times: Floats, truth: Floats, rig: Rig) -> Bools:
    """Return where each joint is in one of its stops, or has just left it, by its `truth` [rad],
    NaN where not known.

    Both have shape (k, n_joints); the stamps `times` [s], (k,).
    """
    resting = np.zeros(truth.shape, dtype=bool)
    for j, (joint, angles) in enumerate(zip(rig.joints, truth.T)):
        if joint.stops is not None:
            doubts = [
                sensor.bias.filter_std
                for sensor in rig.sensors_of("angle")
                if sensor.of == joint.name
            ]
            margin = NEAR_STOP + 2.0 * max(doubts, default=0.0)
            low, high = joint.stops
            with np.errstate(invalid="ignore"):
                resting[:, j] = (angles < low + margin) | (angles > high - margin)
    last = np.maximum.accumulate(np.where(resting, times[:, None], -np.inf), axis=0)
    return times[:, None] - last <= AFTER_STOP
