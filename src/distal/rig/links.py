"""How joints follow one another in a chain: the base, the links that joints turn, and rigid
couplings.
"""

from __future__ import annotations

from math import sqrt
from typing import Annotated

from pydantic import BeforeValidator, Field

from distal.errors import UnitError
from distal.rig.quantities import Description, In, Parameter

BASE = "base"
"""Name of what the first joint sits on."""

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
"""Unit vectors of the axes by name; a name with a minus, "-y", stands for the opposite one."""

Vector = tuple[float, float, float]


def unit_vector(raw: object) -> object:
    """Return an axis as a unit vector; `raw` is "x", "y" or "z", "-x" and so on, or three numbers.

    Raises:
        UnitError: it is none of these, or has no length.
    """
    if isinstance(raw, str):
        if raw.removeprefix("-") not in AXES:
            raise UnitError(
                f'must be "x", "y", "z", "-x", "-y", "-z" or three numbers, {raw!r} came'
            )
        sign = -1.0 if raw.startswith("-") else 1.0
        return tuple(sign * part + 0.0 for part in AXES[raw.removeprefix("-")])
    if not isinstance(raw, (list, tuple)) or len(raw) != 3:
        raise UnitError(f'must be "x", "y", "z" or three numbers, {raw!r} came')
    if not all(
        isinstance(part, (int, float)) and not isinstance(part, bool) and abs(part) < 1e9
        for part in raw
    ):
        raise UnitError(f"must be three numbers, {raw!r} came")
    length = sqrt(sum(part * part for part in raw))
    if length < 1e-9:
        raise UnitError(f"must point somewhere, {raw!r} came")
    return tuple(float(part) / length for part in raw)


Axis = Annotated[Vector, BeforeValidator(unit_vector)]
"""Direction of a joint's axis; θ turns counter-clockwise about it."""


class Base(Description):
    """What the first joint sits on, and which way gravity points.

    The world's z points up. The base's frame is the world's, turned by `orientation`.
    """

    gravity: Annotated[Vector, In("m/s^2")] = Field(
        (0.0, 0.0, -9.80665),
        description="acceleration of free fall, in the world's frame (the base's while it is "
        "upright)",
    )
    orientation: Annotated[Vector, In("rad")] = Field(
        (0.0, 0.0, 0.0),
        description="how the base is turned: roll, pitch, yaw about the world's x, y and z, in "
        "this order",
    )


class Link(Description):
    """A rigid body that a joint turns, in the frame of that joint."""

    mass: Annotated[Parameter, In("kg", "nonnegative")] = Field(description="mass")
    centre: Annotated[Vector, In("m")] = Field(
        description="centre of mass, from the joint's axis, at θ = 0"
    )
    inertia: Annotated[Vector, In("kg m^2", "nonnegative")] = Field(
        (0.0, 0.0, 0.0),
        description="moments of inertia about the centre of mass, about x, y, z of the joint's "
        "frame (no products)",
    )


class Coupling(Description):
    """A rigid coupling to another joint: θ = ratio · θ_joint + offset."""

    joint: str = Field(description="name of the joint that it follows; it comes before this one")
    ratio: Annotated[float, In("")] = Field(
        description="radians of this joint per radian of the other"
    )
    offset: Annotated[float, In("rad")] = Field(
        0.0, description="angle of this joint where the other is at zero"
    )
