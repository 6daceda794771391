"""The possible positions of a drive, from its stops or from the range of its joint."""

from __future__ import annotations

from distal.rig import Rig, Sensor, drive_travel

BEYOND = 0.05
"""A drive further beyond its stops than this share of its travel is not where it can be."""

FAR = 10.0
"""A drive without stops this many times as far as the joint could turn it is not where it can be."""


def place_range(rig: Rig, sensor: Sensor) -> tuple[float, float]:
    """Return the limits of a position sensor's values, infinite for other sensors."""
    if sensor.measures != "position":
        return -1e300, 1e300
    drive = next(drive for drive in rig.drives if drive.name == sensor.of)
    low, high = drive_travel(rig, rig.drives.index(drive))
    room = (BEYOND if drive.stops is not None else FAR) * (high - low) + sensor.linearity + 10.0 * sensor.noise
    return low - room + sensor.bias.value, high + room + sensor.bias.value
