"""Samples in which a joint rests in a stop: there its angle depends on the stop alone, and teaches
nothing of the other parameters.
"""

from __future__ import annotations

import numpy as np

from distal.arrays import Bools, Floats
from distal.rig import Rig

NEAR_STOP = float(np.deg2rad(0.5))
"""Distance from a stop within which a joint is in it [rad], beside twice the std of its encoder's
offset. Source: judgement.
"""

AFTER_STOP = 0.05
"""Time after which a joint has left a stop [s]. Source: judgement."""


def in_stops(times: Floats, truth: Floats, rig: Rig) -> Bools:
    """Return whether each joint is in one of its stops or has just left it, (k, n_joints).

    The angles `truth` [rad], (k, n_joints), are NaN where not known; `times` are the stamps [s],
    (k,).
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
