"""The innovations of forces that are normal while nothing touches the joints; `distal fit` learns
them.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees
from typing import Self

from pydantic import Field, model_validator

from distal.rig.learned_map import Row
from distal.rig.quantities import Description
from distal.rounded import rounded

UNLIMITED = 1e300
"""Squared speed v² that no drive reaches [1/s²]. Source: definition (no limit)."""

NOTHING_NORMAL = {"at_rest": 1.0, "moving": 0.0, "fastest": UNLIMITED}
"""What stands in place of `FreeMotion.of_channel` for a rig without [free_motion]."""


STRAYS_FURTHER = 1.5
"""A number of a rig may be so many times as far from its prior as in the logs [1]. Source:
judgement.
"""


class FreeMotion(Description):
    """The innovations that are normal in free motion, on logs that the fit had not seen.

    The mean innovation of a force stays below √(a² + b² v²) standard deviations for 99.7 % of the
    time, with v² = Σ (ẋ_i/spread_i)² over all drives that move with it. A larger one is a touch, or
    a change of the rig. Where v² is above `fastest`, the largest of the logs, the limit is
    multiplied by v/√fastest, since nothing was learned there.
    """

    channels: tuple[str, ...] = Field(min_length=1, description="sensors of forces and tensions")
    at_rest: Row = Field(description="a of each [1]")
    moving: Row = Field(description="b of each [s]")
    squares: Row = Field(
        description="largest normal mean of ν²/S over a second of each, ν its innovation and S the "
        "variance that the filter expects [1]"
    )
    correlations: Row = Field(
        description="correlation of each one's neighbouring innovations, from −1 to 1"
    )
    rms: float = Field(ge=0.0, description="RMS error of the angles on these logs [rad]")
    inside: float = Field(ge=0.0, le=1.0, description="share of their samples inside the 95 % band")
    felt: Row = Field(
        description="torque of each joint from which on a touch is felt, in the median [N m]; 0 of "
        "one where none is"
    )
    strayed: float = Field(
        0.0,
        ge=0.0,
        description="by how many of its stds a number of the rig was off its prior at most, beyond "
        "its own std then [1]",
    )
    fastest: float = Field(UNLIMITED, gt=0.0, description="largest v² in the logs [1/s²]")
    drives: tuple[str, ...] = Field(min_length=1, description="the drives")
    spread: Row = Field(description="standard deviation of each drive's positions in the logs [SI]")
    logs: int = Field(gt=0, description="number of logs")

    @model_validator(mode="after")
    def _sizes_fit(self) -> Self:
        of_channels = ("at_rest", "moving", "squares", "correlations")
        sizes = {**dict.fromkeys(of_channels, len(self.channels)), "spread": len(self.drives)}
        for name, size in sizes.items():
            values = getattr(self, name)
            if len(values) != size:
                raise ValueError(f"{name} must have {size} entries; {len(values)} came")
            if name != "correlations" and min(values) < 0.0:
                raise ValueError(f"{name} must not be negative")
        if 0.0 in (*self.at_rest, *self.squares, *self.spread):
            raise ValueError("at_rest, squares and spread must be positive")
        return self

    def in_words(self) -> str:
        """Return a line on the errors of the angles on logs that the fit had not seen."""
        return (
            f"on {self.logs} logs left out of its fit the rig errs by "
            f"{rounded(degrees(self.rms))}°, {100 * self.inside:.0f} % inside the 95 % band"
        )

    def departure(self, exact: float) -> float:
        """Return from how many of its stds on a number of the rig is too far from its prior; of a
        model that is exact that would be from `exact` on.
        """
        return max(exact, STRAYS_FURTHER * self.strayed)

    def of_channel(self, name: str) -> dict[str, float]:
        """Return what is normal of a sensor: `at_rest` a [1], `moving` b [s], and `fastest`, the
        largest v² in the logs [1/s²]. A sensor that the logs lacked gets the largest a and b of the
        others.
        """
        if name not in self.channels:
            at_rest = max(self.at_rest)
            moving = max(self.moving)
        else:
            at = self.channels.index(name)
            at_rest = self.at_rest[at]
            moving = self.moving[at]
        return {"at_rest": at_rest, "moving": moving, "fastest": self.fastest}

    def usual(self, names: Sequence[str]) -> tuple[tuple[float, float], ...]:
        """Return for each named sensor the largest normal mean of ν²/S over a second, and the
        correlation of its neighbouring innovations. A sensor that the logs lacked gets 1 and 0, as
        if the filter's model were exact.
        """
        by_name = dict(zip(self.channels, zip(self.squares, self.correlations)))
        return tuple(by_name.get(name, (1.0, 0.0)) for name in names)

    def of_drive(self, name: str) -> float:
        """Return the spread of a drive's positions [SI]; a drive that the logs lacked gets the
        smallest one.
        """
        return self.spread[self.drives.index(name)] if name in self.drives else min(self.spread)
