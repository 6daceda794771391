"""Parts of the physics, each alone in a rig of one link, with one number that is not known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from distal import Rig, load_rig

NOISE = {"x1": 5e-6, "x2": 5e-6, "u1": 0.05, "u2": 0.05}
"""Of the sensors [m, N]; the encoder's is 0.05°."""


@dataclass(frozen=True)
class Part:
    """A part of the physics.

    Args:
        name: of the part.
        path: of the number that is not known.
        value: what the rig says.
        std: and how far it may be off.
        fixed: other values of the rig.
    """

    name: str
    path: str
    value: float
    std: float
    fixed: Mapping[str, Any]


SPRING = {"stiffness": 0.05, "rest_angle": 0.0}

BETWEEN = {
    "stiffness": 250.0,
    "free_length": 0.018,
    "radius": 0.009,
    "distance": 0.026,
    "line_angle": -0.9,
    "preload": 0.4,
}

CREEP = {"share": 0.3, "time": 2.0, "settled": {"value": 0.0, "std": 0.3}}

SHEATH = {"friction": 0.2, "wrap": 1.8, "nodes": 2}

SPRUNG = {"joints.0.spring": SPRING}

PARTS = (
    Part("slack at home", "tendons.0.slack", 0.5e-3, 0.2e-3, SPRUNG),
    Part(
        "cubic spring",
        "joints.0.spring.cubic",
        0.2,
        0.1,
        {"joints.0.spring": {**SPRING, "cubic": 0.2}},
    ),
    Part(
        "quadratic spring",
        "joints.0.spring.quadratic",
        0.02,
        0.008,
        {"joints.0.spring": {**SPRING, "quadratic": 0.02}},
    ),
    Part(
        "extension spring",
        "joints.0.extension_spring.stiffness",
        250.0,
        60.0,
        {"joints.0.extension_spring": BETWEEN},
    ),
    Part(
        "its line",
        "joints.0.extension_spring.line_angle",
        -0.9,
        0.15,
        {"joints.0.extension_spring": BETWEEN},
    ),
    Part("creep", "tendons.0.creep.share", 0.3, 0.1, {**SPRUNG, "tendons.0.creep": CREEP}),
    Part(
        "its time constant", "tendons.0.creep.time", 2.0, 0.6, {**SPRUNG, "tendons.0.creep": CREEP}
    ),
    Part(
        "backlash of a drive",
        "drives.0.backlash.width",
        0.4e-3,
        0.15e-3,
        {**SPRUNG, "drives.0.backlash.width": 0.4e-3},
    ),
    Part(
        "the same, moved by its tendon",
        "drives.0.backlash.width",
        0.4e-3,
        0.15e-3,
        {**SPRUNG, "drives.0.backlash": {"width": 0.4e-3, "held": False, "friction": 2.0}},
    ),
    Part(
        "backlash of the joint",
        "joints.0.backlash.width",
        0.03,
        0.01,
        {**SPRUNG, "joints.0.backlash.width": 0.03},
    ),
    Part("sheath", "tendons.0.path.friction", 0.2, 0.05, {**SPRUNG, "tendons.0.path": SHEATH}),
    Part(
        "let out otherwise",
        "tendons.0.path.let_out",
        0.7,
        0.2,
        {**SPRUNG, "tendons.0.path": {**SHEATH, "let_out": 0.7}},
    ),
    Part("viscous drive", "drives.0.damping", 20.0, 8.0, {**SPRUNG, "drives.0.damping": 20.0}),
)


def rig_of(part: Part, value: float | None = None) -> Rig:
    """Return the rig with what is not known of a part, or with its true number and no std."""
    known = (
        {"value": part.value, "std": part.std} if value is None else {"value": value, "std": 0.0}
    )
    rig = load_rig(Path(__file__).with_name("link.toml"))
    return rig.with_values({"name": part.name, **part.fixed}).with_values({part.path: known})
