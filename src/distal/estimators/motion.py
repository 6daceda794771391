"""What a displacement-driven filter remembers of each drive's measured motion, and how it bridges what is missing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

MOTION_TIME = 0.025
"""Time constant of the mean motion of a drive [s]."""

WILD = 6.0
"""A displacement farther than this times the recent motion from where it should be is wild."""

MEMORY = 5
"""Numbers remembered per drive: place, doubt, mean motion, mean square motion, variance of the place."""


@dataclass(frozen=True)
class Motion:
    """A drive's motion over one interval, all scalars.

    Args:
        place: that is used at the end of the interval [m, rad].
        doubt: 1 where the last reading was taken as wild.
        mean: mean displacement per interval.
        square: mean square displacement per interval.
        unknown: variance of the place beyond the sensor's noise: grows while it is missing.
        bend: change of displacement between two intervals: what a straight line between samples leaves out.
    """

    place: Any
    doubt: Any
    mean: Any
    square: Any
    unknown: Any
    bend: Any

    def memory(self) -> list[Any]:
        """Return what is remembered for the next interval."""
        return [self.place, self.doubt, self.mean, self.square, self.unknown]


def follow(memory: Any, reading: Any, there: Any, noise: float, dt: Any) -> Motion:
    """Return a drive's motion after a reading; a missing or wild one is bridged by the mean motion, which fades.

    A reading is wild if it is far from where the mean motion leads, and the one before was not: a real jump, or the
    start of a fast motion, is believed at its second sample.

    Args:
        memory: of the last interval, (MEMORY,).
        reading: displacement [m, rad].
        there: 1 where it is not missing; −k in an interval without a sample, k intervals before the one with `reading`.
        noise: variance of the sensor's random error.
        dt: length of the interval [s].
    """
    place, doubt, mean, square, unknown = (memory[i] for i in range(MEMORY))
    expected = place + mean
    room = WILD * WILD * (square + unknown + 2 * noise)
    far = ca.logic_and(ca.logic_and((reading - expected) ** 2 > room, doubt < 0.5), there > 0)
    bridged = there < 0
    good = ca.logic_and(there != 0, ca.logic_not(far))
    # a gap is crossed in a straight line to the reading that ends it
    line = place + (reading - place) / ca.if_else(bridged, -there, 1)
    now = ca.if_else(bridged, line, ca.if_else(good, reading, expected))
    moved = now - place
    # a drive that is lost goes on as it did: its error grows with time, not with the root of time
    lost = (ca.sqrt(unknown) + ca.sqrt(square)) ** 2 + noise
    share = 1 - ca.exp(-dt / MOTION_TIME)
    known = mean + share * (moved - mean)
    return Motion(
        place=now,
        doubt=ca.if_else(far, 1, 0),
        mean=ca.if_else(good, known, mean * (1 - share)),
        square=ca.if_else(good, square + share * (moved * moved - square), square),
        unknown=ca.if_else(bridged, moved * moved, ca.if_else(good, 0, lost)),
        bend=ca.if_else(good, moved - mean, 0),
    )
