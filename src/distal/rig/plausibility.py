"""Allowed but improbable values of a rig: a number whose unit was forgotten, a joint that nothing
turns back.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

from distal.rig.insertions import Pinned
from distal.rig.naming import in_words
from distal.rig.rig import Rig, parameters_below

USUAL: dict[str, tuple[float, float, str]] = {
    "radius": (2e-4, 0.3, "m"),
    "free_length": (1e-3, 20.0, "m"),
    "stiffness": (10.0, 1e8, "N/m"),
    "mass": (1e-5, 50.0, "kg"),
    "inertia": (1e-9, 10.0, "kg m^2"),
}
"""Kind of number → its usual range in hands, instruments and benches, and its SI unit."""


SMALLEST_STD = 1e-4
"""A std below this share of its value was probably written without its unit [1]. Source:
judgement.
"""

LARGEST_OFFSET = 2.0
"""Offsets and centres of links beyond this were probably written without their unit [m]. Source:
judgement.
"""


def doubts(rig: Rig) -> list[str]:
    """Return a sentence for each value of a rig that is allowed but is probably a mistake."""
    sentences = []
    for path, name, size in _values(rig):
        low, high, unit = USUAL[name]
        if not low <= size <= high:
            sentences.append(
                f"{in_words(rig, path)} is {size:g} {unit}; between {low:g} and {high:g} is "
                "usual: is its unit there?"
            )
    for path, parameter in chain(
        *(
            parameters_below(component, f"{kind}.{component.name}")
            for kind, components in rig.components.items()
            for component in components
        )
    ):
        std = parameter.std
        size = abs(parameter.value)
        if 0.0 < std < SMALLEST_STD * size:
            sentences.append(
                f"{in_words(rig, path)}: a std of {std:g} is {std / size:.1g} of its value: is "
                "its unit there?"
            )
    for joint in rig.joints:
        away = max(
            abs(part)
            for part in (*joint.offset, *(joint.link.centre if joint.link is not None else ()))
        )
        if away > LARGEST_OFFSET:
            sentences.append(
                f"joint {joint.name} sits or weighs {away:g} m away; is its unit there?"
            )
        swings = joint.coupled is None and joint.damping.absent and joint.friction is None
        if rig.is_chain and len(rig.joints) > 1 and swings:
            sentences.append(
                f"joint {joint.name} has neither friction nor damping: nothing stops it from "
                "swinging"
            )
    for drive in rig.drives:
        if not any(
            sensor.measures == "position" and sensor.of == drive.name for sensor in rig.sensors
        ):
            sentences.append(
                f"drive {drive.name} has no position sensor: its place has to be guessed from "
                "forces"
            )
    rubbing = {
        tendon.name for tendon in rig.tendons if tendon.path is not None and tendon.path.nodes == 0
    }
    for sensor in rig.sensors:
        if sensor.measures == "tension" and sensor.of in rubbing:
            sentences.append(
                f"sensor {sensor.name} measures the tension of tendon {sensor.of} behind the "
                "friction of its path, at the "
                "joint; a cell at the motor's end measures the 'force' of its drive: which is it?"
            )
        if sensor.measures == "force" and getattr(sensor, "lever", None) is not None:
            windings = [tendon.winding for tendon in rig.tendons if tendon.drive == sensor.of]
            if len(windings) > 1:
                sentences.append(
                    f"sensor {sensor.name} is a load cell in one tendon, but {sensor.of} pulls "
                    f"{len(windings)}, whose "
                    "tensions together are its torque: measure the 'tension' of each"
                )
            elif windings == [-1] and sensor.sign == 1:
                sentences.append(
                    f"sensor {sensor.name} is a load cell in a tendon on side -1, where a pull is "
                    "a negative torque: "
                    "is sign = -1 missing?"
                )
    for joint in rig.joints:
        arms = [tendon.arms().get(joint.name, 0.0) for tendon in rig.tendons]
        sides = {1 if arm > 0.0 else -1 for arm in arms if arm != 0.0}
        turned = (joint.spring, joint.extension_spring, joint.gravity, joint.link, joint.coupled)
        if len(sides) == 1 and not any(turned) and joint.external_torque.std == 0.0:
            sentences.append(
                f"all tendons of '{joint.name}' have side = {sides.pop()}, and no spring turns it "
                "back: is one side wrong?"
            )
    return sentences


def _values(rig: Rig) -> Iterator[tuple[str, str, float]]:
    """Yield path, kind and value [SI] of the numbers that have a usual size."""
    for joint in rig.joints:
        yield f"joints.{joint.name}.inertia", "inertia", joint.inertia.value
    for drive in rig.drives:
        name = "inertia" if drive.kind == "capstan" else "mass"
        yield f"drives.{drive.name}.{name}", name, getattr(drive, name).value
        if drive.kind == "capstan":
            yield f"drives.{drive.name}.radius", "radius", drive.radius.value
    for tendon in rig.tendons:
        yield f"tendons.{tendon.name}.stiffness", "stiffness", tendon.stiffness.value
        for at, shape in tendon.shapes():
            yield f"tendons.{tendon.name}.{at}.radius", "radius", shape.radius.value
            if isinstance(shape, Pinned):
                yield (
                    f"tendons.{tendon.name}.{at}.free_length",
                    "free_length",
                    shape.free_length.value,
                )
