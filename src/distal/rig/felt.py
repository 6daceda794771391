"""Which touches the force and tension sensors of a rig can detect, in words."""

from __future__ import annotations

from collections.abc import Iterator

from distal.rig.joints import Joint
from distal.rig.rig import Rig
from distal.rounded import rounded


def felt_in_words(rig: Rig) -> Iterator[str]:
    """Yield a line for each joint: which touch of it can be detected, and by which sensors."""
    for j, joint in enumerate(rig.joints):
        yield f"{joint.name}: {_felt(rig, j, joint)}"


def _felt(rig: Rig, j: int, joint: Joint) -> str:
    if joint.touch == "never":
        return "nothing touches it, as the rig says"
    forces = forces_of(rig, joint.name)
    if not forces:
        return "a touch is not observable, since no force of what moves it is read"
    if joint.external_torque.std > 0.0:
        return f"a torque of ±{rounded(joint.external_torque.std)} N m is always looked for"
    others = [other.name for other in rig.joints if set(forces_of(rig, other.name)) & set(forces)]
    together = f", together with {', '.join(n for n in others if n != joint.name)}"
    by = f"by {', '.join(forces)}{together if len(others) > len(forces) else ''}"
    if rig.free_motion is None and len(rig.joints) == 1:
        return f"a touch is looked for {by} once a fit has said what is normal (distal fit)"
    if rig.free_motion is None or not rig.free_motion.felt[j]:
        return f"a touch is felt {by}; from which torque on, only a fit can tell"
    return f"a torque from about {rounded(rig.free_motion.felt[j])} N m on is felt {by}"


def forces_of(rig: Rig, joint: str) -> list[str]:
    """Return the names of the sensors of force and tension that a torque on a joint changes."""
    tendons = [tendon for tendon in rig.tendons if joint in tendon.joints]
    parts = {name for tendon in tendons for name in (tendon.name, tendon.drive)}
    sensors = (*rig.sensors_of("force"), *rig.sensors_of("tension"))
    return [sensor.name for sensor in sensors if sensor.of in parts]
