"""A tendon that ends at a pin on the link."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import casadi as ca
from pydantic import Field

from distal.rig.insertions.crossed import Crossed, Size
from distal.rig.quantities import Description, In, Parameter

if TYPE_CHECKING:
    from distal.expressions import Scalar


class Pinned(Description):
    """The tendon ends at a pin on the link: ℓ = sqrt(r²(1 − cos θ)² + (l + x ∓ r sin θ)²),
    equations (4) and (5).
    """

    kind: Literal["pinned"]
    radius: Annotated[Parameter, In("m", "positive")] = Field(description="axis to insertion, r")
    free_length: Annotated[Parameter, In("m", "positive")] = Field(
        description="free length of the tendon, l"
    )

    def arm(self, angle: float) -> float:
        """Return the moment arm at θ = 0 [m], the radius of the pin, whatever the `angle`."""
        return self.radius.value

    def elongation(
        self, size: Size, side: int, angles: Sequence[Scalar], displacement: Scalar
    ) -> Scalar:
        """Return ℓ − l [m], by how much the angle of the joint (the only one of `angles`) and the
        `displacement` of the drive lengthen the tendon's way; see `Size`.

        Mend: the paper prints "− r sin θ" for both tendons. The second insertion is opposite to the
        first, so that it moves the other way and the sign is `side`.
        """
        (angle,) = angles
        radius = size("radius")
        free_length = size("free_length")
        # (4) and (5) multiplied out: ℓ² = A² − 2 side r A sin θ + 2 r² (1 − cos θ), A = l + x, has
        # the shorter derivatives
        along = free_length + displacement
        square = along * (along - 2 * side * radius * ca.sin(angle)) + 2 * radius * radius * (
            1 - ca.cos(angle)
        )
        return ca.sqrt(square) - free_length

    def angle_at(self, size: Size, side: int, elongated: Scalar, displacement: Scalar) -> Scalar:
        """Return the angle θ [rad] at which ℓ − l is `elongated` [m] at a `displacement` x [m]: the
        inverse of `elongation`.

        Squaring (4) gives r cos θ + side · A sin θ = (2r² + A² − ℓ²)/(2r) with A = l + x, a shifted
        sine. Where no angle fits (the drive moved further than the insertion can follow), the
        nearest one is returned.
        """
        radius = size("radius")
        free_length = size("free_length")
        along = free_length + displacement
        length = free_length + elongated
        level = (2 * radius * radius + along * along - length * length) / (2 * radius)
        amplitude = ca.sqrt(radius * radius + along * along)
        ratio = ca.fmin(ca.fmax(level / amplitude, -1), 1)
        return side * (ca.asin(ratio) - ca.atan2(radius, along))


class CrossedPinned(Crossed, Pinned):
    """A tendon that ends at a pin of a joint's link, one of several that it crosses."""
