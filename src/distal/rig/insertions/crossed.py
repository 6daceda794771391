"""A tendon that crosses one of several joints: which joint, on which side, and its
friction there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from pydantic import Field

from distal.rig.quantities import ZERO, Description, In, Parameter

if TYPE_CHECKING:
    from distal.expressions import Scalar

Size: TypeAlias = "Callable[[str], Scalar]"
"""Name of one of an insertion's numbers → its symbol or value.

The method `elongation` of an insertion takes such a function, its side (+1 pulls the joint to +θ,
−1 to −θ), the angles of its joints [rad] and the displacement x [m] of the tendon's proximal end,
away from the joint. It returns what angles and displacement add to the tendon's free length l [m].
"""


class Guide(Description):
    """Friction of a tendon where it crosses a joint, by the capstan equation; see `Path`."""

    friction: Annotated[Parameter, In("", "nonnegative")] = Field(
        description="friction coefficient against its guide, μ"
    )
    wrap: Annotated[Parameter, In("rad", "nonnegative")] = Field(
        description="angle that it wraps at θ = 0, β"
    )
    wrap_slope: Annotated[Parameter, In("")] = Field(
        ZERO, description="change of β per radian of the joint"
    )


class Crossed(Description):
    """Which joint a tendon crosses, and on which side."""

    joint: str = Field(description="name of the joint")
    side: Literal[1, -1] = Field(description="+1 pulls the joint to +θ, −1 to −θ")
    guide: Guide | None = Field(None, description="friction along the tendon's way over this joint")
