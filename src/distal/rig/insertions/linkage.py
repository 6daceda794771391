"""A linkage, or a pulley that is not round."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import casadi as ca
from pydantic import Field

from distal.rig.insertions.crossed import Crossed, Size
from distal.rig.quantities import Description, In, Parameter

if TYPE_CHECKING:
    from distal.expressions import Scalar

NEWTON_STEPS = 12
"""Iterations of the inverse of the excursion: it is nearly a straight line."""


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

    def excursion(self, size: Size, angle: Scalar) -> Scalar:
        """Return how far it draws its tendon from θ = 0 to θ: r [u + s u²/2 + c u³/3], u = θ − θ_c, less that at 0.

        Args:
            angle: θ [rad].
        """
        centre, slope, curvature = size("centre"), size("slope"), size("curvature")

        def drawn(u: Scalar) -> Scalar:
            return u * (1 + u * (slope / 2 + u * curvature / 3))

        return size("radius") * (drawn(angle - centre) - drawn(-centre))

    def elongation(self, size: Size, side: int, angles: Sequence[Scalar], displacement: Scalar) -> Scalar:
        """Return ℓ − l, what the joint's angle and the drive's displacement add to the tendon's free length.

        Args:
            side: +1 pulls the joint to +θ, −1 to −θ.
            angles: joint angle θ [rad], the only one.
            displacement: of the tendon's proximal end, away from the joint, x [m].
        """
        return displacement - side * self.excursion(size, angles[0])

    def angle_at(self, size: Size, side: int, elongated: Scalar, displacement: Scalar) -> Scalar:
        """Return the joint angle θ [rad] at which the tendon has the given ℓ − l: the inverse of `elongation`.

        Args:
            side: +1 pulls the joint to +θ, −1 to −θ.
            elongated: ℓ − l [m].
            displacement: x [m].
        """
        wanted, radius = side * (displacement - elongated), size("radius")
        centre, slope, curvature = size("centre"), size("slope"), size("curvature")
        angle = centre + (wanted - self.excursion(size, centre)) / radius
        for _ in range(NEWTON_STEPS):
            u = angle - centre
            # the arm is kept away from zero, where no angle fits
            arm = radius * ca.fmax(1 + u * (slope + u * curvature), 0.2)
            angle = angle + (wanted - self.excursion(size, angle)) / arm
        return angle


class CrossedLinkage(Crossed, Linkage):
    """A tendon at a linkage or a pulley that is not round, one of several that it crosses."""
