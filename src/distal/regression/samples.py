"""Samples of a log from which a map learns.

Cross-validation: which logs are held out together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np

from distal.arrays import Bools, Floats
from distal.kernels import Feed, Kernel, advance


@dataclass(frozen=True)
class Samples:
    """A log as the input of a map.

    Args:
        source: name of the log.
        time: time since the first sample [s], (k,).
        readings: readings of the channels, NaN where one is missing [SI], (k, m).
        angles: the filter's angles of the joints [rad], which a map may read, (k, n_joints), or
            none of them, (k, 0).
        targets: the values to be mapped: angles [rad], errors of the filter's angles [rad], or
            external torques [N m]; NaN where not known, (k, n_joints).
        variances: variances of the filter's own angles [rad²], zero where there is no filter, (k,
            n_joints).
    """

    source: str
    time: Floats
    readings: Floats
    angles: Floats
    targets: Floats
    variances: Floats

    @property
    def every(self) -> Floats:
        """The readings and angles side by side, (k, m) or (k, m + n_joints)."""
        return np.column_stack([self.readings, self.angles])

    @property
    def held(self) -> Floats:
        """The readings, each missing one replaced by the last before it, at the beginning by the
        first after it.
        """
        columns = []
        for values in self.readings.T:
            is_finite = np.isfinite(values)
            last = np.maximum.accumulate(np.where(is_finite, np.arange(len(values)), -1))
            columns.append(values[np.where(last >= 0, last, int(np.argmax(is_finite)))])
        return np.column_stack(columns)

    def part(self, rows: Bools) -> Samples:
        """Return the samples that a mask `rows`, (k,), holds."""
        names = ("time", "readings", "angles", "targets", "variances")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


@cache
def _play() -> Kernel:
    """Return the kernel of a play operator, (z, x, w) → (z⁺, z⁺): its output is also its kernel
    state.
    """
    z, x, w = (ca.SX.sym(name) for name in ("z", "x", "w"))
    after = ca.fmin(ca.fmax(z, x - w), x + w)
    return Kernel(ca.Function("play", [z, x, w], [after, after]))


def played(values: Floats, half: float) -> Floats:
    """Return readings `values` x, (k,), after a play operator of half-width w = `half`: z⁺ =
    min(max(z, x − w), x + w).

    Noise below w does not change the output, it keeps its value while the input rests, and it does
    not depend on the input's rate (Visintin, 1994, ch. III).
    """
    after: Floats = advance(_play(), Feed(values[:1], values[:, None], np.array([half]))).ys[:, 0]
    return after
