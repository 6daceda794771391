"""The possible positions of a drive, by its own stops or by the range of its joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, radians, sqrt

from distal.rig.drives import Capstan
from distal.rig.rig import Rig
from distal.rig.sensors import Sensor, drive_travel

BEYOND = 0.05
"""Share of its travel by which a drive may read beyond its stops [1]; in `motor_range` the angle by
which a joint may be beyond its own [rad]. Source: judgement.
"""

ROOM = radians(1.5)
"""Angle by which a joint may seem to be beyond its range, at least [rad]. Source: benchmark
(docs/results/hands.md).
"""

ROOM_STDS = 0.7
"""The same, added to that in stds of the joint's zero and play [1]. Source: benchmark
(docs/results/hands.md).
"""

KNOWN = radians(8.0)
"""A motor's zero counts as known if its std, at the joint, is not above this [rad]. Source:
benchmark (docs/results/hands.md).
"""

FAR = 10.0
"""Number of times its joint's range by which a drive without stops may be beyond it [1]. Source:
judgement.
"""


def position_range(rig: Rig, sensor: Sensor) -> tuple[float, float]:
    """Return the lowest and highest possible value of a position sensor [m, rad]; ∓1e300 for other
    sensors.
    """
    if sensor.measures != "position":
        return -1e300, 1e300
    drive = rig.drive(sensor.of)
    low, high = drive_travel(rig, rig.drives.index(drive))
    room = (
        (BEYOND if drive.stops is not None else FAR) * (high - low)
        + sensor.linearity
        + 10.0 * sensor.noise
    )
    return low - room + sensor.bias.value, high + room + sensor.bias.value


@dataclass(frozen=True)
class RangeEnd:
    """One end of a motor's range: the tendon becomes taut with the joint at its stop.

    Args:
        motor: name of the drive.
        position: index of the channel of the motor's angle.
        torque: index of the channel of its torque.
        way: 1 where readings grow towards the end, else −1.
        contact: `way` times the reading at the end [rad].
        room: how far the joint may seem to be beyond the end, because zero and play are not known
            exactly [rad].
        give: turn of the motor per torque by the stretch of its tendon [rad/(N m)].
        joint: turn of the joint per turn of the motor.
        same: readings that differ by less count as one position [rad].
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
    """Return the ends of the ranges of motors whose zero is known and whose joints have stops.

    They serve to find a spool that slipped or a tendon that came off: in free motion the torque
    shows little of that, but at an end the motor then turns further than its joint can. Only the
    end towards which a tendon is wound counts.
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
        for tendon in rig.tendons_of(drive.name):
            way = tendon.winding
            joint = drive.radius.value / tendon.total_arm
            if reached is None or position_sensor.bias.total_std * joint > KNOWN:
                continue
            end = max(way * reading for reading in reached)
            loose = tendon.loose
            # zero and play were found at the ends of the ranges: an error of these ranges is in
            # them already, and cancels at the ends
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
    """Return the lowest and highest reading of a capstan's angle sensor [rad].

    They follow from the stops of the joints, from play, and from the uncertainty of the zero; they
    are infinite for other sensors, and where a joint has no stops.
    """
    drive = next((drive for drive in rig.drives if drive.name == sensor.of), None)
    if sensor.measures != "position" or drive is None or drive.kind != "capstan":
        return -inf, inf
    reached = _reached(rig, sensor)
    tendon = rig.tendons_of(drive.name)[0]
    if reached is None:
        return -inf, inf
    room = (
        2 * sensor.bias.total_std
        + (2 * tendon.slack.value + BEYOND * tendon.total_arm) / drive.radius.value
    )
    return reached[0] - room, reached[1] + room


def _reached(rig: Rig, sensor: Sensor) -> tuple[float, float] | None:
    """Return what a capstan's position sensor reads with its joints at their stops [rad], None
    where a joint has no stop.
    """
    drive = rig.drive(sensor.of)
    assert isinstance(drive, Capstan)
    tendon = rig.tendons_of(drive.name)[0]
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
