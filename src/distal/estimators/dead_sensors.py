"""The time after which a silent sensor counts as dead; for the health of a stream, also one stuck
at one value.
"""

from __future__ import annotations

from distal.rig import Sensor

DEAD = 0.5
"""Shortest time without a value after which a sensor is dead [s]: it may not come back. Source:
judgement.
"""

DEAD_INTERVALS = 5.0
"""Smallest number of its own intervals without a value after which a sensor is dead [1]. Source:
judgement.
"""


def dead_after(sensor: Sensor) -> float:
    """Return the time without a value after which a sensor is dead [s]: `DEAD`, or `DEAD_INTERVALS`
    of its own intervals where that is longer.
    """
    return max(DEAD, DEAD_INTERVALS / sensor.rate)
