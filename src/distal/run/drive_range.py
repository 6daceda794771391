"""The possible positions of a drive, from its stops or from the range of its joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite, radians

from distal.rig import Capstan, Rig, Sensor, drive_travel

BEYOND = 0.05
"""A drive further beyond its stops than this share of its travel is not where it can be."""

ROOM, KNOWN = radians(2.0), radians(8.0)
"""A joint is beyond its range by more than the first before it is said, of a motor whose zero is known to the second at the
joint [rad]."""

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


@dataclass(frozen=True)
class MotorEnds:
    """Between which ends a motor can be by the ranges of its joints, and what its torque adds.

    Args:
        motor: its name.
        place: index of the channel of its angle.
        torque: index of the channel of its torque.
        low: of what its sensor reads [rad]; −infinity where its one tendon only comes loose.
        high: the other end [rad].
        give: stretch of its tendon per torque [rad/(N m)].
        joint: turn of the joint for one of the motor.
    """

    motor: str
    place: int
    torque: int
    low: float
    high: float
    give: float
    joint: float


def motor_ends(rig: Rig, channels: Sequence[str]) -> tuple[MotorEnds, ...]:
    """Return the ends of the motors whose zero is known and whose joints have stops.

    In free motion a spool that slips, or a tendon that comes off, changes nothing that a motor feels; at the end of a range
    the motor is where it cannot be.
    """
    found = list[MotorEnds]()
    for drive in rig.drives:
        sensors = {
            sensor.measures: sensor for sensor in rig.sensors if sensor.of == drive.name and sensor.name in channels
        }
        if not isinstance(drive, Capstan) or not {"position", "force"} <= set(sensors):
            continue
        tendons = [tendon for tendon in rig.tendons if tendon.drive == drive.name]
        joint = drive.radius.value / tendons[0].total_arm
        low, high = motor_range(rig, sensors["position"])
        if sensors["position"].bias.total_std * joint > KNOWN or not isfinite(high):
            continue
        room, give = ROOM / joint, 1.0 / (tendons[0].stiffness.value * drive.radius.value**2)
        place, torque = (list(channels).index(sensors[kind].name) for kind in ("position", "force"))
        lowest = low - room if len(tendons) > 1 else -inf
        found.append(MotorEnds(drive.name, place, torque, lowest, high + room, give, joint))
    return tuple(found)


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
