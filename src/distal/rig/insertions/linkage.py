"""A linkage, or a pulley that is not round."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import casadi as ca
from pydantic import Field

from distal.rig.insertions.crossed import Crossed, Size
from distal.rig.quantities import ZERO, Description, In, Parameter

if TYPE_CHECKING:
    from distal.expressions import Scalar

NEWTON_STEPS = 12
"""Number of Newton's iterations that invert the excursion, which is nearly linear [1]. Source:
judgement.
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
    radius: Annotated[Parameter, In("m", "positive")] = Field(
        description="moment arm at the centre, r"
    )
    centre: Annotated[Parameter, In("rad", drifts=False)] = Field(
        ZERO, description="angle about which the arm is described, θ_c"
    )
    slope: Annotated[Parameter, In("1/rad")] = Field(
        ZERO, description="s, change of the arm per radian"
    )
    curvature: Annotated[Parameter, In("1/rad^2")] = Field(ZERO, description="c, its second order")

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
        slope = size("slope")
        curvature = size("curvature")
        angle = centre + (desired - self.excursion(size, centre)) / radius
        for _ in range(NEWTON_STEPS):
            u = angle - centre
            # the arm is kept away from zero, where no angle fits
            arm = radius * ca.fmax(growth(u, slope, curvature), 0.2)
            angle = angle + (desired - self.excursion(size, angle)) / arm
        return angle


class CrossedLinkage(Crossed, Linkage):
    """A tendon at a linkage or a pulley that is not round, one of several that it crosses."""
