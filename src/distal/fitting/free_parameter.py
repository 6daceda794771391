"""What a fit varies: a parameter of the rig, or several by one factor, with prior and bounds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import exp, inf, isnan, log, log1p

STEPPING = 1e-3
"""Share of a value that stays uncertain however long the logs are, because of the model's time step
and of the straight lines between samples. Source: judgement.
"""

POINTS = 0.04
"""Share of a sheath's friction that stays uncertain if one point stands for the whole cable; with N
points it is an Nth of this. Source: benchmark (benchmarks/parts).
"""


NOISY = 0.01
"""Share of a drive's damping or backlash that stays uncertain, since noise of the displacements is
in the speed that damping acts on, and pushes the ends of the gap. Source: benchmark
(benchmarks/parts).
"""


@dataclass(frozen=True)
class Free:
    """A parameter that is varied, or several that are varied by a common factor; scale, bounds and
    unit are those of the first.

    Its coordinate z is ln(value/start) where it is `logarithmic`, else (value − start)/scale.

    Args:
        name: name in words, for tables.
        paths: paths of the parameters in the description.
        starts: their values where the fit starts; the first is the mean of the prior.
        std: std of the prior; NaN where there is none.
        scale: change of the value for one unit of the coordinate.
        low: lower bound of the value.
        high: upper bound of the value.
        si: SI unit.
        logarithmic: whether the coordinate is a logarithm; the prior is then on it, with std ln(1 +
            std/start).
        per_log: whether each log has a value of its own.
        noise: whether it is the size of a noise.
        kept_by_file: whether a fitted file keeps the start where a smaller value was found.
        coarse: share of the value that stays uncertain because of the model, however long the logs.
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
        """The value of the first parameter where the fit starts."""
        return self.starts[0]

    @property
    def has_prior(self) -> bool:
        """Whether the parameter has a prior."""
        return not isnan(self.std)

    @property
    def spread(self) -> float:
        """Standard deviation of the prior in the coordinate; NaN where there is none."""
        if not self.has_prior:
            return float("nan")
        return log1p(self.std / self.start) if self.logarithmic else self.std / self.scale

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value of the first parameter, 0 for a value that has no
        logarithm.
        """
        if not self.logarithmic:
            return (value - self.start) / self.scale
        return log(value / self.start) if value > 0.0 else 0.0

    def value(self, z: float) -> float:
        """Return the value of the first parameter at a coordinate, within its bounds."""
        low, high = self.bounds
        z = min(max(z, low), high)
        number = self.start * exp(z) if self.logarithmic else self.start + self.scale * z
        return min(max(number, self.low), self.high)  # rounding may lead beyond a bound

    def values(self, z: float) -> tuple[float, ...]:
        """Return the values of all parameters at a coordinate."""
        first = self.value(z)
        if len(set(self.starts)) == 1:
            return (first,) * len(self.starts)
        return tuple(first * start / self.start for start in self.starts)

    @cached_property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper bound of the coordinate."""
        if self.logarithmic:
            return _log(self.low / self.start), _log(self.high / self.start)
        return (self.low - self.start) / self.scale, (self.high - self.start) / self.scale

    def unit(self, z: float) -> float:
        """Return the change of the coordinate that stands for the whole value at z, or for `scale`
        where the value may be zero or negative.
        """
        if self.logarithmic or self.low < 0.0 or self.start <= 0.0:
            return 1.0
        # slopes go over the same share of each value: two parameters that show only as a product
        # then meet the same kinks
        return max(self.value(z) / self.scale, 0.1)

    def slope(self, z: float) -> float:
        """Return the derivative of the first parameter's value by the coordinate, d value/dz."""
        return self.value(z) if self.logarithmic else self.scale


def _log(value: float) -> float:
    return log(value) if value > 0.0 else -inf
