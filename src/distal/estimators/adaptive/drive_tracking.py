"""Track the drives: where each is and how it moves, from readings that may be missing or wild. Equations (1) to (6).

What is remembered of a drive: place, doubt, mean and mean square speed, variance of the place, time without a reading.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from distal.estimators.adaptive.robustness import Robustness, is_wild
from distal.estimators.adaptive.setup import Setup

MOTION_TIME = 0.025
"""Time constant of the mean motion of a drive [s]: two to five samples at 100 to 200 Hz."""

REMEMBERED = ("place", "doubt", "speed", "square", "unknown", "lost")
"""Names of the numbers that are remembered of each drive."""

MEMORY, UNKNOWN = len(REMEMBERED), REMEMBERED.index("unknown")

TRACKED = (*REMEMBERED, "bend", "variance")
"""Names of the numbers that are known of each drive after a reading."""


@dataclass(frozen=True)
class Drive:
    """What is known of a drive after a reading, all scalars.

    Args:
        place: that its sensor reads or should read, at the end of the interval [m, rad].
        doubt: 1 where the last reading was taken as wild.
        speed: mean, over `MOTION_TIME`.
        square: mean square speed.
        unknown: variance of the place beyond the sensor's noise: grows while it is missing.
        lost: time since the last good reading [s].
        bend: change of displacement between two intervals: what a straight line between samples leaves out.
        variance: of the place, for the filter: noise, what is unknown, what a straight line misses.
    """

    place: Any
    doubt: Any
    speed: Any
    square: Any
    unknown: Any
    lost: Any
    bend: Any
    variance: Any


class Tracks:
    """All drives' numbers as one vector: what is remembered of each, drive by drive, then bends, then variances.

    Args:
        vector: (n_tracks,).
        n_drives: number of drives.
    """

    def __init__(self, vector: Any, n_drives: int) -> None:
        self.vector, self._n = vector, n_drives

    @staticmethod
    def size(n_drives: int) -> int:
        """Return the length of the vector.

        Args:
            n_drives: number of drives.
        """
        return len(TRACKED) * n_drives

    def __getitem__(self, drive: int) -> Drive:
        """Return one drive's numbers."""
        numbers = [self.vector[MEMORY * drive + i] for i in range(MEMORY)]
        numbers += [self.vector[(MEMORY + i) * self._n + drive] for i in range(2)]
        return Drive(**dict(zip(TRACKED, numbers)))

    @property
    def memory(self) -> Any:
        """What is remembered for the next interval, (MEMORY n_drives,)."""
        return self.vector[: MEMORY * self._n]

    @property
    def variances(self) -> Any:
        """Variances of the places, (n_drives,)."""
        return self.vector[(MEMORY + 1) * self._n :]


def tracking(setup: Setup) -> ca.Function:
    """Return (memory, x, p) → tracks of all drives; see `Tracks`. A drive that nothing measures has zeros.

    Args:
        setup: the rig.
    """
    n, p = setup.n_drives, setup.mechanism.parameters.symbols
    memory, x = ca.SX.sym("memory", MEMORY * n), ca.SX.sym("x", setup.width)
    drives = []
    for i in range(n):
        sensor = setup.position_sensor(i)
        if sensor is None:
            drives.append(Drive(*(ca.SX(0) for _ in TRACKED)))
            continue
        remembered = memory[MEMORY * i : MEMORY * (i + 1)]
        reading, there = setup.value(x, sensor), setup.mask(x, sensor)
        drives.append(track(remembered, reading, there, setup.noise(sensor), x[0], setup.robustness))
    kept = [getattr(drive, name) for drive in drives for name in REMEMBERED]
    vector = ca.vertcat(*kept, *(drive.bend for drive in drives), *(drive.variance for drive in drives))
    return ca.Function("track", [memory, x, p], [ca.cse(ca.densify(vector))])


def track(memory: Any, reading: Any, there: Any, noise: Any, dt: Any, robustness: Robustness) -> Drive:
    """Return a drive after a reading; a missing or wild one is bridged by the mean speed, which fades.

    A reading is wild if it is far from where the mean speed leads, and the one before was not: a real jump, or the
    start of a fast motion, is believed at its second sample.

    Args:
        memory: of the last interval, (MEMORY,).
        reading: displacement [m, rad].
        there: 1 where it is not missing; −k in an interval without a sample, k intervals before the one with `reading`.
        noise: variance of the sensor's random error.
        dt: length of the interval [s].
        robustness: the guards.
    """
    place, doubt, speed, square, unknown, lost = (memory[i] for i in range(MEMORY))
    expected, time = place + speed * dt, lost + dt
    # (1) wild: farther than the recent motion can have led
    far = is_wild(robustness, reading - expected, square * time * time + unknown, noise)
    wild = ca.logic_and(ca.logic_and(far, doubt < 0.5), there > 0)
    bridged = there < 0
    good = ca.logic_and(there != 0, ca.logic_not(wild))
    # (2) a gap is crossed in a straight line to the reading that ends it
    line = place + (reading - place) / ca.if_else(bridged, -there, 1)
    now = ca.if_else(bridged, line, ca.if_else(good, reading, expected))
    moved = now - place
    # (3) mean motion; what was not seen while the reading was missing belongs to all of that time
    elapsed = ca.if_else(bridged, dt, time)
    passed = ca.if_else(elapsed > 0, elapsed, 1)
    seen = ca.if_else(bridged, moved / ca.if_else(dt > 0, dt, 1), speed + (now - expected) / passed)
    share = 1 - ca.exp(-elapsed / MOTION_TIME)
    fade = ca.exp(-dt / (2 * MOTION_TIME))
    # (4) a drive that is lost goes on as it did: its error grows with time, not with the root of time
    astray = square * time * time + noise
    jumped = ca.if_else(wild, robustness.real_jump * (reading - expected) ** 2, 0)
    unknown = ca.if_else(bridged, moved * moved, ca.if_else(good, 0, ca.fmax(unknown, astray) + jumped))
    # (5), (6) what a straight line between samples misses
    bend = ca.if_else(good, moved - speed * dt, 0)
    return Drive(
        place=now,
        doubt=ca.if_else(wild, 1, 0),
        speed=ca.if_else(good, speed + share * (seen - speed), speed * fade),
        square=ca.if_else(good, square + share * (seen * seen - square), square),
        unknown=unknown,
        lost=ca.if_else(ca.logic_or(good, bridged), 0, time),
        bend=bend,
        variance=noise + unknown + (robustness.bend_share * bend) ** 2,
    )
