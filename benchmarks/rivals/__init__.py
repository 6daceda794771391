"""Rivals of `adaptive`, for benchmarks only: other ways to treat the same model, at a multiple of
its cost.

`iterated` linearises each row of the update again, `unscented` carries sigma points, `particle`
carries draws. Each is made from the parts of `distal.estimators.adaptive`, so that what differs is
the filter and not the model. The last two know nothing of hysteresis: what a drive's play passes on
stays as it was at the start.
"""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.rivals.iterated import IteratedFilter
from benchmarks.rivals.particle import PARTICLES, ParticleFilter
from benchmarks.rivals.unscented import UnscentedFilter
from distal import Rig
from distal.estimators import KernelEstimator

RIVALS: dict[str, Callable[[Rig], KernelEstimator]] = {
    "iterated": IteratedFilter,
    "unscented": UnscentedFilter,
    "particle": ParticleFilter,
}
"""Name → maker (rig)."""

__all__ = ["PARTICLES", "RIVALS", "IteratedFilter", "ParticleFilter", "UnscentedFilter"]
