"""The share of rigs that meet a requirement."""

from __future__ import annotations

from dataclasses import dataclass

from distal.arrays import Bools

FEWEST = 20
"""Smallest number of rigs in a part of the space for which a share is stated [1]. Source:
judgement.
"""


@dataclass(frozen=True)
class Proportion:
    """The share of `rigs` that meet the requirement, `met` of them, with its 95 % interval from
    `low` to `high` (Wilson, 1927).
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
