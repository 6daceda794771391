"""The columns of some logs as drives, efforts and joints in SI, at a common lower rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from distal.arrays import Bools, Floats
from distal.from_logs.column_units import ColumnRole, in_si
from distal.from_logs.least_squares import speed_of
from distal.from_logs.raw_log import RawLog
from distal.regression import played
from distal.rig.hand_tables.described import ASSUMED
from distal.units import unit_factor

MOST_SAMPLES = 1500
"""Samples of a log that are used: more say nothing new of sizes. Source: judgement."""

TURNED = 0.01
"""A drive has a direction after this share of its range. Source: judgement."""

SLOW = 0.03
"""Speed of a body, per its RMS speed, below which friction may hold any force. Source: judgement
(docs/results/from-logs.md).
"""


SURE = 0.99
"""Magnitude of a direction from which on it is clear [1]. Source: judgement."""


def factor_of_column(column: ColumnRole) -> float:
    """Return the factor of a column to SI; counts become radians by an assumed or a seen turn."""
    if column.si == "count":
        return 2.0 * pi / counts_of(column)
    return unit_factor(column.unit, column.si) if column.unit else 1.0


def counts_of(column: ColumnRole) -> float:
    """Return the counts of an encoder in one turn."""
    return column.values.turn or ASSUMED.counts


@dataclass(frozen=True)
class MotionData:
    """One log.

    Args:
        source: its name.
        time: [s], (n_samples,).
        positions: of the drives [m or rad], (n_samples, n_drives).
        directions: which way each drive last moved, −1 to 1, (n_samples, n_drives).
        efforts: of the drives [N, N m or A], NaN without a sensor, (n_samples, n_drives).
        angles: of the joints by their references [rad], NaN where not known, (n_samples, n_joints).
    """

    source: str
    time: Floats
    positions: Floats
    directions: Floats
    efforts: Floats
    angles: Floats

    def moves(self, drive: int) -> Bools:
        """Return when a drive moves, so that friction acts against its direction, (n_samples,)."""
        speed = np.abs(speed_of(self.positions[:, drive], self.time))
        fast = speed > SLOW * np.sqrt(np.mean(speed**2))
        moving: Bools = fast & (np.abs(self.directions[:, drive]) > SURE)
        return moving


def motion_data(log: RawLog, columns: Sequence[ColumnRole]) -> MotionData:
    """Return a log as drives, efforts and joints, missing positions held."""
    stamp = next(column for column in columns if column.role == "time")
    drives = [column for column in columns if column.role == "position"]
    joints = [column for column in columns if column.role == "angle"]
    efforts = {column.part: column for column in columns if column.role == "effort"}
    stride = max(1, log.rows // MOST_SAMPLES)
    time = log.columns[stamp.header] * factor_of_column(stamp)

    def smooth(column: ColumnRole | None) -> Floats:
        if column is None:
            return np.full(len(time[::stride]), np.nan)
        values = in_si(column, log.columns[column.header], factor_of_column(column))
        present = np.flatnonzero(np.isfinite(values))
        if len(present) < 2:
            return np.full(len(time[::stride]), np.nan)
        rows = np.arange(len(values))
        bridged = np.interp(rows, present, values[present])
        if column.role == "angle":
            # a slow camera is bridged between its samples, also where one is lost, a gap is not
            nearest = np.abs(
                rows - present[np.searchsorted(present, rows).clip(0, len(present) - 1)]
            )
            before = present[(np.searchsorted(present, rows, side="right") - 1).clip(0)]
            nearest = np.minimum(nearest, np.abs(rows - before))
            bridged[nearest > np.median(np.diff(present))] = np.nan
        values = bridged
        kernel = np.ones(stride) / stride
        padded = np.pad(values, (stride // 2, stride - 1 - stride // 2), mode="edge")
        return np.asarray(np.convolve(padded, kernel, mode="valid")[::stride])

    positions = np.column_stack([smooth(column) for column in drives])
    widths = [max(TURNED * float(np.ptp(values)), 1e-12) for values in positions.T]
    directions = np.column_stack(
        [(values - played(values, half)) / half for values, half in zip(positions.T, widths)]
    )
    return MotionData(
        log.source,
        time[::stride] - time[0],
        positions,
        directions,
        np.column_stack([smooth(efforts.get(column.part)) for column in drives]),
        np.column_stack([smooth(column) for column in joints])
        if joints
        else np.empty((len(positions), 0)),
    )
