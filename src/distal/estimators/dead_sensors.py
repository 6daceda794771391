"""When a sensor is dead: silent for so long, or, to the health of a stream, stuck at one value."""

from __future__ import annotations

from distal.rig import Sensor

DEAD = 0.5
DEAD_INTERVALS = 5.0
"""A sensor without a value for so long, at least [s] and in intervals of its own, is dead: it may
not come back.
"""


def dead_after(sensor: Sensor) -> float:
    """Return after which time without a value a sensor is dead [s]."""
    return max(DEAD, DEAD_INTERVALS / sensor.rate)
