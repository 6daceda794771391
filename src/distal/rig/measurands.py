"""What a sensor measures of which part, and in which unit its errors are therefore written.

Another measurand is a line of `MEASURED`, its unit in `measured_unit`, and a line in the file of this name in `simulation`
(what there is to measure), `estimators/channels` (its role) and `reports/drawing` (its letter).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

from distal.errors import did_you_mean
from distal.rig.drives import Capstan, Slider, effort_unit, position_unit
from distal.rig.joints import Joint
from distal.rig.tendons import Tendon

MEASURED: dict[str, tuple[str, ...]] = {
    "drives": ("position", "force"),
    "tendons": ("tension",),
    "joints": ("angle", "torque"),
}
"""What can be measured of each kind of part."""

Parts: TypeAlias = Mapping[str, Sequence[Slider | Capstan | Tendon | Joint]]


def with_unit(raw: object, index: int, parts: Parts) -> object:
    """Return the raw sensor with the SI unit of what it measures, or as it came if pydantic will refuse it anyway.

    Args:
        index: of the sensor, for messages.
        parts: the rig's drives, tendons and joints.

    Raises:
        ValueError: it names no part, or one that cannot be measured so.
    """
    if not isinstance(raw, Mapping):
        raise ValueError(f"{index}: a sensor is a table, {raw!r} came")
    if raw.get("measures") == "command":
        if "lag" not in raw:
            raise ValueError(
                f"{index}: measures = 'command' needs lag, the time constant of the drive's servo (\"50 ms\")"
            )
        raw = {**raw, "measures": "position"}
    measures, of = raw.get("measures"), raw.get("of")
    kind = next((kind for kind, measurands in MEASURED.items() if measures in measurands), None)
    if kind is None:
        return {**raw, "si": "m"}
    names = [part.name for part in parts[kind]]
    if of not in names:
        if of is None:
            return {**raw, "si": "m"}
        raise ValueError(f"{index}.of: no {kind[:-1]} is called '{of}'{_elsewhere(of, measures, parts, names)}")
    part = parts[kind][names.index(of)]
    return {**raw, "si": measured_unit(measures, part)}


def _elsewhere(of: object, measures: object, parts: Parts, names: list[str]) -> str:
    """Return a hint where a sensor's part is of another kind, else names that may be meant."""
    for kind, measurands in MEASURED.items():
        if of in [part.name for part in parts[kind]]:
            allowed = " or ".join(f"'{each}'" for each in measurands)
            hint = "; the torque of a capstan's motor is its force" if (kind, measures) == ("drives", "torque") else ""
            return f", it is one of the {kind}: measures must be {allowed}{hint}"
    return did_you_mean(str(of), names)


def measured_unit(measures: object, part: Slider | Capstan | Tendon | Joint) -> str:
    """Return the SI unit of what is measured.

    Args:
        measures: one of `MEASURED` for such a part.
    """
    if isinstance(part, (Slider, Capstan)):
        return position_unit(part) if measures == "position" else effort_unit(part)
    return {"tension": "N", "angle": "rad", "torque": "N m"}[str(measures)]
