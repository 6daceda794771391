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


MOST_NODES = 4
"""More points in a sheath than this change nothing that a sensor sees (docs/sheaths.md)."""


class Path(Description):
    """Friction along the tendon's way, by the capstan equation T_drive = T e^{±μβ}.

    Without `nodes` all of it acts at the drive: a few pulleys there. With them it is spread over the tendon's length, at
    points between its stretches: a cable in its sheath, which stretches differently as it is drawn in and let out.
    """

    friction: Annotated[Parameter, In("", "nonnegative")] = Field(
        description="friction coefficient against its guides, μ"
    )
    wrap: Annotated[Parameter, In("rad", "nonnegative")] = Field(description="sum of the bends of its path, β")
    wrap_slope: Annotated[Parameter, In("")] = Field(
        Parameter(value=0.0), description="change of β per radian of the joint"
    )
    let_out: Annotated[Parameter, In("", "nonnegative")] = Field(
        Parameter(value=1.0), description="friction coefficient while the tendon is let out, as a share of μ"
    )
    nodes: int = Field(
        0, ge=0, le=MOST_NODES, description="points over which the friction is spread; 0 = all at the drive"
    )


class Creep(Description):
    """A tendon that goes on stretching under load: T/k is joined by c with time · dc/dt = share · T/k − c.

    A Kelvin–Voigt element in series with the tendon's spring; together they are the standard linear solid.
    """

    share: Annotated[Parameter, In("", "nonnegative")] = Field(
        description="what is added in the end, as a share of the stretch that comes at once"
    )
    time: Annotated[Parameter, In("s", "positive")] = Field(description="time constant")
    settled: Annotated[Parameter, In("", "nonnegative", drifts=False)] = Field(
        Parameter(value=0.5, std=0.3),
        description="how much of it has come at the log's first sample: 0 = loaded just then, 1 = long ago",
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
    creep: Creep | None = Field(None, description="slow stretch under load")
    slow_creep: Creep | None = Field(None, description="a second one, with another time constant")
    path: Path | None = Field(None, description="friction along its way")

    @model_validator(mode="after")
    def _slack_or_pulled(self) -> Self:
        if not self.slack.absent and not self.pretension.absent:
            raise ValueError("slack: a tendon is slack at home, or pulled there by its 'pretension'; give one of them")
        return self

    @model_validator(mode="after")
    def _slow_creep_is_second(self) -> Self:
        if self.slow_creep is not None and self.creep is None:
            raise ValueError("slow_creep: is a second one; call the only one 'creep'")
        return self

    @model_validator(mode="after")
    def _sheathed(self) -> Self:
        if self.path is not None and self.path.nodes > 0:
            for name in ("damping", "stiffening"):
                if not getattr(self, name).absent:
                    raise ValueError(f"{name}: a tendon with path.nodes is a linear spring without it; leave out one")
        return self
