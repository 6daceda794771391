"""The possible positions of a drive, from its stops or from the range of its joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, radians, sqrt

from distal.rig import Capstan, Rig, Sensor, drive_travel

BEYOND = 0.05
"""A drive further beyond its stops than this share of its travel is not where it can be."""

ROOM = radians(1.5)
ROOM_STDS = 0.7
KNOWN = radians(8.0)
"""A joint is beyond its range by more than the first, and so many stds of its zero and play, before
it is said; of a motor whose zero is known to the third at the joint [rad]: docs/results/hands.md.
"""

FAR = 10.0
"""A drive without stops this many times as far as the joint could turn it is not where it can be.
"""


def position_range(rig: Rig, sensor: Sensor) -> tuple[float, float]:
    """Return the limits of a position sensor's values, infinite for other sensors."""
    if sensor.measures != "position":
        return -1e300, 1e300
    drive = next(drive for drive in rig.drives if drive.name == sensor.of)
    low, high = drive_travel(rig, rig.drives.index(drive))
    room = (
        (BEYOND if drive.stops is not None else FAR) * (high - low)
        + sensor.linearity
        + 10.0 * sensor.noise
    )
    return low - room + sensor.bias.value, high + room + sensor.bias.value


@dataclass(frozen=True)
class RangeEnd:
    """One end of a motor's travel: where its tendon becomes taut with the joint at its stop.

    Args:
        motor: its name.
        position: index of the channel of its angle.
        torque: index of the channel of its torque.
        way: 1 where readings grow towards it, else −1.
        contact: `way` times the reading there [rad].
        room: how far beyond it the motor may be, by what is not known of it, at the joint [rad].
        give: stretch of its tendon per torque [rad/(N m)].
        joint: turn of the joint for one of the motor.
        same: readings that differ by less are one position [rad].
    """

    motor: str
    position: int
    torque: int
    way: int
    contact: float
    room: float
    give: float
    joint: float
    same: float


def range_ends(rig: Rig, channels: Sequence[str]) -> tuple[RangeEnd, ...]:
    """Return the ends of the motors whose zero is known and whose joints have stops.

    In free motion a spool that slips, or a tendon that comes off, changes little that a motor
    feels; at the end of a range it is where it cannot be. What lets a tendon out alone has no end.
    """
    found = list[RangeEnd]()
    for drive in rig.drives:
        sensors = {
            sensor.measures: sensor
            for sensor in rig.sensors
            if sensor.of == drive.name and sensor.name in channels
        }
        if not isinstance(drive, Capstan) or not {"position", "force"} <= set(sensors):
            continue
        position_sensor = sensors["position"]
        position, torque = (
            list(channels).index(sensors[kind].name) for kind in ("position", "force")
        )
        reached = _reached(rig, position_sensor)
        for tendon in (tendon for tendon in rig.tendons if tendon.drive == drive.name):
            way = tendon.winding
            joint = drive.radius.value / tendon.total_arm
            if reached is None or position_sensor.bias.total_std * joint > KNOWN:
                continue
            end = max(way * reading for reading in reached)
            loose = tendon.slack.value - tendon.pretension.value / tendon.stiffness.value
            # numbers that were found at the ends of the ranges are wrong together: there, what is
            # not known of the ranges makes no difference
            ranges = max(part.stops_std for part in rig.joints if part.name in tendon.arms())
            stds = position_sensor.bias.total_std * joint, tendon.slack.total_std / tendon.total_arm
            unsure = sqrt(sum(max(std**2 - ranges**2, 0.0) for std in stds))
            found.append(
                RangeEnd(
                    motor=drive.name,
                    position=position,
                    torque=torque,
                    way=way,
                    contact=end + loose / drive.radius.value,
                    room=ROOM + ROOM_STDS * unsure,
                    give=1.0 / (tendon.stiffness.value * drive.radius.value**2),
                    joint=joint,
                    same=position_sensor.noise,
                )
            )
    return tuple(found)


def motor_range(rig: Rig, sensor: Sensor) -> tuple[float, float]:
    """Return the limits of a capstan's angle by the ranges of its joints, play, and what is not
    known of its zero [rad].

    They are infinite for other sensors, and where a joint has no stops.
    """
    drive = next((drive for drive in rig.drives if drive.name == sensor.of), None)
    if sensor.measures != "position" or drive is None or drive.kind != "capstan":
        return -inf, inf
    reached = _reached(rig, sensor)
    tendon = next(tendon for tendon in rig.tendons if tendon.drive == drive.name)
    if reached is None:
        return -inf, inf
    room = (
        2 * sensor.bias.total_std
        + (2 * tendon.slack.value + BEYOND * tendon.total_arm) / drive.radius.value
    )
    return reached[0] - room, reached[1] + room


def _reached(rig: Rig, sensor: Sensor) -> tuple[float, float] | None:
    """Return what a capstan's position sensor reads with its joints at their stops [rad], None
    where one has none.
    """
    drive = next(drive for drive in rig.drives if drive.name == sensor.of)
    assert isinstance(drive, Capstan)
    tendon = next(tendon for tendon in rig.tendons if tendon.drive == drive.name)
    stops = {joint.name: joint.stops for joint in rig.joints}
    low = high = sensor.bias.value
    for name, arm in tendon.arms().items():
        ends = stops[name]
        if ends is None:
            return None
        reached = sorted(tendon.winding * arm / drive.radius.value * angle for angle in ends)
        low = low + reached[0]
        high = high + reached[1]
    return low, high
