"""What a fit varies: a number of the rig, or several by a common factor, with prior and bounds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import exp, inf, isnan, log, log1p

STEPPING = 1e-3
"""Share of a value that the model's time step and the lines between samples leave uncertain,
however long the logs.
"""

POINTS = 0.04
"""Share of a sheath's friction that one point in place of the whole cable leaves uncertain; N
points leave an Nth of it (`python -m benchmarks.parts`).
"""


NOISY = 0.01
"""The same of what shows through the noise of displacements, a drive's damping and backlash: the
noise is in the speed that damping goes by, and pushes the ends of the gap (`python -m
benchmarks.parts`).
"""


@dataclass(frozen=True)
class Free:
    """A number that is varied, or several that are varied by a common factor; scale, bounds and
    unit are the first's.

    Its coordinate z is ln(value/start) where it is `logarithmic`, else (value − start)/scale.

    Args:
        name: for tables.
        paths: of the numbers in the description.
        starts: their values where the fit starts, which is the mean of the prior.
        std: of the prior; NaN where there is none.
        scale: of the coordinate.
        low: lower bound.
        high: upper bound.
        logarithmic: whether the coordinate is a logarithm; the prior is then on it, with std ln(1 +
            std/start).
        per_log: whether each log has its own.
        noise: whether it is a noise, no parameter.
        kept_by_file: whether a fitted file keeps the start where less was found.
        coarse: share of its value that the model itself leaves uncertain, however long the logs.
    """

    name: str
    paths: tuple[str, ...]
    starts: tuple[float, ...]
    std: float
    scale: float
    low: float
    high: float
    si: str = ""
    logarithmic: bool = False
    per_log: bool = False
    noise: bool = False
    kept_by_file: bool = False
    coarse: float = STEPPING

    @property
    def start(self) -> float:
        """Where the first of the numbers starts."""
        return self.starts[0]

    @property
    def has_prior(self) -> bool:
        """Whether there is a prior."""
        return not isnan(self.std)

    @property
    def spread(self) -> float:
        """Standard deviation of the prior in the coordinate; NaN where there is none."""
        if not self.has_prior:
            return float("nan")
        return log1p(self.std / self.start) if self.logarithmic else self.std / self.scale

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value of the first number, 0 for one that has no logarithm."""
        if not self.logarithmic:
            return (value - self.start) / self.scale
        return log(value / self.start) if value > 0.0 else 0.0

    def value(self, z: float) -> float:
        """Return the first number at a coordinate, within its bounds."""
        low, high = self.bounds
        z = min(max(z, low), high)
        number = self.start * exp(z) if self.logarithmic else self.start + self.scale * z
        return min(max(number, self.low), self.high)  # rounding may lead beyond a bound

    def values(self, z: float) -> tuple[float, ...]:
        """Return all numbers at a coordinate."""
        first = self.value(z)
        if len(set(self.starts)) == 1:
            return (first,) * len(self.starts)
        return tuple(first * start / self.start for start in self.starts)

    @cached_property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the coordinate."""
        if self.logarithmic:
            return _log(self.low / self.start), _log(self.high / self.start)
        return (self.low - self.start) / self.scale, (self.high - self.start) / self.scale

    def unit(self, z: float) -> float:
        """Return how much of the coordinate is all of the value, or of the scale where that may be
        zero or negative.
        """
        if self.logarithmic or self.low < 0.0 or self.start <= 0.0:
            return 1.0
        # slopes over the same share for all: what shows only as a product is then seen as one,
        # kinks and all
        return max(self.value(z) / self.scale, 0.1)

    def slope(self, z: float) -> float:
        """Return d value/dz."""
        return self.value(z) if self.logarithmic else self.scale


def _log(value: float) -> float:
    return log(value) if value > 0.0 else -inf
