"""What a hand's motors say while it runs: places where no joint could be, after a slip or with a tendon that came off."""

from __future__ import annotations

from math import degrees

import numpy as np

from distal.arrays import Floats
from distal.hands.sweeps import channels_of
from distal.rig import Capstan, Rig
from distal.run import motor_range

ROOM = np.deg2rad(2.0)
"""A joint is beyond its range by more than this before it is said [rad]."""


KNOWN = np.deg2rad(8.0)
"""Of a motor whose zero is less well known than this at the joint nothing is said [rad]."""


class RangeWatch:
    """Finds motors that are beyond what the ranges of their joints, play and stretch allow.

    In free motion a spool that slips changes nothing that a motor feels; at the end of a range it does.

    Args:
        rig: of the hand; best calibrated, since what is not known of a zero is allowed twice.
    """

    def __init__(self, rig: Rig, channels: tuple[str, ...]) -> None:
        self._motors = list[tuple[str, int, int, float, float, float, float]]()
        for drive in rig.drives:
            if not isinstance(drive, Capstan):
                continue
            place, torque = channels_of(rig, drive.name)
            sensor = next(sensor for sensor in rig.sensors if sensor.name == place)
            tendons = [tendon for tendon in rig.tendons if tendon.drive == drive.name]
            if sensor.bias.total_std * drive.radius.value > KNOWN * tendons[0].total_arm:
                continue  # where its zero is, is not known: a routine finds it
            low, high = motor_range(rig, sensor)
            arm, radius = tendons[0].total_arm, drive.radius.value
            # a torque stretches the tendon that it pulls; one that only loosens a single tendon is no fault
            give = 1.0 / (tendons[0].stiffness.value * radius**2)
            lowest = low if len(tendons) == 2 else -np.inf
            ends = lowest - ROOM * arm / radius, high + ROOM * arm / radius
            at = channels.index(place), channels.index(torque)
            self._motors.append((drive.name, *at, *ends, give, radius / arm))

    def beyond(self, sample: Floats) -> dict[str, float]:
        """Return motor → by how much its joint would be beyond its range [deg], of those that are.

        Args:
            sample: in SI, (n_channels,).
        """
        found = dict[str, float]()
        for name, place, torque, low, high, give, ratio in self._motors:
            stretch = give * abs(float(sample[torque])) if np.isfinite(sample[torque]) else 0.0
            over = max(float(sample[place]) - high, low - float(sample[place])) - stretch
            if over > 0.0:
                found[name] = degrees(over * ratio)
        return found
