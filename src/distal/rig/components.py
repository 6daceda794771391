"""The components of a rig: joints (how they follow one another in a chain, links, inertia,
friction, springs, gravity, stops), drives (a slider or a motor's capstan) and tendons, with how
each is fixed to a joint and meets it.

A kind of meeting is a class with its description and its geometry, and its name in the unions at
the end of this file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import hypot, inf, pi, prod
from typing import TYPE_CHECKING, Annotated, Literal, Self, TypeAlias, get_args

import casadi as ca
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from distal.errors import UnitError
from distal.rig.values_with_stds import (
    ONE,
    ZERO,
    AngularDamping,
    AngularRange,
    AnyAngle,
    AnyRadians,
    AnyTorque,
    Coefficient,
    Description,
    Displacement,
    Duration,
    Factor,
    FixedAngle,
    In,
    Length,
    LinearDamping,
    Load,
    Metres,
    Name,
    NewtonMetres,
    Newtons,
    Parameter,
    PositiveNewtonMetres,
    PositiveNewtons,
    Radians,
    RadiansPerSecond,
    Seconds,
    Stiffness,
    TorqueSize,
    Turn,
)

Mass = Annotated[Parameter, In("kg", "nonnegative")]
Inertia = Annotated[Parameter, In("kg m^2", "positive")]
StopStiffness = Annotated[Parameter, In("N m/rad", "positive")]

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
    if not isinstance(raw, str):
        return raw
    if raw not in AXES:
        raise UnitError(f'must be "x", "y", "z", "-x", "-y", "-z" or three numbers, {raw!r} came')
    return AXES[raw]


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

    mass: Mass
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

    mass: Mass
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
    inertia: Inertia = Field(
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
    stop_stiffness: StopStiffness = Parameter(value=100.0)
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


CONSTANT = Field(ZERO, description="without tension")
LOAD = Field(ZERO, description="per newton of tension")
LEFT_OUT = Field(
    0.0,
    description="standard deviation of what the play leaves out; considered, not estimated",
)
WIDTH = Field(description="from side to side")
HELD_BY = Field(
    ZERO,
    description="holds the far side against its tendons where `held` is false",
)
GIVES_WAY = Field(None, description="against load; rigid by default")
FOR_HOURS = Field(
    None, description="torque (slider: force) it may hold for hours; what it holds by default"
)
DEAD_BAND = Field(0.0, description="it stops this far from where it is sent")
VISCOUS = Field(ZERO, description="viscous")
USUAL_EFFORT = Field(ZERO, description="the usual effort, taken where none is measured")
LARGEST_EFFORT = Field(
    None, description="largest effort that a controller gets; a slider cannot push its tendons"
)
EFFORT_LAG = Field(
    0.0, description="time constant with which its effort follows a controller's command"
)
"""Fields that sliders and capstans have alike, each in its own unit."""


class SliderStribeck(Stribeck):
    """The same of a slider."""

    speed: Annotated[Parameter, In("m/s", "positive")]


class CapstanFriction(Description):
    """Coulomb friction of a motor and its capstan, limit = constant + load · radius · Σ T."""

    constant: TorqueSize = CONSTANT
    load: Coefficient = LOAD
    stribeck: Stribeck | None = None


class SliderFriction(CapstanFriction):
    """Coulomb friction of a slider, limit = constant + load · Σ T (equation 13, reconstructed)."""

    constant: Load = CONSTANT
    stribeck: SliderStribeck | None = None


class Hysteresis(Description):
    """Dry friction inside the transmission, limit h = (constant + load · radius · Σ T)(1 + slope ·
    θ).

    The effort z that reaches the tendons' springs follows the measured effort U by a play operator,
    z⁺ = clip(z, U − h, U + h) (Prandtl, 1928; Visintin, Differential Models of Hysteresis, 1994).
    Its causes are strands of a rope that rub, or a cable in its sheath. The effort moves z, not the
    drive's motion: a whole stroke may pass before z has gone from one side of U to the other.
    """

    constant: TorqueSize = CONSTANT
    load: Coefficient = LOAD
    slope: Annotated[Parameter, In("1/rad")] = Field(ZERO, description="growth with θ, as a share")
    error: NewtonMetres = LEFT_OUT
    error_time: Duration = Field(1.0, description="correlation time of `error`")


class SliderHysteresis(Hysteresis):
    """The same of a slider, limit = (constant + load · Σ T)(1 + slope · θ)."""

    constant: Load = CONSTANT
    error: Newtons = LEFT_OUT


class Backlash(Description):
    """Free play between a motor's encoder and its capstan: what winds the tendons stays within ±
    width/2 of the encoder.

    The capstan's position p follows the encoder's position φ by a play operator, p⁺ = clip(p, φ −
    width/2, φ + width/2): the capstan rests until the gears push it. With `held = false` the
    tendons turn the capstan within the gap, against `friction`.
    """

    width: Turn = WIDTH
    held: bool = Field(
        True, description="whether only the near side moves the far one within the gap"
    )
    friction: TorqueSize = HELD_BY


class SliderBacklash(Backlash):
    """The same between a slider's sensor and what pulls its tendons."""

    width: Displacement = WIDTH
    friction: Load = HELD_BY


class Cogging(Description):
    """Torque of a motor that repeats as it turns: cosine · cos(N φ) + sine · sin(N φ), it adds to
    the motor's own.
    """

    periods: Factor = Field(description="N, periods in one turn")
    cosine: AnyTorque = ZERO
    sine: AnyTorque = ZERO


class Servo(Description):
    """How a drive follows the positions that are sent to it: a lag of first order behind a delay,
    no faster than it can.
    """

    bandwidth: Annotated[float, In("Hz", "positive")] | None = Field(
        None, description="where it follows 71 % of a sine; no limit by default"
    )
    delay: Seconds = 0.0
    fastest: Annotated[float, In("rad/s", "positive")] | None = None
    stiffness: Annotated[float, In("N m/rad", "positive")] | None = GIVES_WAY
    dead_band: Radians = DEAD_BAND
    goal: str = Field(
        "", description="log column of the positions sent, in the unit of its position"
    )
    continuous_torque: PositiveNewtonMetres | None = FOR_HOURS

    @property
    def lag(self) -> float:
        """By how much it is late at a constant speed: its delay, and 1/(2π f) by its bandwidth f
        [s].
        """
        return self.delay + (0.0 if self.bandwidth is None else 1.0 / (2 * pi * self.bandwidth))


class SliderServo(Servo):
    """The same of a slider."""

    fastest: Annotated[float, In("m/s", "positive")] | None = None
    stiffness: Annotated[float, In("N/m", "positive")] | None = GIVES_WAY
    dead_band: Metres = DEAD_BAND
    continuous_torque: PositiveNewtons | None = FOR_HOURS


class Slider(Description):
    """A slider: displacement x [m], away from the joint positive, pulled by a force U [N]."""

    kind: Literal["slider"]
    name: Name
    mass: Annotated[Parameter, In("kg", "positive")]
    damping: LinearDamping = VISCOUS
    friction: SliderFriction = SliderFriction()
    hysteresis: SliderHysteresis | None = None
    backlash: SliderBacklash | None = None
    stops: Annotated[tuple[float, float], In("m")] | None = STOPS
    stop_stiffness: Stiffness = Parameter(value=1e5)
    stop_damping: LinearDamping = Parameter(value=3.0)
    nominal_force: Annotated[Parameter, In("N", drifts=False)] = USUAL_EFFORT
    limit: PositiveNewtons | None = LARGEST_EFFORT
    lag: Seconds = EFFORT_LAG
    servo: SliderServo | None = None

    @property
    def lever(self) -> float:
        """How far its tendons move per unit of its own motion [1]."""
        return 1.0


class Capstan(Description):
    """A motor that winds tendons on a capstan: angle φ [rad] and torque [N m].

    A tendon on side +1 is wound by positive φ, a tendon on side −1 is paid out: displacement = side
    · radius · φ.
    """

    kind: Literal["capstan"]
    name: Name
    inertia: Inertia = Field(description="of rotor and capstan, at the capstan")
    radius: Length = Field(description="of the capstan, R")
    damping: AngularDamping = VISCOUS
    friction: CapstanFriction = CapstanFriction()
    hysteresis: Hysteresis | None = None
    backlash: Backlash | None = None
    cogging: Cogging | None = None
    stops: AngularRange | None = STOPS
    stop_stiffness: StopStiffness = Parameter(value=100.0)
    stop_damping: AngularDamping = Parameter(value=0.1)
    nominal_force: Annotated[Parameter, In("N m", drifts=False)] = USUAL_EFFORT
    limit: PositiveNewtonMetres | None = LARGEST_EFFORT
    lag: Seconds = EFFORT_LAG
    servo: Servo | None = None

    @property
    def lever(self) -> float:
        """How far its tendons move per unit of its own motion [m/rad]."""
        return self.radius.value


Drive = Annotated[Slider | Capstan, Field(discriminator="kind")]


def position_unit(drive: Slider | Capstan) -> str:
    """Return the SI unit of a drive's position: m of a slider, rad of a capstan."""
    return "m" if drive.kind == "slider" else "rad"


def effort_unit(drive: Slider | Capstan) -> str:
    """Return the SI unit of a drive's effort: N of a slider, N m of a capstan."""
    return "N" if drive.kind == "slider" else "N m"


if TYPE_CHECKING:
    from distal.expressions import Scalar

Size: TypeAlias = "Callable[[str], Scalar]"
"""Name of one of an insertion's numbers → its symbol or value.

The method `elongation` of an insertion takes such a function, its side (+1 pulls the joint to +θ,
−1 to −θ), the angles of its joints [rad] and the displacement x [m] of the tendon's proximal end,
away from the joint. It returns what angles and displacement add to the tendon's free length l [m].
"""


RADIUS = Field(
    description="r: from the axis to the pin, of the pulley, or the linkage's arm at θ_c"
)


class Crossed(Description):
    """Which joint a tendon crosses, and on which side."""

    joint: str
    side: Literal[1, -1] = Field(description="+1 pulls to +θ, −1 to −θ")


class Pulley(Description):
    """The tendon wraps round a pulley at the joint: ℓ = l + x ∓ r θ."""

    kind: Literal["pulley"]
    radius: Length = RADIUS

    def arm(self, angle: float) -> float:
        """Return the moment arm [m], the same at any `angle`."""
        return self.radius.value

    def elongation(
        self, size: Size, side: int, angles: Sequence[Scalar], displacement: Scalar
    ) -> Scalar:
        """Return ℓ − l [m], by how much the angle of the joint (the only one of `angles`) and the
        `displacement` of the drive lengthen the tendon's way; see `Size`.
        """
        return displacement - side * size("radius") * angles[0]

    def angle_at(self, size: Size, side: int, elongated: Scalar, displacement: Scalar) -> Scalar:
        """Return the angle θ [rad] at which ℓ − l is `elongated` [m] at a `displacement` x [m]: the
        inverse of `elongation`.
        """
        return side * (displacement - elongated) / size("radius")


class CrossedPulley(Crossed, Pulley):
    """A pulley as one of several crossings."""


class Pinned(Description):
    """The tendon ends at a pin on the link: ℓ = sqrt(r²(1 − cos θ)² + (l + x ∓ r sin θ)²),
    equations (4) and (5).
    """

    kind: Literal["pinned"]
    radius: Length = RADIUS
    free_length: Length = Field(description="free length l")

    def arm(self, angle: float) -> float:
        """Return the moment arm at θ = 0 [m], the radius of the pin, whatever the `angle`."""
        return self.radius.value

    def elongation(
        self, size: Size, side: int, angles: Sequence[Scalar], displacement: Scalar
    ) -> Scalar:
        """Return ℓ − l [m], by how much the angle of the joint (the only one of `angles`) and the
        `displacement` of the drive lengthen the tendon's way; see `Size`.

        Mend: the paper prints "− r sin θ" for both tendons. The second insertion is opposite to the
        first, so that it moves the other way and the sign is `side`.
        """
        (angle,) = angles
        radius = size("radius")
        free_length = size("free_length")
        # (4) and (5) multiplied out: ℓ² = A² − 2 side r A sin θ + 2 r² (1 − cos θ), A = l + x, has
        # the shorter derivatives
        along = free_length + displacement
        square = along * (along - 2 * side * radius * ca.sin(angle)) + 2 * radius * radius * (
            1 - ca.cos(angle)
        )
        return ca.sqrt(square) - free_length

    def angle_at(self, size: Size, side: int, elongated: Scalar, displacement: Scalar) -> Scalar:
        """Return the angle θ [rad] at which ℓ − l is `elongated` [m] at a `displacement` x [m]: the
        inverse of `elongation`.

        Squaring (4) gives r cos θ + side · A sin θ = (2r² + A² − ℓ²)/(2r) with A = l + x, a shifted
        sine. Where no angle fits (the drive moved further than the insertion can follow), the
        nearest one is returned.
        """
        radius = size("radius")
        free_length = size("free_length")
        along = free_length + displacement
        length = free_length + elongated
        level = (2 * radius * radius + along * along - length * length) / (2 * radius)
        amplitude = ca.sqrt(radius * radius + along * along)
        ratio = ca.fmin(ca.fmax(level / amplitude, -1), 1)
        return side * (ca.asin(ratio) - ca.atan2(radius, along))


class CrossedPinned(Crossed, Pinned):
    """A pin as one of several crossings."""


INVERSION_STEPS = 6
"""Number of Newton's iterations that invert the excursion, which is nearly linear [1]. Source:
rounding (of 200,000 random linkages whose arm varies fourfold, none is off by more than 2e-15 rad).
"""


def growth(u: Scalar, slope: Scalar, curvature: Scalar) -> Scalar:
    """Return the moment arm at u [rad] over the arm at the centre: 1 + s u + c u², with `slope` s
    and `curvature` c.
    """
    return 1 + u * (slope + u * curvature)


class Linkage(Description):
    """A linkage, or a pulley that is not round: its moment arm is r (1 + s u + c u²) with u = θ −
    θ_c.

    ℓ = l + x ∓ r [u + s u²/2 + c u³/3], less the same at θ = 0: the transmission ratio varies with
    the angle.
    """

    kind: Literal["linkage"]
    radius: Length = RADIUS
    centre: FixedAngle = Field(ZERO, description="θ_c, where the arm is r")
    slope: Annotated[Parameter, In("1/rad")] = Field(ZERO, description="s")
    curvature: Annotated[Parameter, In("1/rad^2")] = Field(ZERO, description="c")

    def arm(self, angle: float) -> float:
        """Return the moment arm [m] at an angle [rad]: r (1 + s u + c u²)."""
        u = angle - self.centre.value
        return self.radius.value * float(growth(u, self.slope.value, self.curvature.value))

    def excursion(self, size: Size, angle: Scalar) -> Scalar:
        """Return how far the linkage draws in its tendon as the joint turns from 0 to `angle` θ
        [m]: r [u + s u²/2 + c u³/3] with u = θ − θ_c, less the same at θ = 0.
        """
        centre = size("centre")
        slope = size("slope")
        curvature = size("curvature")

        def drawn(u: Scalar) -> Scalar:
            return u * (1 + u * (slope / 2 + u * curvature / 3))

        return size("radius") * (drawn(angle - centre) - drawn(-centre))

    def elongation(
        self, size: Size, side: int, angles: Sequence[Scalar], displacement: Scalar
    ) -> Scalar:
        """Return ℓ − l [m], by how much the angle of the joint (the only one of `angles`) and the
        `displacement` of the drive lengthen the tendon's way; see `Size`.
        """
        return displacement - side * self.excursion(size, angles[0])

    def angle_at(self, size: Size, side: int, elongated: Scalar, displacement: Scalar) -> Scalar:
        """Return the angle θ [rad] at which ℓ − l is `elongated` [m] at a `displacement` x [m]: the
        inverse of `elongation`.
        """
        desired = side * (displacement - elongated)
        radius = size("radius")
        centre = size("centre")
        angle = centre + (desired - self.excursion(size, centre)) / radius
        for _ in range(INVERSION_STEPS):
            u = angle - centre
            # the arm is kept away from zero, where no angle fits
            arm = radius * ca.fmax(growth(u, size("slope"), size("curvature")), 0.2)
            angle = angle + (desired - self.excursion(size, angle)) / arm
        return angle


class CrossedLinkage(Crossed, Linkage):
    """A linkage as one of several crossings."""


class Term(Description):
    """One term of a polynomial: coefficient · Π θ_j^{power_j}."""

    powers: tuple[Annotated[int, Field(ge=0)], ...] = Field(
        min_length=1, description="power of each joint's angle"
    )
    coefficient: Annotated[Parameter, In("m")] = Field(
        description="per radian to the sum of the powers"
    )


class Polynomial(Description):
    """A crossing whose excursion is a polynomial in several angles: ℓ = l + x − scale · (e(θ) −
    e(0)).

    Outside of `range` the excursion goes on as a straight line, with the moment arm at the end of
    the range.
    """

    kind: Literal["polynomial"]
    joints: tuple[str, ...] = Field(min_length=1)
    terms: tuple[Term, ...] = Field(min_length=1)
    range: tuple[AngularRange, ...] = Field(
        min_length=1, description="[low, high] of each joint where it holds"
    )
    scale: Annotated[Parameter, In("", "positive")] = Field(
        ONE,
        description="multiplies all moment arms",
    )

    @model_validator(mode="after")
    def _whole(self) -> Self:
        counts = {f"terms.{i}.powers": len(term.powers) for i, term in enumerate(self.terms)}
        for path, count in {"range": len(self.range), **counts}.items():
            if count != len(self.joints):
                raise ValueError(
                    f"{path}: one for each of {len(self.joints)} joints is needed, {count} came"
                )
        for j, name in enumerate(self.joints):
            if name in self.joints[:j]:
                raise ValueError(f"joints: '{name}' stands more than once")
            if not any(term.powers[j] and term.coefficient.value for term in self.terms):
                raise ValueError(
                    f"joints: '{name}' has no term with a power of it; leave it out, or add one"
                )
        return self

    def arms(self, angles: dict[str, float]) -> dict[str, float]:
        """Return the moment arms by joint [m], positive where the tendon pulls to +θ, at `angles`
        by joint [rad], each limited to its range; a joint without an angle is at 0.
        """
        at = [
            min(max(angles.get(name, 0.0), low), high)
            for name, (low, high) in zip(self.joints, self.range)
        ]
        coefficients = [term.coefficient.value for term in self.terms]
        return {
            name: self.scale.value * float(self._slope(coefficients, at, j))
            for j, name in enumerate(self.joints)
        }

    def elongation(
        self, size: Size, side: int, angles: Sequence[Scalar], displacement: Scalar
    ) -> Scalar:
        """Return ℓ − l = x − scale · (e(θ) − e(0)) [m], by how much the `angles` θ and the
        `displacement` x of the drive lengthen the tendon's way; see `Size`.

        The `side` is not used: the signs of the terms say to which side the tendon pulls.
        """
        coefficients = [size(f"terms.{k}.coefficient") for k in range(len(self.terms))]
        zero = self._excursion(coefficients, [ca.SX(0)] * len(angles))
        return displacement - size("scale") * (self._excursion(coefficients, angles) - zero)

    def _excursion(self, coefficients: Sequence[Scalar], angles: Sequence[Scalar]) -> Scalar:
        """Return e(θ) = Σ c Π θ_j^{n_j}. Outside of the range it is e(θ_c) + Σ a_j (θ_j − θ_c,j),
        where θ_c is θ limited to the range.

        a_j is the moment arm at the end of θ_j's own range with the other angles in the middle of
        theirs. So no length jumps, and no arm grows beyond what it is somewhere in the range.
        """
        clipped = [
            ca.fmin(ca.fmax(angle, low), high) for angle, (low, high) in zip(angles, self.range)
        ]
        total = sum(
            coefficient * _product(clipped, term.powers)
            for term, coefficient in zip(self.terms, coefficients)
        )
        middle = [(low + high) / 2 for low, high in self.range]
        for j, (low, high) in enumerate(self.range):
            ends = [
                self._slope(coefficients, [*middle[:j], end, *middle[j + 1 :]], j)
                for end in (low, high)
            ]
            total += ends[0] * ca.fmin(angles[j] - low, 0) + ends[1] * ca.fmax(angles[j] - high, 0)
        return total

    def _slope(self, coefficients: Sequence[Scalar], at: Sequence[Scalar], joint: int) -> Scalar:
        """Return ∂e/∂θ_j of a `joint` j at given angles, symbols or numbers."""
        return sum(
            coefficient
            * term.powers[joint]
            * _product(at, [power - (i == joint) for i, power in enumerate(term.powers)])
            for term, coefficient in zip(self.terms, coefficients)
            if term.powers[joint]
        )


def _product(angles: Sequence[Scalar], powers: Sequence[int]) -> Scalar:
    return prod(angle for angle, power in zip(angles, powers) for _ in range(power))


Shape = Pinned | Pulley | Linkage | Polynomial
"""How a tendon meets a joint."""

Insertion = Annotated[Pinned | Pulley | Linkage, Field(discriminator="kind")]
"""How a tendon that crosses only one joint meets it."""

Crossing = Annotated[
    CrossedPinned | CrossedPulley | CrossedLinkage | Polynomial, Field(discriminator="kind")
]
"""How a tendon that crosses several joints meets one of them (a polynomial: several)."""

KINDS = tuple(get_args(shape.model_fields["kind"].annotation)[0] for shape in get_args(Shape))
"""What ``kind`` may be in a rig file."""


@dataclass(frozen=True)
class Meeting:
    """How a tendon meets a joint, whether its description has the short form (`insertion`) or the
    long one (`crossings`).

    Args:
        path: of the insertion or crossing below the tendon's, ``insertion`` or ``crossings.k``.
        joints: names of the joints: one, but for a polynomial.
        side: +1 pulls the joint to +θ, −1 to −θ; 1 for a polynomial.
    """

    path: str
    joints: tuple[str, ...]
    side: int
    shape: Shape

    def arms(self, angles: dict[str, float]) -> dict[str, float]:
        """Return the moment arms by joint [m] at some `angles` [rad], positive where the tendon
        pulls to +θ; those of a pinned tendon are always those at θ = 0.
        """
        if isinstance(self.shape, Polynomial):
            return self.shape.arms(angles)
        return {self.joints[0]: self.side * self.shape.arm(angles.get(self.joints[0], 0.0))}


MOST_NODES = 4
"""Largest number of points over which a sheath's friction is spread [1]; with more, no sensor would
see a difference (docs/results/fits.md). Source: benchmark (benchmarks/sheaths).
"""


class Path(Description):
    """Friction along the tendon's way, by the capstan equation T_drive = T e^{±μβ}.

    Without `nodes` all of the friction acts at the drive, as of a few pulleys there. With `nodes`
    it acts at points along the tendon, as of a cable in its sheath, which stretches differently as
    it is drawn in and let out.
    """

    friction: Coefficient = Field(description="coefficient μ")
    wrap: Turn = Field(description="β, the sum of its bends")
    let_out: Coefficient = Field(
        ONE,
        description="friction while it is let out, as a share of μ",
    )
    nodes: int = Field(
        0,
        ge=0,
        le=MOST_NODES,
        description="points over which the friction is spread, up to 4; 0: all at the drive",
    )


class Creep(Description):
    """A tendon that goes on stretching under load: T/k is joined by c with time · dc/dt = share ·
    T/k − c.

    A Kelvin–Voigt element in series with the tendon's spring; together they are the standard linear
    solid.
    """

    share: Coefficient = Field(description="of the stretch that comes at once")
    time: Annotated[Parameter, In("s", "positive")]
    settled: Annotated[Parameter, In("", "nonnegative", drifts=False)] = Field(
        Parameter(value=0.5, std=0.3),
        description="share that has come at the first sample",
    )


class Tendon(Description):
    """A tendon from a drive to the joints that it crosses; T = max(k δ + c δ̇, 0) for a stretch δ >
    0, else 0.

    `joint`, `side` and `insertion` are the short form of one crossing.

    With `stiffening` a, T = T_pre + k (e^{aδ} − 1)/a: its stiffness is k + a (T − T_pre). With
    `slack`, δ is what is left of the elongation beyond it.
    """

    name: Name
    joint: str | None = Field(
        None, description="short form of one crossing, with `side` and `insertion`"
    )
    drive: str
    side: Literal[1, -1] | None = Field(
        None,
        description="+1 pulls to +θ, −1 to −θ; with `crossings` +1 is wound by a positive angle of "
        "the capstan, the side of the first crossing by default",
    )
    insertion: Insertion | None = None
    crossings: tuple[Crossing, ...] = ()
    stiffness: Stiffness = Field(description="spring constant k")
    damping: Annotated[Parameter, In("N s/m", "nonnegative")] = Field(ZERO, description="c")
    pretension: Load = Field(ZERO, description="tension where angles and drive are at zero")
    slack: Annotated[Parameter, In("m")] = Field(
        ZERO,
        description="pull until it is taut at zero angles and drive; negative if tense",
    )
    stiffening: Annotated[Parameter, In("1/m", "nonnegative")] = Field(
        ZERO, description="a, growth of stiffness with tension"
    )
    creep: Creep | None = None
    path: Path | None = None

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        short = {"joint": self.joint, "side": self.side, "insertion": self.insertion}
        if self.crossings:
            for name in ("joint", "insertion"):
                if short[name] is not None:
                    raise ValueError(
                        f"{name}: is the short form of one crossing; leave it out, or 'crossings'"
                    )
        elif None in short.values():
            missing = [name for name, value in short.items() if value is None]
            raise ValueError(
                f"{missing[0]}: is missing (or give 'crossings', one for each joint that it "
                "crosses)"
            )
        if not self.slack.absent and not self.pretension.absent:
            raise ValueError(
                "slack: a tendon is slack at home, or pulled there by its 'pretension'; give one "
                "of them"
            )
        return self

    @property
    def meetings(self) -> tuple[Meeting, ...]:
        """The crossings of the tendon from the base outwards, in one form for both ways to write
        them.
        """
        if self.insertion is not None and self.joint is not None and self.side is not None:
            return (Meeting("insertion", (self.joint,), self.side, self.insertion),)
        return tuple(
            Meeting(f"crossings.{i}", crossing.joints, 1, crossing)
            if isinstance(crossing, Polynomial)
            else Meeting(f"crossings.{i}", (crossing.joint,), crossing.side, crossing)
            for i, crossing in enumerate(self.crossings)
        )

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that the tendon crosses, each once."""
        return tuple(dict.fromkeys(name for meeting in self.meetings for name in meeting.joints))

    @property
    def winding(self) -> int:
        """Sign of the capstan angle that winds the tendon, +1 or −1."""
        return self.meetings[0].side if self.side is None else self.side

    @property
    def loose(self) -> float:
        """Pull until it is taut where angles and drive are at zero, slack − T₀/k [m]."""
        return self.slack.value - self.pretension.value / self.stiffness.value

    @property
    def home_tension(self) -> float:
        """Tension where angles and drive are at zero [N]."""
        return max(-self.stiffness.value * self.loose, 0.0)

    def arms(self, angles: dict[str, float] | None = None) -> dict[str, float]:
        """Return the tendon's moment arm at each joint that it crosses [m], positive where it pulls
        to +θ, at some `angles` by joint [rad]; by default at θ = 0.
        """
        arms = dict.fromkeys(self.joints, 0.0)
        for meeting in self.meetings:
            for name, arm in meeting.arms(angles or {}).items():
                arms[name] += arm
        return arms

    @property
    def total_arm(self) -> float:
        """The sum of the magnitudes of the tendon's moment arms: how far it moves as all its joints
        turn by a radian [m].

        The arms are those at θ = 0. Where all are zero there, they are those at the ends of the
        polynomials' ranges, whichever are larger.
        """
        positions: list[dict[str, float]] = [{}]
        for meeting in self.meetings:
            if isinstance(meeting.shape, Polynomial):
                positions += [dict(zip(meeting.joints, ends)) for ends in zip(*meeting.shape.range)]
        totals = [sum(map(abs, self.arms(at).values())) for at in positions]
        return totals[0] or max(totals)
