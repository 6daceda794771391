"""What forces are like when nothing touches the joints: `distal fit` learns it from logs left out."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from distal.rig.learned_map import Row
from distal.rig.quantities import Description


class FreeMotion(Description):
    """The innovations that are normal in free motion, on logs that the fit had not seen.

    A force's mean innovation stays below z₀ = √(a² + b² v²) of its standard deviations in 99.8 % of
    the time, v² = Σ (ẋ_i/spread_i)² being the squared speed of all drives that move with it. More
    than that is a touch, or a change of the rig.
    """

    channels: tuple[str, ...] = Field(min_length=1, description="sensors of forces and tensions")
    at_rest: Row = Field(description="a of each [1]")
    moving: Row = Field(description="b of each [s]")
    drives: tuple[str, ...] = Field(min_length=1, description="the drives")
    spread: Row = Field(description="standard deviation of each drive's positions in the logs [SI]")
    logs: int = Field(gt=0, description="number of logs")

    @model_validator(mode="after")
    def _sizes_fit(self) -> Self:
        for name, size in (
            ("at_rest", len(self.channels)),
            ("moving", len(self.channels)),
            ("spread", len(self.drives)),
        ):
            numbers = getattr(self, name)
            if len(numbers) != size:
                raise ValueError(f"{name} must have {size} entries; {len(numbers)} came")
            if min(numbers) < 0.0:
                raise ValueError(f"{name} must not be negative")
        if 0.0 in (*self.at_rest, *self.spread):
            raise ValueError("at_rest and spread must be positive")
        return self

    def of_channel(self, name: str) -> tuple[float, float]:
        """Return a [1] and b [s] of a sensor; of one that the logs lacked, the largest of each."""
        if name not in self.channels:
            return max(self.at_rest), max(self.moving)
        at = self.channels.index(name)
        return self.at_rest[at], self.moving[at]

    def of_drive(self, name: str) -> float:
        """Return the spread of a drive's positions [SI]; of one that the logs lacked, the
        smallest.
        """
        return self.spread[self.drives.index(name)] if name in self.drives else min(self.spread)
