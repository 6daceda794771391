"""Tendons and how they are fixed to the joint."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

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


Insertion = Annotated[Pinned | Pulley, Field(discriminator="kind")]


class Tendon(Description):
    """A tendon from a drive to a joint; T = max(k δ + c δ̇, 0) for a stretch δ > 0, else 0."""

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
