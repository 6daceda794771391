"""Joints: how they follow one another in a chain, the links that they turn, inertia, friction,
springs, gravity and stops.
"""

from __future__ import annotations

from math import hypot, inf
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from distal.errors import UnitError
from distal.rig.quantities import (
    ONE,
    ZERO,
    AngularDamping,
    AnyAngle,
    AnyRadians,
    Coefficient,
    Description,
    Displacement,
    Duration,
    FixedAngle,
    In,
    Length,
    Load,
    Name,
    NewtonMetres,
    Parameter,
    PositiveNewtons,
    Radians,
    RadiansPerSecond,
    Stiffness,
    Turn,
)

BASE = "base"
"""Name of what the first joint sits on."""

Vector = tuple[float, float, float]

AXES: dict[str, Vector] = {
    "x": (1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}
"""Unit vectors of the axes by name."""


def _named(raw: object) -> object:
    """Return the axis of a name; what is no name stays."""
    if isinstance(raw, str) and raw not in AXES:
        raise UnitError(f'must be "x", "y", "z", "-x", "-y", "-z" or three numbers, {raw!r} came')
    return AXES[raw] if isinstance(raw, str) else raw


def _unit(vector: Vector) -> Vector:
    length = hypot(*vector)
    if not 1e-9 < length < 1e9:
        raise UnitError(f"must point somewhere, {list(vector)} came")
    x, y, z = (part / length for part in vector)
    return x, y, z


Axis = Annotated[Vector, In(""), BeforeValidator(_named), AfterValidator(_unit)]
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
    offset: AnyRadians = Field(0.0, description="angle of this joint where the other is at zero")


REACH = 1.2
"""Angle by which a joint without stops is taken to turn to either side [rad]. Source: judgement."""


class Stribeck(Description):
    """Stiction that fades with speed: Coulomb friction times 1 + excess · exp(−(v/speed)²)."""

    excess: Coefficient = Field(description="stiction beyond Coulomb friction, a share")
    speed: Annotated[Parameter, In("rad/s", "positive")] = Field(
        description="speed at which it fades"
    )


class JointFriction(Description):
    """Coulomb friction at the joint's axle, limit = μ r_a N_ref (N/N_ref)^e with N = T0 + Σ T.

    With exponent e = 1 this is equation (12) of the 2008 paper, reconstructed from its Table 1:
    μ_θ r_a (T0 + T1 + T2). A larger exponent lets friction grow faster than the load beyond N_ref.
    """

    coefficient: Coefficient = Field(description="friction coefficient μ")
    radius: Length = Field(description="radius of the axle r_a")
    preload: Load = Field(ZERO, description="load on the axle before any tension, T0")
    exponent: Annotated[Parameter, In("", "positive", within=(1.0, inf))] = Field(
        ONE,
        description="growth of friction with load, e (1 = proportional; below, it has no finite "
        "slope at zero load)",
    )
    reference: PositiveNewtons | None = Field(
        None,
        description="load N_ref at which the exponent changes nothing; default: N at nominal "
        "forces",
    )
    stribeck: Stribeck | None = Field(None, description="stiction that fades with speed")


class Spring(Description):
    """Return spring at the joint: torque = −(stiffness x + quadratic x² + cubic x³), x = θ −
    rest_angle.
    """

    stiffness: Annotated[Parameter, In("N m/rad", "nonnegative")] = Field(
        description="torsional stiffness"
    )
    rest_angle: AnyAngle = Field(ZERO, description="angle at which the spring is relaxed")
    quadratic: Annotated[Parameter, In("N m/rad^2")] = Field(
        ZERO, description="growth of stiffness to one side"
    )
    cubic: Annotated[Parameter, In("N m/rad^3")] = Field(
        ZERO, description="growth of stiffness to both sides; negative where it gets softer"
    )


class ExtensionSpring(Description):
    """Extension spring between a point of the link and one of the base: torque = −F r R sin(θ −
    line_angle)/L.

    L² = r² + R² − 2 r R cos(θ − line_angle); F = max(preload + stiffness (L − free_length), 0).
    """

    stiffness: Stiffness = Field(description="of the spring, k")
    free_length: Length = Field(description="its length where it begins to open")
    radius: Length = Field(description="from the axis to the point of the link, r")
    distance: Length = Field(description="from the axis to the point of the base, R")
    line_angle: AnyAngle = Field(
        ZERO,
        description="joint angle at which both points are in line with the axis, on the same side",
    )
    preload: Load = Field(ZERO, description="force at which its coils open")


class JointBacklash(Description):
    """Free play between the pulley that the tendons turn and the link: within it no torque reaches
    the link.
    """

    width: Turn = Field(description="from one side to the other")


class Gravity(Description):
    """Weight of an off-axis mass: torque = −mass · g · distance · sin(θ − hanging_angle)."""

    mass: Annotated[Parameter, In("kg", "nonnegative")] = Field(description="mass of the link")
    distance: Displacement = Field(description="distance of the centre of mass from the axis")
    hanging_angle: AnyAngle = Field(
        ZERO, description="joint angle at which the centre of mass hangs straight below the axis"
    )


class ExternalTorque(Description):
    """A torque on the joint that nobody measures (a hand, a grasped object): zero mean,
    exponentially correlated.
    """

    std: NewtonMetres = Field(0.0, description="standard deviation; 0 = cannot occur")
    correlation_time: Duration = Field(0.5, description="correlation time")


class Joint(Description):
    """A joint: one angle θ [rad], counter-clockwise positive about its axis."""

    name: Name
    parent: str | None = Field(
        None,
        description='the joint on whose link it sits, or "base"; default: the joint before it in '
        "the file",
    )
    axis: Axis = Field(
        AXES["y"], description='its axis in its own frame: "x", "y", "z", "-x", … or three numbers'
    )
    offset: Annotated[Vector, In("m")] = Field(
        (0.0, 0.0, 0.0), description="where its frame sits, in the frame of its parent"
    )
    link: Link | None = Field(
        None, description="the body that it turns; without one `inertia` is all there is"
    )
    coupled: Coupling | None = Field(None, description="a rigid coupling to a joint before it")
    inertia: Annotated[Parameter, In("kg m^2", "positive")] = Field(
        description="moment of inertia J about its axis; with a `link` what comes on top of it, "
        "such as an armature"
    )
    damping: AngularDamping = Field(ZERO, description="viscous damping b_θ")
    initial: FixedAngle = Field(ZERO, description="angle at the log's first sample")
    friction: JointFriction | None = Field(None, description="Coulomb friction at the axle")
    spring: Spring | None = Field(None, description="return spring")
    extension_spring: ExtensionSpring | None = Field(
        None, description="return spring between two points"
    )
    gravity: Gravity | None = Field(None, description="weight of an off-axis mass")
    backlash: JointBacklash | None = Field(
        None, description="free play between its pulley and its link"
    )
    stops: Annotated[tuple[float, float], In("rad")] | None = Field(
        None, description="range of the joint [low, high]"
    )
    stops_std: Radians = Field(
        0.0,
        description="how well each end of that range is known; a calibration against them is no "
        "better",
    )
    stop_stiffness: Annotated[Parameter, In("N m/rad", "positive")] = Field(
        Parameter(value=100.0), description="stiffness of the joint's stops"
    )
    stop_damping: AngularDamping = Field(
        Parameter(value=0.1), description="viscous damping in the joint's stops"
    )
    unmodelled: RadiansPerSecond = Field(
        0.5,
        description="torque the model does not know, as the random change of speed that it makes "
        "in 1 s (1σ)",
    )
    external_torque: ExternalTorque = Field(
        ExternalTorque(), description="a torque nobody measures"
    )
    touch: Literal["may happen", "never"] = Field(
        "may happen",
        description="whether anything can touch what the joint moves; where it can, forces are "
        "asked for it at each sample",
    )

    @property
    def travel(self) -> tuple[float, float]:
        """The range in which the joint turns [rad]: its stops, or ±`REACH`."""
        return self.stops or (-REACH, REACH)
