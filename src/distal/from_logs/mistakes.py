"""Mistakes in logs that would make a wrong rig: each is named before anything is written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from distal.from_logs.column_role import ColumnRole
from distal.from_logs.motion_data import MotionData
from distal.from_logs.odd_log import odd_log
from distal.from_logs.raw_log import RawLog
from distal.from_logs.structure import reference_lag

RATES_DIFFER = 3.0
"""Ratio of the sampling rates of two logs from which on a unit of time is wrong [1]. Source:
judgement.
"""

GAP = 4.0
"""Interval per usual interval from which on rows are missing [1]. Source: judgement."""

LATE = 0.03
"""Lag of a reference that is named [s]. Source: judgement."""

SHORTEST_ARM = 5e-4
"""Least moment arm of a hand or an instrument [m]. Source: judgement."""

LONGEST_ARM = 0.1
"""Largest moment arm of a hand or an instrument [m]. Source: judgement."""


def mistakes(
    raw: Sequence[RawLog], columns: Sequence[ColumnRole], data: Sequence[MotionData]
) -> list[str]:
    """Return a sentence for each mistake because of which no rig can be written."""
    drives = [column.header for column in columns if column.role == "position"]
    joints = [column.header for column in columns if column.role == "angle"]
    sentences = [*_times(raw, columns), *_wrapped(columns), *_constant(raw, [*drives, *joints])]
    if sentences:
        return sentences
    odd = odd_log(data, drives, joints)
    return [] if odd is None else [odd]


def remarks(
    raw: Sequence[RawLog], columns: Sequence[ColumnRole], data: Sequence[MotionData]
) -> list[str]:
    """Return a sentence for each thing in the logs that a rig can be written in spite of."""
    lines = list(_gaps(raw, columns))
    joints = [column.header for column in columns if column.role == "angle"]
    for j, name in enumerate(joints):
        lag = reference_lag(data, j)
        if abs(lag) > LATE:
            which = "later" if lag > 0.0 else "earlier"
            lines.append(
                f"{name} is {1e3 * abs(lag):.0f} ms {which} than the drives, and errors beside it "
                "contain that: shift its column, or read both by one clock"
            )
    return lines


def _stamp(columns: Sequence[ColumnRole]) -> str:
    return next(column.header for column in columns if column.role == "time")


def _times(raw: Sequence[RawLog], columns: Sequence[ColumnRole]) -> Iterator[str]:
    name = _stamp(columns)
    steps = [float(np.median(np.diff(log.columns[name]))) for log in raw]
    usual = float(np.median(steps))
    for log, step in zip(raw, steps):
        ratio = max(step, usual) / max(min(step, usual), 1e-300)
        if ratio > RATES_DIFFER:
            yield (
                f"{log.source}: {name} steps by {step:g}, in the other logs by {usual:g}; is it in "
                "another unit? Correct the file"
            )


def _wrapped(columns: Sequence[ColumnRole]) -> Iterator[str]:
    for column in columns:
        if column.role in ("position", "angle") and column.values.turn is not None:
            yield (
                f"{column.header} wraps after {column.values.turn:g}: a rig file cannot unwrap it; "
                "write a count that goes on (numpy.unwrap with this period)"
            )


def _constant(raw: Sequence[RawLog], headers: Sequence[str]) -> Iterator[str]:
    for log in raw:
        for header in headers:
            values = log.columns[header]
            if np.nanmax(values) == np.nanmin(values):
                yield f"{log.source}: {header} never changes there; leave this log out"


def _gaps(raw: Sequence[RawLog], columns: Sequence[ColumnRole]) -> Iterator[str]:
    name = _stamp(columns)
    for log in raw:
        steps = np.diff(log.columns[name])
        count = int(np.sum(steps > GAP * np.median(steps)))
        if count:
            yield f"{log.source}: rows are missing at {count} places, where {name} jumps"
