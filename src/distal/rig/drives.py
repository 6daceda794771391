"""Drives: what pulls the tendons at the proximal end, a slider or a motor's capstan."""

from __future__ import annotations

from math import pi
from typing import Annotated, Literal

from pydantic import Field

from distal.rig.joints import Stribeck
from distal.rig.quantities import (
    ZERO,
    AngularDamping,
    AnyTorque,
    Coefficient,
    Description,
    Displacement,
    Duration,
    Factor,
    In,
    Length,
    Load,
    Name,
    NewtonMetres,
    Parameter,
    PositiveNewtons,
    Radians,
    Seconds,
    Stiffness,
    TorqueSize,
    Turn,
)

CONSTANT = Field(ZERO, description="part that is always there")
STRIBECK = Field(None, description="stiction that fades with speed")
LOAD = Field(ZERO, description="part per newton of tension at the capstan's radius")
LEFT_OUT = Field(
    0.0,
    description="what this play leaves out, its standard deviation; estimators consider it, "
    "they do not estimate it",
)
WIDTH = Field(description="from one side to the other")
HELD_BY = Field(
    ZERO,
    description="friction that holds the far side against its tendons, where `held` is false",
)
FASTEST = Field(None, description="largest speed")
GIVES_WAY = Field(None, description="by how much it gives way under load; default: not at all")
DEAD_BAND = Field(0.0, description="it comes no nearer to where it is sent")
INSIDE = Field(None, description="dry friction inside the transmission")
"""Fields that sliders and capstans have alike, each in its own unit."""


class SliderStribeck(Stribeck):
    """Stiction that fades with speed: Coulomb friction times 1 + excess · exp(−(v/speed)²)."""

    speed: Annotated[Parameter, In("m/s", "positive")] = Field(
        description="speed at which it fades"
    )


class SliderFriction(Description):
    """Coulomb friction of a slider, limit = constant + load · Σ T (equation 13, reconstructed)."""

    constant: Load = CONSTANT
    load: Coefficient = Field(ZERO, description="part per newton of tension, μ_x")
    stribeck: SliderStribeck | None = STRIBECK


class CapstanFriction(Description):
    """Coulomb friction of a motor and its capstan, limit = constant + load · radius · Σ T."""

    constant: TorqueSize = CONSTANT
    load: Coefficient = LOAD
    stribeck: Stribeck | None = STRIBECK


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
    slope: Annotated[Parameter, In("1/rad")] = Field(
        ZERO, description="its growth with the joint's angle, as a share per radian"
    )
    error: NewtonMetres = LEFT_OUT
    error_time: Duration = Field(1.0, description="for how long that lasts")


class SliderHysteresis(Hysteresis):
    """Dry friction inside the transmission, limit = (constant + load · Σ T)(1 + slope · θ); see
    `Hysteresis`.
    """

    constant: Load = CONSTANT
    load: Coefficient = Field(ZERO, description="part per newton of tension")
    error: Annotated[float, In("N", "nonnegative")] = LEFT_OUT


class Backlash(Description):
    """Free play between a motor's encoder and its capstan: what winds the tendons stays within ±
    width/2 of the encoder.

    The capstan's position p follows the encoder's position φ by a play operator, p⁺ = clip(p, φ −
    width/2, φ + width/2): the capstan rests until the gears push it. With `held = false` the
    tendons turn the capstan within the gap, against `friction`.
    """

    width: Turn = WIDTH
    held: bool = Field(
        True, description="whether nothing but the near side moves the far one within the gap"
    )
    friction: TorqueSize = HELD_BY


class SliderBacklash(Backlash):
    """Free play between a slider's sensor and what pulls its tendons; see `Backlash`."""

    width: Displacement = WIDTH
    friction: Load = HELD_BY


class Cogging(Description):
    """Torque of a motor that repeats as it turns: cosine · cos(N φ) + sine · sin(N φ), it adds to
    the motor's own.
    """

    periods: Factor = Field(description="periods in one turn of the capstan, N")
    cosine: AnyTorque = Field(ZERO, description="part that is largest at φ = 0")
    sine: AnyTorque = Field(ZERO, description="part that is zero there")


class Servo(Description):
    """How a drive follows the positions that are sent to it: a lag of first order behind a delay,
    no faster than it can.
    """

    bandwidth: Annotated[float, In("Hz", "positive")] | None = Field(
        None, description="frequency at which it follows 71 % of a sine; default: all"
    )
    delay: Seconds = Field(0.0, description="time before it begins to follow")
    fastest: Annotated[float, In("rad/s", "positive")] | None = FASTEST
    stiffness: Annotated[float, In("N m/rad", "positive")] | None = GIVES_WAY
    dead_band: Radians = DEAD_BAND
    goal: str = Field(
        "", description="log column of what it is sent, in the unit in which its place is logged"
    )
    continuous_torque: Annotated[float, In("N m", "positive")] | None = Field(
        None, description="torque that it may hold for hours; default: what it holds"
    )

    @property
    def lag(self) -> float:
        """By how much it is late at a constant speed: its delay, and 1/(2π f) by its bandwidth f
        [s].
        """
        return self.delay + (0.0 if self.bandwidth is None else 1.0 / (2 * pi * self.bandwidth))


class SliderServo(Servo):
    """How a slider follows the positions that are sent to it; see `Servo`."""

    fastest: Annotated[float, In("m/s", "positive")] | None = FASTEST
    stiffness: Annotated[float, In("N/m", "positive")] | None = GIVES_WAY
    dead_band: Annotated[float, In("m", "nonnegative")] = DEAD_BAND
    continuous_torque: PositiveNewtons | None = Field(
        None, description="force that it may hold for hours; default: what it holds"
    )


class Slider(Description):
    """A slider: displacement x [m], away from the joint positive, pulled by a force U [N]."""

    kind: Literal["slider"]
    name: Name
    mass: Annotated[Parameter, In("kg", "positive")] = Field(
        description="moving mass of the slider"
    )
    damping: Annotated[Parameter, In("kg/s", "nonnegative")] = Field(
        ZERO, description="viscous damping b_x"
    )
    friction: SliderFriction = Field(SliderFriction(), description="Coulomb friction")
    hysteresis: SliderHysteresis | None = INSIDE
    backlash: SliderBacklash | None = Field(
        None, description="free play between its sensor and its tendons"
    )
    stops: Annotated[tuple[float, float], In("m")] | None = Field(
        None, description="range of the slider [x_L, x_H]"
    )
    stop_stiffness: Stiffness = Field(
        Parameter(value=1e5), description="stiffness of the stops k_s"
    )
    stop_damping: Annotated[Parameter, In("kg/s", "nonnegative")] = Field(
        Parameter(value=3.0), description="viscous damping in the stops b_s"
    )
    nominal_force: Annotated[Parameter, In("N", drifts=False)] = Field(
        ZERO, description="the usual pull, taken where no force is measured"
    )
    limit: PositiveNewtons | None = Field(
        None, description="largest force that a controller gets from it; it cannot push its tendons"
    )
    lag: Seconds = Field(
        0.0, description="time constant with which its force follows a controller's command"
    )
    servo: SliderServo | None = Field(None, description="how it follows places that are sent to it")

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
    inertia: Annotated[Parameter, In("kg m^2", "positive")] = Field(
        description="moment of inertia of rotor and capstan, seen at the capstan"
    )
    radius: Length = Field(description="radius of the capstan R")
    damping: AngularDamping = Field(ZERO, description="viscous damping")
    friction: CapstanFriction = Field(CapstanFriction(), description="Coulomb friction")
    hysteresis: Hysteresis | None = INSIDE
    backlash: Backlash | None = Field(
        None, description="free play between its encoder and its capstan"
    )
    cogging: Cogging | None = Field(None, description="torque that repeats as the motor turns")
    stops: Annotated[tuple[float, float], In("rad")] | None = Field(
        None, description="range of the capstan's angle"
    )
    stop_stiffness: Annotated[Parameter, In("N m/rad", "positive")] = Field(
        Parameter(value=100.0), description="stiffness of the stops"
    )
    stop_damping: AngularDamping = Field(
        Parameter(value=0.1), description="viscous damping in the stops"
    )
    nominal_force: Annotated[Parameter, In("N m", drifts=False)] = Field(
        ZERO, description="the usual torque, taken where no torque is measured"
    )
    limit: Annotated[float, In("N m", "positive")] | None = Field(
        None, description="largest torque that a controller gets from it, either way"
    )
    lag: Seconds = Field(
        0.0, description="time constant with which its torque follows a controller's command"
    )
    servo: Servo | None = Field(None, description="how it follows angles that are sent to it")

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
