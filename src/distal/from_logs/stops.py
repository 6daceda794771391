"""End stops of joints: at a stop, a joint turns back sharply at one angle, or tendons pull harder
than free motion there would need.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import radians

import numpy as np

from distal.arrays import Floats
from distal.from_logs.column_values import NORMAL_MAD
from distal.from_logs.found_parts import FoundDrive, pulls_of, torque_of
from distal.from_logs.motion_data import MotionData
from distal.from_logs.stop_hits import stop_hits

NEAR = radians(1.0)
"""Angle from its end of travel within which a joint counts as in its stop [rad]. Source:
judgement.
"""

LEAST_SHARE = 0.005
"""Share of the samples in which a joint must be there [1]. Source: judgement."""

PRESSED = 5.0
"""Excess of the torque at a stop over that of free motion, in standard deviations of that. Source:
judgement.
"""

NO_STOP = 4.0
"""Angle beyond the logs where a joint has a stop on one side only [rad]. Source: definition (a rig
file has both).
"""


def joint_stops(
    joint: int, drives: Sequence[FoundDrive], logs: Sequence[MotionData]
) -> tuple[float, float] | None:
    """Return the stops of a joint [rad]; None where the logs show none.

    In free motion the torque of the tendons follows a line of the angle, give or take friction. A
    stop takes up what is beyond that. Where the logs show one stop only, the other is far beyond
    them.
    """
    pulls = pulls_of(joint, drives)
    angles = np.concatenate([log.angles[:, joint] for log in logs])
    low, high = (float(np.nanquantile(angles, share)) for share in (0.001, 0.999))
    hit_low, hit_high = stop_hits(joint, pulls, logs)
    if all(drive.effort is not None for drive, _ in pulls):
        torques = np.concatenate([torque_of(pulls, log) for log in logs])
        pressed_low, pressed_high = _pressed(angles, torques, low, high)
        hit_low = low if hit_low is None and pressed_low else hit_low
        hit_high = high if hit_high is None and pressed_high else hit_high
    if hit_low is None and hit_high is None:
        return None
    return (
        low - NO_STOP if hit_low is None else hit_low,
        high + NO_STOP if hit_high is None else hit_high,
    )


def _pressed(angles: Floats, torques: Floats, low: float, high: float) -> tuple[bool, bool]:
    """Return whether a joint is pressed at the lower and the upper end of its travel."""
    usable = np.isfinite(angles) & np.isfinite(torques)
    angles = angles[usable]
    torques = torques[usable]
    free = (angles > low + NEAR) & (angles < high - NEAR)
    if free.sum() < len(angles) / 2:
        return False, False
    line = np.polyfit(angles[free], torques[free], 1)
    excess = torques - np.polyval(line, angles)
    spread = NORMAL_MAD * float(np.median(np.abs(excess[free] - np.median(excess[free]))))
    return (
        _is_pressed(-excess[angles <= low + NEAR], spread, len(angles)),
        _is_pressed(excess[angles >= high - NEAR], spread, len(angles)),
    )


def _is_pressed(excess: Floats, spread: float, samples: int) -> bool:
    """Return whether a joint is often pressed beyond what free motion needs."""
    return bool(np.sum(excess > PRESSED * spread) > LEAST_SHARE * samples)
