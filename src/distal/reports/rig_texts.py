"""What a drawing of a rig says of each part: kind, sizes, stops, sensors and moment arms."""

from __future__ import annotations

from collections.abc import Iterable

from distal.rig import (
    Capstan,
    Joint,
    Rig,
    Slider,
    Tendon,
    measurand_of,
    number,
    part_at,
    part_of,
    position_unit,
)
from distal.units import plain_number, quantity

SIZES = (
    "radius",
    "stiffness",
    "pretension",
    "slack",
    "path.friction",
    "path.wrap",
    "coupled.ratio",
    "coupled.offset",
    "spring.stiffness",
    "spring.rest_angle",
    "extension_spring.stiffness",
    "extension_spring.free_length",
    "extension_spring.radius",
    "extension_spring.distance",
    "extension_spring.line_angle",
    "friction.constant",
    "friction.load",
    "friction.coefficient",
    "friction.radius",
    "backlash.width",
    "link.mass",
    "gravity.mass",
    "gravity.distance",
    "gravity.hanging_angle",
)
"""Keys of a drive, tendon or joint whose numbers are drawn, where it has them and they are not
zero.
"""


def vector(components: Iterable[float]) -> str:
    """Return the text of a vector, such as "[45, 0, 0]"."""
    return f"[{', '.join(map(plain_number, components))}]"


def texts_of(rig: Rig, kind: str, index: int) -> tuple[str, ...]:
    """Return the lines on a joint, drive or tendon: its name, sizes, stops and sensors.

    Args:
        kind: list of the rig that holds the part: joints, drives or tendons.
        index: index of the part in this list.
    """
    part = rig.components[kind][index]
    texts = [part.name]
    unit = "rad"
    if isinstance(part, Joint):
        texts += _position(rig, index)
    elif isinstance(part, Tendon):
        drive = rig.drive(part.drive)
        sign = "−" if drive.kind == "capstan" and part.winding < 0 else "+"
        texts.append(f"pulled in by {sign}{'φ' if drive.kind == 'capstan' else 'x'}")
    elif isinstance(part, (Slider, Capstan)):
        texts.append(part.kind)
        unit = position_unit(part)
    for key in SIZES:
        if part_at(part, key) is not None:
            size = number(rig, f"{kind}.{index}.{key}")
            words = key.replace(".", " ").replace("_", " ")
            if size.value != 0.0:
                texts.append(f"{words} {quantity(size.value, size.quantity.si)}")
    stops = getattr(part, "stops", None)
    if stops is not None:
        texts.append(f"stops {' … '.join(quantity(stop, unit) for stop in stops)}")
    for sensor in rig.sensors:
        if measurand_of(sensor).of == kind and part_of(sensor, rig) == index:
            gear = getattr(sensor, "gear", 1.0)
            before = "" if gear == 1.0 else f", gear {plain_number(gear)}"
            texts.append(f"◉ {sensor.name}: {sensor.measures}{before}")
    return tuple(texts)


def _position(rig: Rig, index: int) -> list[str]:
    """Return on which link a joint sits, its axis there, and which joint it follows."""
    joint = rig.joints[index]
    parent = rig.parent_of(index)
    below = "base" if parent is None else rig.joints[parent].name
    parts = (f"{part:+.2g}{name}" for name, part in zip("xyz", joint.axis) if abs(part) > 0.005)
    axis = " ".join(parts).replace("+1", "+").replace("-1", "−").replace("-", "−")
    texts = [f"on {below}, axis {axis.removeprefix('+')}"]
    if any(joint.offset):
        texts.append(f"at {vector(1e3 * part for part in joint.offset)} mm")
    if joint.coupled is not None:
        texts.append(f"coupled to {joint.coupled.joint}")
    return texts


def arm_texts(tendon: Tendon, joint: Joint) -> tuple[str, ...]:
    """Return the lines on a tendon's moment arm at a joint: at zero, at the ends of the joint's
    travel where it differs there, and how they meet unless by a pulley.
    """

    def signed(angle: float) -> str:
        arm = tendon.arms({joint.name: angle})[joint.name]
        return f"{'+' if arm > 0.0 else ''}{quantity(arm, 'm')}"

    at_zero = signed(0.0)
    changed = [angle for angle in joint.travel if signed(angle) != at_zero]
    ends = [f"{signed(angle)} at {quantity(angle, 'rad')}" for angle in changed]
    kinds = {meeting.shape.kind for meeting in tendon.meetings if joint.name in meeting.joints}
    return at_zero, *ends, *sorted(kinds - {"pulley"})
