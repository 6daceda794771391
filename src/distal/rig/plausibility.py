"""The numbers of a rig by their path, and how far they can be trusted: known to a factor only,
taken and not measured, or allowed but improbable.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Literal

from distal.errors import CommandError, RigError, did_you_mean
from distal.rig.quantities import In, Parameter
from distal.rig.rig import Rig, parameters_below
from distal.rig.validation import in_words, index_of, names_in

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
    return std > (ROUGH_ARM if is_arm(path) else ROUGH) * value > 0.0


def is_arm(path: str) -> bool:
    """Return whether the number at a path is a moment arm; readings show only its product with an
    angle.
    """
    return (
        ".insertion." in path
        or ".crossings." in path
        or (path.startswith("drives.") and path.endswith(".radius"))
    )


@dataclass(frozen=True)
class Number:
    """A number of a description.

    Args:
        path: keys and indices joined by dots, names of parts replaced by their indices.
        value: in SI.
        std: of all that is not known of the value; 0 where it has none.
        quantity: its unit and bound.
        is_parameter: whether it may have a std.
        hold: whether its std is for fitting only.
        shared: name of the error that it shares with others, and the std of that as a share of the
            value; None if it shares none.
        independent_std: of its own error alone.
        drift: std of its walk, per √s; None where the estimator says.
    """

    path: str
    value: float
    std: float
    quantity: In
    is_parameter: bool
    hold: bool
    shared: tuple[str, float] | None
    independent_std: float
    drift: float | None

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
    shared = known.shared
    return Number(
        ".".join(keys),
        known.value,
        known.total_std,
        quantity,
        known is part,
        known.hold,
        (shared.name, shared.std) if shared is not None and shared.std > 0.0 else None,
        known.std,
        known.drift,
    )


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
        f"the scale of {which} is assumed, not measured: angles do not depend on it, forces, "
        f"torques and stiffnesses do. One measurement settles it: {wanting}. Correct it in the rig "
        "file and remove it from 'taken'"
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
    needed = ("force", "length") if needs == "tension" else ("force",)
    lacking = [scale for scale in needed if scale in rig.taken]
    if lacking:
        raise CommandError(
            f"{purpose} needs a true {needs}, but the scale of {' and '.join(lacking)} of "
            f"'{rig.name}' is assumed, not measured. Measure "
            f"{'; '.join(SETTLED_BY[scale] for scale in lacking)}; correct it in the rig file and "
            "remove it from 'taken'"
        )


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


def doubts(rig: Rig) -> list[str]:
    """Return a sentence for each value of a rig that is allowed but is probably a mistake."""
    sentences = []
    for path, parameter in parameters_below(rig):
        size = abs(parameter.value)
        low, high, unit = USUAL.get(path.rpartition(".")[2], (0.0, inf, ""))
        is_usual = size == 0.0 or low <= size <= high
        if not is_usual and number(rig, path).quantity.si == unit:
            sentences.append(
                f"{in_words(rig, path)} is {size:g} {unit}; between {low:g} and {high:g} is "
                "usual: is its unit there?"
            )
    for joint in rig.joints:
        away = max(
            abs(part)
            for part in (*joint.offset, *(joint.link.centre if joint.link is not None else ()))
        )
        if away > USUAL["offset"][1]:
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
            windings = [tendon.winding for tendon in rig.tendons_of(sensor.of)]
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
