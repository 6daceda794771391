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

    def elongation(self, size: Size, side: int, angles: Sequence[Scalar], displacement: Scalar) -> Scalar:
        """Return ℓ − l, what the joint's angle and the drive's displacement add to the tendon's free length.

        Args:
            side: +1 pulls the joint to +θ, −1 to −θ.
            angles: joint angle θ [rad], the only one.
            displacement: of the tendon's proximal end, away from the joint, x [m].
        """
        return displacement - side * size("radius") * angles[0]

    def angle_at(self, size: Size, side: int, elongated: Scalar, displacement: Scalar) -> Scalar:
        """Return the joint angle θ [rad] at which the tendon has the given ℓ − l: the inverse of `elongation`.

        Args:
            side: +1 pulls the joint to +θ, −1 to −θ.
            elongated: ℓ − l [m].
            displacement: x [m].
        """
        return side * (displacement - elongated) / size("radius")


class CrossedPulley(Crossed, Pulley):
    """A tendon over a pulley at a joint, one of several that it crosses."""
