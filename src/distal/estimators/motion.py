"""What a displacement-driven filter remembers of each drive's measured motion, and how it bridges what is missing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

MOTION_TIME = 0.025
"""Time constant of the mean motion of a drive [s]."""

WILD = 6.0
"""A displacement farther than this times the recent motion from where it should be is wild."""

REAL = 0.1
"""Chance that a reading that looks wild is a real jump: its square times this is doubted until the next reading."""

ON_ITS_WAY = 0.3
"""Error of a place that is led on for less than its sensor's own interval, as a share of the motion."""

MEMORY = 6
"""Numbers remembered per drive: place, doubt, mean and mean square speed, variance of the place, time without a reading."""


@dataclass(frozen=True)
class Motion:
    """A drive's motion over one interval, all scalars.

    Args:
        place: that is used at the end of the interval [m, rad].
        doubt: 1 where the last reading was taken as wild.
        speed: mean, over `MOTION_TIME`.
        square: mean square speed.
        unknown: variance of the place beyond the sensor's noise: grows while it is missing.
        lost: time since the last good reading [s].
        bend: change of displacement between two intervals: what a straight line between samples leaves out.
    """

    place: Any
    doubt: Any
    speed: Any
    square: Any
    unknown: Any
    lost: Any
    bend: Any

    def memory(self) -> list[Any]:
        """Return what is remembered for the next interval."""
        return [self.place, self.doubt, self.speed, self.square, self.unknown, self.lost]


def follow(memory: Any, reading: Any, there: Any, noise: float, interval: float, dt: Any) -> Motion:
    """Return a drive's motion after a reading; a missing or wild one is bridged by the mean speed, which fades.

    A reading is wild if it is far from where the mean speed leads, and the one before was not: a real jump, or the
    start of a fast motion, is believed at its second sample.

    Args:
        memory: of the last interval, (MEMORY,).
        reading: displacement [m, rad].
        there: 1 where it is not missing; −k in an interval without a sample, k intervals before the one with `reading`.
        noise: variance of the sensor's random error.
        interval: time between the sensor's own readings [s].
        dt: length of the interval [s].
    """
    place, doubt, speed, square, unknown, lost = (memory[i] for i in range(MEMORY))
    expected, time = place + speed * dt, lost + dt
    room = WILD * WILD * (square * time * time + unknown + 2 * noise)
    far = ca.logic_and(ca.logic_and((reading - expected) ** 2 > room, doubt < 0.5), there > 0)
    bridged = there < 0
    good = ca.logic_and(there != 0, ca.logic_not(far))
    # a gap is crossed in a straight line to the reading that ends it
    line = place + (reading - place) / ca.if_else(bridged, -there, 1)
    now = ca.if_else(bridged, line, ca.if_else(good, reading, expected))
    moved = now - place
    # what was not seen while the reading was missing belongs to all of that time
    elapsed = ca.if_else(bridged, dt, time)
    passed = ca.if_else(elapsed > 0, elapsed, 1)
    seen = ca.if_else(bridged, moved / ca.if_else(dt > 0, dt, 1), speed + (now - expected) / passed)
    share = 1 - ca.exp(-elapsed / MOTION_TIME)
    fade = ca.exp(-dt / (2 * MOTION_TIME))
    # a drive that is lost goes on as it did: its error grows with time, not with the root of time
    part = ca.if_else(time < 1.5 * interval, ON_ITS_WAY, 1)
    astray = part * part * square * time * time + noise
    jumped = ca.if_else(far, REAL * (reading - expected) ** 2, 0)
    return Motion(
        place=now,
        doubt=ca.if_else(far, 1, 0),
        speed=ca.if_else(good, speed + share * (seen - speed), speed * fade),
        square=ca.if_else(good, square + share * (seen * seen - square), square),
        unknown=ca.if_else(bridged, moved * moved, ca.if_else(good, 0, ca.fmax(unknown, astray) + jumped)),
        lost=ca.if_else(ca.logic_or(good, bridged), 0, time),
        bend=ca.if_else(good, moved - speed * dt, 0),
    )
