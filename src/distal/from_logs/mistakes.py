"""Mistakes in logs that would make a wrong rig: each is named before anything is written."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.signal import medfilt

from distal.errors import RigError
from distal.from_logs.column_units import ColumnRole
from distal.from_logs.motion_data import MotionData
from distal.from_logs.odd_log import odd_log
from distal.from_logs.raw_log import RawLog

RATES_DIFFER = 3.0
"""Ratio of the sampling rates of two logs from which on a unit of time is wrong [1]. Source:
judgement.
"""

GAP = 4.0
"""Interval per usual interval from which on rows are missing [1]. Source: judgement."""

SPIKE_WINDOW = 5
"""Samples of the median with which a value is compared [1]. Source: judgement."""

SPIKE = 0.8
"""Distance from it, per range of the column, from which on a value is a spike [1]. Source:
judgement.
"""

SPIKE_OF_EFFORT = 5.0
"""The same for a force or a current, which may jump by itself [1]. Source: judgement."""

FEWEST_SPIKES = 2
"""Number of spikes of a column that are named [1]. Source: judgement."""

STUCK = 0.15
"""Share of a log over which a reference must have one value to be stuck [1]. Source: judgement."""

STILL_MOVES = 0.3
"""Share of its range that each drive must move meanwhile [1]. Source: judgement."""


def left_columns(
    raw: Sequence[RawLog], columns: Sequence[ColumnRole], lacking: Mapping[str, str]
) -> list[str]:
    """Return sentences on columns that hold no numbers, and on those that some logs lack.

    Raises:
        RigError: a log lacks the position or the effort of a drive.
    """
    notes = []
    texts = dict.fromkeys(name for log in raw for name in log.texts)
    if texts:
        notes.append(f"these columns hold text and are left out: {', '.join(texts)}")
    for column in columns:
        if column.header not in lacking or column.role in ("other", "command"):
            continue
        where = lacking[column.header]
        if column.role != "angle":
            raise RigError(
                f"'{column.header}' has no values in {where}; give it there, or leave it out by "
                "--ignore"
            )
        notes.append(f"{column.header} has no values in {where}: nothing is learned of it there")
    return notes


def mistakes(
    raw: Sequence[RawLog], columns: Sequence[ColumnRole], data: Sequence[MotionData]
) -> list[str]:
    """Return a sentence for each mistake because of which no rig can be written."""
    drives = [column.header for column in columns if column.role == "position"]
    joints = [column.header for column in columns if column.role == "angle"]
    sentences = [
        *_times(raw, columns),
        *_spikes(raw, columns),
        *_constant(raw, [*drives, *joints]),
        *_stuck(raw, drives, joints),
    ]
    if not sentences:
        sentences = list(_wrapped(columns))
    if sentences:
        return sentences
    odd = odd_log(data, drives, joints)
    return [] if odd is None or not odd.stops else [odd.text]


def remarks(
    raw: Sequence[RawLog], columns: Sequence[ColumnRole], data: Sequence[MotionData]
) -> list[str]:
    """Return a sentence for each thing in the logs that a rig can be written in spite of."""
    lines = list(_gaps(raw, columns))
    drives = [column.header for column in columns if column.role == "position"]
    joints = [column.header for column in columns if column.role == "angle"]
    odd = odd_log(data, drives, joints)
    if odd is not None:
        lines.append(odd.text)
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
            values = values[np.isfinite(values)]
            if len(values) and np.ptp(values) == 0.0:
                yield f"{log.source}: {header} never changes there; leave this log out"


def _spikes(raw: Sequence[RawLog], columns: Sequence[ColumnRole]) -> Iterator[str]:
    used = [column for column in columns if column.role in ("position", "effort", "angle")]
    for log in raw:
        for column in used:
            header = column.header
            values = log.columns[header]
            values = values[np.isfinite(values)]
            if len(values) < 2 * SPIKE_WINDOW:
                continue
            width = float(np.ptp(np.quantile(values, [0.02, 0.98])))
            away = np.abs(values - medfilt(values, SPIKE_WINDOW))
            inner = away[SPIKE_WINDOW:-SPIKE_WINDOW]
            limit = SPIKE_OF_EFFORT if column.role == "effort" else SPIKE
            wild = values[SPIKE_WINDOW:-SPIKE_WINDOW][inner > limit * max(width, 1e-300)]
            count = len(wild)
            wraps = column.values.turn is not None and np.ptp(wild) > 0.0 if count else False
            if count >= FEWEST_SPIKES and not wraps:
                yield (
                    f"{log.source}: {header} jumps away and back {count} times, to values such as "
                    f"{values[SPIKE_WINDOW:-SPIKE_WINDOW][np.argmax(inner)]:g}: leave these cells "
                    "empty"
                )


def _stuck(raw: Sequence[RawLog], drives: Sequence[str], joints: Sequence[str]) -> Iterator[str]:
    for log in raw:
        ways = {name: float(np.ptp(log.columns[name])) for name in drives}
        for header in joints:
            values = log.columns[header]
            there = np.flatnonzero(np.isfinite(values))
            if len(there) < 2:
                continue
            ends = np.concatenate([[0], np.flatnonzero(np.diff(values[there])) + 1, [len(there)]])
            longest = int(np.argmax(np.diff(ends)))
            rows = slice(there[ends[longest]], there[ends[longest + 1] - 1] + 1)
            share = (rows.stop - rows.start) / log.rows
            moved = [
                name
                for name in drives
                if np.ptp(log.columns[name][rows]) > STILL_MOVES * max(ways[name], 1e-300)
            ]
            if share > STUCK and len(moved) == len(drives):
                yield (
                    f"{log.source}: {header} stays at {values[rows.start]:g} for "
                    f"{100 * share:.0f} % of the log while all drives move: is it stuck? Leave "
                    "these cells empty"
                )


def _gaps(raw: Sequence[RawLog], columns: Sequence[ColumnRole]) -> Iterator[str]:
    name = _stamp(columns)
    for log in raw:
        steps = np.diff(log.columns[name])
        count = int(np.sum(steps > GAP * np.median(steps)))
        if count:
            yield f"{log.source}: rows are missing at {count} places, where {name} jumps"
