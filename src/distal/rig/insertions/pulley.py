"""A tendon that wraps round a pulley at the joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from distal.rig.insertions.crossed import Crossed, Size
from distal.rig.quantities import Description, In, Parameter

if TYPE_CHECKING:
    from distal.expressions import Scalar


class Pulley(Description):
    """The tendon wraps round a pulley at the joint: ℓ = l + x ∓ r θ."""

    kind: Literal["pulley"]
    radius: Annotated[Parameter, In("m", "positive")] = Field(description="radius of the pulley, r")

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
    """A tendon over a pulley at a joint, one of several that it crosses."""
