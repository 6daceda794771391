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
    AngularRange,
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

STOPS = Field(None, description="range of motion [low, high]")
"""Field of a joint or a drive, in its own unit."""

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
        description="acceleration of free fall in the world's frame",
    )
    orientation: Annotated[Vector, In("rad")] = Field(
        (0.0, 0.0, 0.0),
        description="roll, pitch and yaw of the base about the world's x, y and z, in this order",
    )


class Link(Description):
    """A rigid body that a joint turns, in the frame of that joint."""

    mass: Annotated[Parameter, In("kg", "nonnegative")]
    centre: Annotated[Vector, In("m")] = Field(
        description="centre of mass from the joint's axis, at θ = 0"
    )
    inertia: Annotated[Vector, In("kg m^2", "nonnegative")] = Field(
        (0.0, 0.0, 0.0),
        description="about the centre of mass and x, y, z of the joint's frame",
    )


class Coupling(Description):
    """A rigid coupling to another joint: θ = ratio · θ_joint + offset."""

    joint: str = Field(description="the joint that it follows, an earlier one")
    ratio: Annotated[float, In("")]
    offset: AnyRadians = 0.0


REACH = 1.2
"""Angle by which a joint without stops is taken to turn to either side [rad]. Source: judgement."""


class Stribeck(Description):
    """Stiction that fades with speed: Coulomb friction times 1 + excess · exp(−(v/speed)²)."""

    excess: Coefficient = Field(description="stiction beyond Coulomb friction, as a share of it")
    speed: Annotated[Parameter, In("rad/s", "positive")]


class JointFriction(Description):
    """Coulomb friction at the joint's axle, limit = μ r_a N_ref (N/N_ref)^e with N = T0 + Σ T.

    With exponent e = 1 this is equation (12) of the 2008 paper, reconstructed from its Table 1:
    μ_θ r_a (T0 + T1 + T2). A larger exponent lets friction grow faster than the load beyond N_ref.
    """

    coefficient: Coefficient = Field(description="μ")
    radius: Length = Field(description="of the axle, r_a")
    preload: Load = Field(ZERO, description="load on the axle without tension, T0")
    exponent: Annotated[Parameter, In("", "positive", within=(1.0, inf))] = Field(
        ONE,
        description="e, at least 1; friction proportional to load has 1",
    )
    reference: PositiveNewtons | None = Field(
        None,
        description="N_ref, where the exponent changes nothing; N at nominal forces by default",
    )
    stribeck: Stribeck | None = None


class Spring(Description):
    """Return spring at the joint: torque = −(stiffness x + quadratic x² + cubic x³), x = θ −
    rest_angle.
    """

    stiffness: Annotated[Parameter, In("N m/rad", "nonnegative")]
    rest_angle: AnyAngle = Field(ZERO, description="angle where the spring is relaxed")
    quadratic: Annotated[Parameter, In("N m/rad^2")] = ZERO
    cubic: Annotated[Parameter, In("N m/rad^3")] = ZERO


class ExtensionSpring(Description):
    """Extension spring between a point of the link and one of the base: torque = −F r R sin(θ −
    line_angle)/L.

    L² = r² + R² − 2 r R cos(θ − line_angle); F = max(preload + stiffness (L − free_length), 0).
    """

    stiffness: Stiffness = Field(description="k")
    free_length: Length = Field(description="length where it begins to open")
    radius: Length = Field(description="axis to the point of the link, r")
    distance: Length = Field(description="axis to the point of the base, R")
    line_angle: AnyAngle = Field(
        ZERO,
        description="joint angle where both points lie on one line from the axis",
    )
    preload: Load = Field(ZERO, description="force where its coils open")


class JointBacklash(Description):
    """Free play between the pulley that the tendons turn and the link: within it no torque reaches
    the link.
    """

    width: Turn = Field(description="from side to side")


class Gravity(Description):
    """Weight of an off-axis mass: torque = −mass · g · distance · sin(θ − hanging_angle)."""

    mass: Annotated[Parameter, In("kg", "nonnegative")]
    distance: Displacement = Field(description="axis to the centre of mass")
    hanging_angle: AnyAngle = Field(
        ZERO, description="joint angle where the centre of mass is below the axis"
    )


class ExternalTorque(Description):
    """A torque on the joint that nobody measures (a hand, a grasped object): zero mean,
    exponentially correlated.
    """

    std: NewtonMetres = Field(0.0, description="standard deviation; 0: there is none")
    correlation_time: Duration = 0.5


class Joint(Description):
    """A joint: one angle θ [rad], counter-clockwise positive about its axis."""

    name: Name
    parent: str | None = Field(
        None,
        description='joint on whose link it sits, or "base"; the joint before it by default',
    )
    axis: Axis = Field(
        AXES["y"], description='"x", "y", "z", "-x", … or three numbers, in its own frame'
    )
    offset: Annotated[Vector, In("m")] = Field(
        (0.0, 0.0, 0.0), description="origin of its frame in its parent's"
    )
    link: Link | None = None
    coupled: Coupling | None = None
    inertia: Annotated[Parameter, In("kg m^2", "positive")] = Field(
        description="moment of inertia J about its axis, beside that of a `link`"
    )
    damping: AngularDamping = Field(ZERO, description="viscous, b_θ")
    initial: FixedAngle = Field(ZERO, description="angle at the first sample")
    friction: JointFriction | None = None
    spring: Spring | None = None
    extension_spring: ExtensionSpring | None = None
    gravity: Gravity | None = None
    backlash: JointBacklash | None = None
    stops: AngularRange | None = STOPS
    stops_std: Radians = Field(
        0.0,
        description="standard deviation of both ends; a calibration against them is no better",
    )
    stop_stiffness: Annotated[Parameter, In("N m/rad", "positive")] = Parameter(value=100.0)
    stop_damping: AngularDamping = Parameter(value=0.1)
    unmodelled: RadiansPerSecond = Field(
        0.5,
        description="standard deviation of the speed that unknown torques add in 1 s",
    )
    external_torque: ExternalTorque = ExternalTorque()
    touch: Literal["may happen", "never"] = Field(
        "may happen",
        description='"may happen" or "never"; where it may, forces are searched for a touch',
    )

    @property
    def travel(self) -> tuple[float, float]:
        """The range in which the joint turns [rad]: its stops, or ±`REACH`."""
        return self.stops or (-REACH, REACH)
