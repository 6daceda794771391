"""The possible positions of a drive, from its stops or from the range of its joint."""

from __future__ import annotations

from math import inf

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


def motor_range(rig: Rig, sensor: Sensor) -> tuple[float, float]:
    """Return the limits of a capstan's angle by the ranges of its joints, play, and what is not known of its zero [rad].

    They are infinite for other sensors, and where a joint has no stops.
    """
    drive = next((drive for drive in rig.drives if drive.name == sensor.of), None)
    if sensor.measures != "position" or drive is None or drive.kind != "capstan":
        return -inf, inf
    tendon = next(tendon for tendon in rig.tendons if tendon.drive == drive.name)
    stops = {joint.name: joint.stops for joint in rig.joints}
    low = high = sensor.bias.value
    room = 2 * sensor.bias.total_std + (2 * tendon.slack.value + BEYOND * tendon.total_arm) / drive.radius.value
    for name, arm in tendon.arms().items():
        ends = stops[name]
        if ends is None:
            return -inf, inf
        reached = sorted(tendon.winding * arm / drive.radius.value * angle for angle in ends)
        low, high = low + reached[0], high + reached[1]
    return low - room, high + room
