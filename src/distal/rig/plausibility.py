"""The numbers of a rig by their path, and how far they can be trusted: known to a factor only,
taken and not measured, or allowed but improbable; and the possible positions of a drive, by its
own stops or by the range of its joint.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf, radians, sqrt
from typing import Literal

from distal.errors import CommandError, RigError, did_you_mean
from distal.rig.rig import Rig, parameters_below
from distal.rig.sensors import Sensor, drive_travel, positions_over
from distal.rig.validation import in_words, index_of, names_in
from distal.rig.values_with_stds import In, Parameter

ROUGH = 0.5
"""Share of its value above which the std of a positive number means that the number is known to a
factor only [1]. Source: judgement.
"""

ROUGH_ARM = 0.2
"""The same share for a moment arm [1]. Source: judgement."""


def known_to_a_factor(path: str, value: float, std: float) -> bool:
    """Return whether the positive number at a path is known to a factor only: its `std` is above
    `ROUGH` of its `value`, of a moment arm above `ROUGH_ARM`.
    """
    # readings show only the product of a moment arm with an angle
    is_arm = (
        ".insertion." in path
        or ".crossings." in path
        or (path.startswith("drives.") and path.endswith(".radius"))
    )
    return std > (ROUGH_ARM if is_arm else ROUGH) * value > 0.0


@dataclass(frozen=True)
class Number:
    """A number of a description.

    Args:
        path: keys and indices joined by dots, names of parts replaced by their indices.
        quantity: its unit and bound.
        parameter: the number as one that may have a std.
        is_parameter: whether it may have one.
    """

    path: str
    quantity: In
    parameter: Parameter
    is_parameter: bool

    @property
    def value(self) -> float:
        """The value in SI."""
        return self.parameter.value

    @property
    def std(self) -> float:
        """The std of all that is not known of the value; 0 where it has none."""
        return self.parameter.total_std

    @property
    def is_rough(self) -> bool:
        """Whether the number is known to a factor only and must be positive: its prior is then
        log-normal.
        """
        return self.quantity.bound == "positive" and known_to_a_factor(
            self.path, self.value, self.std
        )


def number(rig: Rig, path: str) -> Number:
    """Return a number of a rig by its path, which names parts by index or by name, as in ``--set``.

    Raises:
        RigError: the path leads nowhere, or to what is no number with a unit.
    """
    part: object = rig
    quantity: In | None = None
    keys: list[str] = []
    for key in path.split("."):
        fields = getattr(type(part), "model_fields", {})
        index = index_of(part, key) if isinstance(part, tuple) else None
        if key in fields:
            quantity = next((m for m in fields[key].metadata if isinstance(m, In)), None)
            part = getattr(part, key)
        elif isinstance(part, tuple) and index is not None:
            part = part[index]
            key = str(index)
        else:
            allowed = names_in(part) if isinstance(part, tuple) else fields
            raise RigError(f"'{path}': there is no '{key}'{did_you_mean(key, allowed)}")
        keys.append(key)
    if quantity is None or not isinstance(part, (Parameter, int, float)):
        raise RigError(
            f"'{path}' is not a number with a unit; give the path of one, e.g. "
            f"joints.{rig.joints[0].name}.inertia"
        )
    known = part if isinstance(part, Parameter) else Parameter(value=part)
    return Number(".".join(keys), quantity, known, known is part)


SETTLED_BY = {
    "force": "one true force: a spring scale on a tendon, or a motor's torque constant",
    "length": "one true length: the diameter of a spool, or of a pulley at a joint",
}
"""Scale → the single measurement that settles it."""


def scales_in_words(rig: Rig) -> str:
    """Return a sentence on the scales that were taken, empty where all are known."""
    if not rig.taken:
        return ""
    which = " and ".join(rig.taken)
    wanting = "; ".join(SETTLED_BY[scale] for scale in rig.taken)
    return (
        f"the scale of {which} of '{rig.name}' is assumed, not measured: angles do not depend on "
        "it, forces, torques and stiffnesses do. One measurement settles it: "
        f"{wanting}. Correct it in the rig file and remove it from 'taken'"
    )


def check_scales(rig: Rig, purpose: str, needs: Literal["tension", "torque"]) -> None:
    """Check that what a purpose needs has a true scale.

    Args:
        rig: with the scales that were taken.
        purpose: what is refused otherwise, which begins the message.
        needs: a torque needs the scale of force only, a tension that of length too.

    Raises:
        CommandError: a scale that it needs was taken, or the rig's filter could not follow logs.
    """
    if rig.map is not None and rig.map.alone:
        raise CommandError(
            f"{purpose} needs a filter, and that of '{rig.name}' could not follow the logs of its "
            "fit. Fit again to other logs, or from a rig file with better values"
        )
    if set(rig.taken) & ({"force", "length"} if needs == "tension" else {"force"}):
        raise CommandError(f"{purpose} needs a true {needs}, but {scales_in_words(rig)}")


USUAL: dict[str, tuple[float, float, str]] = {
    "radius": (2e-4, 0.3, "m"),
    "free_length": (1e-3, 20.0, "m"),
    "stiffness": (10.0, 1e8, "N/m"),
    "mass": (1e-5, 50.0, "kg"),
    "inertia": (1e-9, 10.0, "kg m^2"),
    "offset": (0.0, 2.0, "m"),
}
"""Last key of a path → the usual range of such numbers in hands, instruments and benches, in this
SI unit."""


def doubts(rig: Rig) -> Iterator[str]:
    """Yield a sentence for each value of a rig that is allowed but is probably a mistake."""
    for path, parameter in parameters_below(rig):
        size = abs(parameter.value)
        low, high, unit = USUAL.get(path.rpartition(".")[2], (0.0, inf, ""))
        is_usual = size == 0.0 or low <= size <= high
        if not is_usual and number(rig, path).quantity.si == unit:
            yield (
                f"{in_words(rig, path)} is {size:g} {unit}; between {low:g} and {high:g} is "
                "usual: is its unit there?"
            )
    for joint in rig.joints:
        away = max(
            abs(part)
            for part in (*joint.offset, *(joint.link.centre if joint.link is not None else ()))
        )
        if away > USUAL["offset"][1]:
            yield (f"joint {joint.name} sits or weighs {away:g} m away; is its unit there?")
        swings = joint.coupled is None and joint.damping.absent and joint.friction is None
        if rig.is_chain and len(rig.joints) > 1 and swings:
            yield (
                f"joint {joint.name} has neither friction nor damping: nothing stops it from "
                "swinging"
            )
    for drive in rig.drives:
        if drive.name not in [sensor.of for sensor in rig.sensors_of("position")]:
            yield (
                f"drive {drive.name} has no position sensor: its place has to be guessed from "
                "forces"
            )
    yield from _doubted_sensors(rig)
    for joint in rig.joints:
        arms = [tendon.arms().get(joint.name, 0.0) for tendon in rig.tendons]
        sides = {1 if arm > 0.0 else -1 for arm in arms if arm != 0.0}
        turned = (joint.spring, joint.extension_spring, joint.gravity, joint.link, joint.coupled)
        if len(sides) == 1 and not any(turned) and joint.external_torque.std == 0.0:
            yield (
                f"all tendons of '{joint.name}' have side = {sides.pop()}, and no spring turns it "
                "back: is one side wrong?"
            )


def _doubted_sensors(rig: Rig) -> Iterator[str]:
    """Yield a sentence for each sensor of a force that seems to be elsewhere than the rig says."""
    rubbing = {
        tendon.name for tendon in rig.tendons if tendon.path is not None and tendon.path.nodes == 0
    }
    for sensor in rig.sensors:
        if sensor.measures == "tension" and sensor.of in rubbing:
            yield (
                f"sensor {sensor.name} measures the tension of tendon {sensor.of} behind the "
                "friction of its path, at the "
                "joint; a cell at the motor's end measures the 'force' of its drive: which is it?"
            )
        if sensor.measures == "force" and getattr(sensor, "lever", None) is not None:
            windings = [tendon.winding for tendon in rig.tendons_of(sensor.of)]
            if len(windings) > 1:
                yield (
                    f"sensor {sensor.name} is a load cell in one tendon, but {sensor.of} pulls "
                    f"{len(windings)}, whose "
                    "tensions together are its torque: measure the 'tension' of each"
                )
            elif windings == [-1] and sensor.sign == 1:
                yield (
                    f"sensor {sensor.name} is a load cell in a tendon on side -1, where a pull is "
                    "a negative torque: "
                    "is sign = -1 missing?"
                )


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
        if not {"position", "force"} <= set(sensors):
            continue
        position_sensor = sensors["position"]
        position, torque = (
            list(channels).index(sensors[kind].name) for kind in ("position", "force")
        )
        reached = _reached(rig, position_sensor)
        if reached is None:
            continue
        for tendon in rig.tendons_of(drive.name):
            way = tendon.winding
            joint = drive.lever / tendon.total_arm
            if position_sensor.bias.total_std * joint > KNOWN:
                continue
            end = max(way * reading for reading in reached)
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
                    contact=end + tendon.loose / drive.lever,
                    room=ROOM + ROOM_STDS * unsure,
                    give=1.0 / (tendon.stiffness.value * drive.lever**2),
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
    reached = _reached(rig, sensor)
    if reached is None:
        return -inf, inf
    tendon = rig.tendons_of(sensor.of)[0]
    play = 2 * tendon.slack.value + BEYOND * tendon.total_arm
    room = 2 * sensor.bias.total_std + play / rig.drive(sensor.of).lever
    return reached[0] - room, reached[1] + room


def _reached(rig: Rig, sensor: Sensor) -> tuple[float, float] | None:
    """Return what a capstan's position sensor reads with its joints at their stops [rad], None
    for another sensor and where a joint has no stop.
    """
    if sensor.measures != "position":
        return None
    drive = rig.drive(sensor.of)
    tendon = rig.tendons_of(drive.name)[0]
    stops = [joint.stops for joint in rig.joints if joint.name in tendon.joints]
    if drive.kind != "capstan" or None in stops:
        return None
    return positions_over(rig, drive, tendon, sensor.bias.value)
