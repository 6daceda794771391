"""End stops of joints: at a stop, tendons pull harder than free motion there would need."""

from __future__ import annotations

from collections.abc import Sequence
from math import radians

import numpy as np

from distal.arrays import Floats
from distal.from_logs.column_values import NORMAL_MAD
from distal.from_logs.found_parts import FoundDrive, pulls_of, torque_of
from distal.from_logs.motion_data import MotionData

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
    """Return the stops of a joint [rad]; None where the logs show none, or no forces are read.

    In free motion the torque of the tendons follows a line of the angle, give or take friction. A
    stop takes up what is beyond that. Where the logs show one stop only, the other is far beyond
    them.
    """
    pulls = pulls_of(joint, drives)
    if any(drive.effort is None for drive, _ in pulls):
        return None
    angles = np.concatenate([log.angles[:, joint] for log in logs])
    torques = np.concatenate([torque_of(pulls, log) for log in logs])
    usable = np.isfinite(angles) & np.isfinite(torques)
    angles = angles[usable]
    torques = torques[usable]
    low, high = (float(np.quantile(angles, share)) for share in (0.001, 0.999))
    free = (angles > low + NEAR) & (angles < high - NEAR)
    if free.sum() < len(angles) / 2:
        return None
    line = np.polyfit(angles[free], torques[free], 1)
    excess = torques - np.polyval(line, angles)
    spread = NORMAL_MAD * float(np.median(np.abs(excess[free] - np.median(excess[free]))))
    has_high = _is_pressed(excess[angles >= high - NEAR], spread, len(angles))
    has_low = _is_pressed(-excess[angles <= low + NEAR], spread, len(angles))
    if not has_high and not has_low:
        return None
    return (low if has_low else low - NO_STOP, high if has_high else high + NO_STOP)


def _is_pressed(excess: Floats, spread: float, samples: int) -> bool:
    """Return whether a joint is often pressed beyond what free motion needs."""
    return bool(np.sum(excess > PRESSED * spread) > LEAST_SHARE * samples)
