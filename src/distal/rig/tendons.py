"""Tendons and how they are fixed to the joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from distal.rig.quantities import (
    ONE,
    ZERO,
    Coefficient,
    Description,
    In,
    Load,
    Name,
    Parameter,
    Stiffness,
    Turn,
)
from distal.rig.tendon_crossings import (
    Crossing,
    Insertion,
    Polynomial,
    Shape,
)


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
            return self
        missing = [name for name, value in short.items() if value is None]
        if missing:
            raise ValueError(
                f"{missing[0]}: is missing (or give 'crossings', one for each joint that it "
                "crosses)"
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
        totals = [sum(abs(arm) for arm in self.arms(at).values()) for at in positions]
        return totals[0] or max(totals)

    @model_validator(mode="after")
    def _forms_agree(self) -> Self:
        if not self.slack.absent and not self.pretension.absent:
            raise ValueError(
                "slack: a tendon is slack at home, or pulled there by its 'pretension'; give one "
                "of them"
            )
        return self
