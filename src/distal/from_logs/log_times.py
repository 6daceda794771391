"""The unit of time of some logs, and how often each column has a new value."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.errors import RigError
from distal.from_logs.column_role import ColumnRole
from distal.from_logs.raw_log import RawLog
from distal.units import unit_factor

SLOWEST = 0.5
"""Least rate of a log [Hz]. Source: judgement."""


FASTEST = 2e4
"""Largest rate of a log [Hz]. Source: judgement."""


TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of time in a log [s]. Source: definition."""


def time_unit(time: ColumnRole, logs: Sequence[RawLog]) -> tuple[str, list[str]]:
    """Return the unit of time, that of the header where the rate is possible, else by the steps;
    and a sentence where the header says another.
    """
    steps = np.concatenate([np.diff(log.columns[time.header]) for log in logs])
    step = float(np.median(steps[steps > 0.0]))
    unit = time.unit or "s"
    size = unit_factor(unit, "s")
    if SLOWEST <= 1.0 / (step * size) <= FASTEST:
        return unit, []
    possible = [
        unit for unit, size in TIME_UNITS.items() if SLOWEST <= 1.0 / (step * size) <= FASTEST
    ]
    if not possible:
        raise RigError(f"{time.header} steps by {step:g}: no unit makes a rate of that")
    note = (
        f"{time.header} steps by {step:g}: taken as {possible[0]}, since in {unit} there would be "
        f"{1.0 / (step * size):.3g} samples in a second"
    )
    return possible[0], [note]


def rates_of(logs: Sequence[RawLog], time: ColumnRole, unit: str) -> dict[str, float]:
    """Return how often each column has a new sample [Hz]."""
    rates = dict[str, float]()
    for log in logs:
        stamps = log.columns[time.header] * unit_factor(unit, "s")
        for name, values in log.columns.items():
            there = np.isfinite(values)
            if there.sum() > 1 and name not in rates:
                span = max(float(np.ptp(stamps[there])), 1e-9)
                rates[name] = float(f"{(there.sum() - 1) / span:.3g}")
    return rates
