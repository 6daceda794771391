"""Tendons and how they are fixed to the joint."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from distal.rig.quantities import Description, In, Name, Parameter


class Pinned(Description):
    """The tendon ends at a pin on the link: ℓ = sqrt(r²(1 − cos θ)² + (l + x ∓ r sin θ)²), equations (4) and (5)."""

    kind: Literal["pinned"]
    radius: Annotated[Parameter, In("m", "positive")] = Field(description="axis to insertion, r")
    free_length: Annotated[Parameter, In("m", "positive")] = Field(description="free length of the tendon, l")


class Pulley(Description):
    """The tendon wraps round a pulley at the joint: ℓ = l + x ∓ r θ."""

    kind: Literal["pulley"]
    radius: Annotated[Parameter, In("m", "positive")] = Field(description="radius of the pulley, r")


class Linkage(Description):
    """A linkage, or a pulley that is not round: its moment arm is r (1 + s u + c u²) with u = θ − θ_c.

    ℓ = l + x ∓ r [u + s u²/2 + c u³/3], less the same at θ = 0: the transmission ratio varies with the angle.
    """

    kind: Literal["linkage"]
    radius: Annotated[Parameter, In("m", "positive")] = Field(description="moment arm at the centre, r")
    centre: Annotated[Parameter, In("rad", drifts=False)] = Field(
        Parameter(value=0.0), description="angle about which the arm is described, θ_c"
    )
    slope: Annotated[Parameter, In("1/rad")] = Field(
        Parameter(value=0.0), description="s, change of the arm per radian"
    )
    curvature: Annotated[Parameter, In("1/rad^2")] = Field(Parameter(value=0.0), description="c, its second order")


Insertion = Annotated[Pinned | Pulley | Linkage, Field(discriminator="kind")]


class Path(Description):
    """Friction along the tendon's way, by the capstan equation T_drive = T e^{±μβ}; it acts on the drive's side."""

    friction: Annotated[Parameter, In("", "nonnegative")] = Field(
        description="friction coefficient against its guides, μ"
    )
    wrap: Annotated[Parameter, In("rad", "nonnegative")] = Field(description="sum of the bends of its path, β")
    wrap_slope: Annotated[Parameter, In("")] = Field(
        Parameter(value=0.0), description="change of β per radian of the joint"
    )


class Tendon(Description):
    """A tendon from a drive to a joint; T = max(k δ + c δ̇, 0) for a stretch δ > 0, else 0.

    With `stiffening` a, T = T_pre + k (e^{aδ} − 1)/a: its stiffness is k + a (T − T_pre). With `slack`, δ is what is
    left of the elongation beyond it.
    """

    name: Name
    joint: str = Field(description="name of the joint that it moves")
    drive: str = Field(description="name of the drive that pulls it")
    side: Literal[1, -1] = Field(description="+1 pulls the joint to +θ, −1 to −θ")
    insertion: Insertion = Field(description="how it meets the joint")
    stiffness: Annotated[Parameter, In("N/m", "positive")] = Field(description="spring constant k")
    damping: Annotated[Parameter, In("N s/m", "nonnegative")] = Field(Parameter(value=0.0), description="damping c")
    pretension: Annotated[Parameter, In("N", "nonnegative")] = Field(
        Parameter(value=0.0), description="tension at zero angle and zero drive displacement"
    )
    slack: Annotated[Parameter, In("m", "nonnegative")] = Field(
        Parameter(value=0.0),
        description="how far it must be pulled at zero angle and zero drive displacement to be taut",
    )
    stiffening: Annotated[Parameter, In("1/m", "nonnegative")] = Field(
        Parameter(value=0.0), description="growth of stiffness with tension, a"
    )
    path: Path | None = Field(None, description="friction along its way")

    @model_validator(mode="after")
    def _slack_or_pulled(self) -> Self:
        if not self.slack.absent and not self.pretension.absent:
            raise ValueError("slack: a tendon is slack at home, or pulled there by its 'pretension'; give one of them")
        return self
