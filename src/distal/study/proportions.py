"""The share of rigs that meet a requirement."""

from __future__ import annotations

from dataclasses import dataclass

from distal.arrays import Bools

FEWEST = 20
"""A part of the space with fewer rigs says nothing."""


@dataclass(frozen=True)
class Proportion:
    """How many rigs meet the requirement, and their share with its 95 % interval of Wilson
    (1927).
    """

    rigs: int
    met: int
    share: float
    low: float
    high: float

    def __str__(self) -> str:
        return (
            f"{100 * self.share:.0f} % (95 % interval {100 * self.low:.0f} to "
            f"{100 * self.high:.0f} %)"
        )


def proportion(met: Bools) -> Proportion:
    """Return the share of rigs that meet the requirement, (n,)."""
    from scipy.stats import binomtest

    interval = binomtest(int(met.sum()), len(met)).proportion_ci(method="wilson")
    return Proportion(
        len(met), int(met.sum()), float(met.mean()), float(interval.low), float(interval.high)
    )
