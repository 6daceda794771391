"""The kernels that a process keeps: rigs that differ in their numbers only share a plant's and a
filter's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from distal.estimators import AdaptiveFilter
from distal.kernels import Kernel
from distal.model import Mechanism
from distal.rig import Rig
from distal.simulation.plant import plant_function

PARTS = ("joints", "drives", "tendons")


@dataclass
class Kernels:
    """A plant's kernel, and filters, for each structure of rig; with the filters the rigs not yet
    looked at for more.
    """

    plants: dict[str, tuple[Mechanism, Kernel]] = field(default_factory=dict)
    filters: dict[tuple[str, str], tuple[list[AdaptiveFilter], Iterator[Rig]]] = field(
        default_factory=dict
    )

    def plant(self, mechanism: Mechanism, count: int) -> tuple[Mechanism, Kernel]:
        """Return a mechanism of the same structure and its kernel."""
        parts = [
            _masked(getattr(mechanism.rig, kind).model_dump()) for kind in ("base", "stepping")
        ]
        parts += [
            _masked(_open(part.model_dump()))
            for kind in PARTS
            for part in getattr(mechanism.rig, kind)
        ]
        key = repr((parts, mechanism.parameters.names, count))
        if key not in self.plants:
            self.plants[key] = mechanism, Kernel(plant_function(mechanism, count))
        return self.plants[key]

    def filter(self, rig: Rig, family: str, rigs: Iterator[Rig]) -> AdaptiveFilter:
        """Return the adaptive filter of a rig, with the kernel of the first rig of a study that has
        its structure.

        What a kernel has as constants is that of the rig that it was made of: which one must not
        depend on what a process has done before, so `rigs` are those of the study in their order.
        """
        shape = _shape(rig)
        filters, untried = self.filters.setdefault((family, shape), ([], rigs))
        while True:
            for adaptive in filters:
                ready = adaptive.of_rig(rig)
                if ready is not None:
                    return ready
            alike = (design for design in untried if _shape(design) == shape)
            first = next(
                (design for design in alike if all(f.of_rig(design) is None for f in filters)), rig
            )
            noises = tuple(
                f"sensors.{i}.noise"
                for i, sensor in enumerate(first.sensors)
                if sensor.measures != "angle"
            )
            filters.append(AdaptiveFilter(first, inputs=noises))


def _shape(rig: Rig) -> str:
    """Return what of a description a filter's structure depends on."""
    raw = rig.model_dump(exclude={"name", "log"})
    for sensor in raw["sensors"]:
        sensor["noise"], sensor["linearity"] = None, sensor["linearity"] > 0.0
    for drive in raw["drives"]:
        if "nominal_force" in drive:  # stands in for a sensor that is not there
            drive["nominal_force"] = repr(drive["nominal_force"])
    return repr(_masked(raw))


def _open(part: dict[str, object]) -> dict[str, object]:
    """Return a raw part without the places of its stops, which are numbers of a plant like
    others.
    """
    return {key: value is None if key == "stops" else value for key, value in part.items()}


def _masked(part: object) -> object:
    """Return a raw description with only what the structure of its equations depends on for each
    number with a std.
    """
    if isinstance(part, Mapping):
        if {"value", "std"} <= part.keys():
            value, std, shared = part["value"], part["std"], part.get("shared")
            flags = (
                value == 0.0,
                std > 0.0,
                value == 1.0,
                std > 0.5 * abs(value),
                std > 0.2 * abs(value),
            )
            return flags, part.get("hold"), part.get("drift"), shared and shared["name"]
        return {key: _masked(value) for key, value in part.items()}
    return [_masked(member) for member in part] if isinstance(part, (list, tuple)) else part
