"""Drives: what pulls the tendons at the proximal end, a slider or a motor's capstan."""

from __future__ import annotations

from math import pi
from typing import Annotated, Literal

from pydantic import Field

from distal.rig.joints import STOPS, Stribeck
from distal.rig.quantities import (
    ZERO,
    AngularDamping,
    AngularRange,
    AnyTorque,
    Coefficient,
    Description,
    Displacement,
    Duration,
    Factor,
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
    Seconds,
    Stiffness,
    TorqueSize,
    Turn,
)

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
    inertia: Annotated[Parameter, In("kg m^2", "positive")] = Field(
        description="of rotor and capstan, at the capstan"
    )
    radius: Length = Field(description="of the capstan, R")
    damping: AngularDamping = VISCOUS
    friction: CapstanFriction = CapstanFriction()
    hysteresis: Hysteresis | None = None
    backlash: Backlash | None = None
    cogging: Cogging | None = None
    stops: AngularRange | None = STOPS
    stop_stiffness: Annotated[Parameter, In("N m/rad", "positive")] = Parameter(value=100.0)
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
