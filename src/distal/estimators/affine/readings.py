"""What a log says to least squares: held readings, directions of motion, true angles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distal.errors import EstimationError
from distal.estimators.channels import channels_of
from distal.logs import Log, true_angles
from distal.rig import Rig
from distal.sensors import variance

Floats = NDArray[np.float64]

NAME = "affine"

DEAD_BAND = 6.0
"""Half-width of the play that finds a direction, in standard deviations of the position sensor."""

SPEED_OVER = 0.1
"""Speeds of readings are differences over so long [s], so that noise counts little."""


@dataclass(frozen=True)
class Readings:
    """The samples of a log that least squares uses: every sensor has had a value.

    Args:
        source: name of the log.
        time: since the log's first sample [s], (k,).
        values: what the channels read, a missing value held, (k, m).
        directions: of the position sensors, between −1 and 1, (k, n_positions).
        angles: true ones [rad], NaN where not known, (k, n_joints).
        interval: between samples [s].
    """

    source: str
    time: Floats
    values: Floats
    directions: Floats
    angles: Floats
    interval: float

    def part(self, rows: NDArray[np.bool_]) -> Readings:
        """Return some of the samples.

        Args:
            rows: which, (k,).
        """
        return Readings(
            self.source, self.time[rows], self.values[rows], self.directions[rows], self.angles[rows], self.interval
        )


def dead_bands(rig: Rig) -> tuple[float, ...]:
    """Return the half-width of the play of each position sensor, `DEAD_BAND` standard deviations of its random error.

    Args:
        rig: the description.
    """
    return tuple(DEAD_BAND * float(np.sqrt(variance(sensor))) for sensor in channels_of(rig, NAME).positions)


def readings_of(log: Log, rig: Rig, bands: Sequence[float]) -> Readings:
    """Return what a log says to least squares.

    Args:
        log: with the truth of the joints.
        rig: the description.
        bands: half-width of the play of each position sensor [SI].

    Raises:
        EstimationError: a sensor is not in the log or has no value.
    """
    names = channels_of(rig, NAME).names
    for name in names:
        if name not in log.channels or not np.isfinite(log.channels[name]).any():
            raise EstimationError(f"{log.source}: affine needs the sensor '{name}', which has no value in this log")
    values = np.column_stack([_held(log.channels[name]) for name in names])
    known = true_angles(log, [joint.name for joint in rig.joints])
    angles = np.full((len(log), len(rig.joints)), np.nan) if known is None else known
    started = np.isfinite(values).all(axis=1)
    values = values[started]
    turns = [direction(values[:, i], band) for i, band in enumerate(bands)]
    directions = np.column_stack(turns) if turns else np.zeros((len(values), 0))
    interval = float(np.median(np.diff(log.time))) if len(log) > 1 else 1.0
    return Readings(log.source, (log.time - log.time[0])[started], values, directions, angles[started], interval)


def _held(values: Floats) -> Floats:
    """Return the values, each missing one replaced by the last before it."""
    there = np.isfinite(values)
    last = np.maximum.accumulate(np.where(there, np.arange(len(values)), -1))
    return np.where(last >= 0, values[np.maximum(last, 0)], np.nan)


def direction(values: Floats, band: float) -> Floats:
    """Return the direction of the last motion, between −1 and 1: d = (x − z)/w with the play z of half-width w.

    z⁺ = min(max(z, x − w), x + w): the play operator (Visintin, 1994, ch. III). Noise below w does not turn it over, a
    rest keeps it, and it does not depend on the rate. It begins at 0.

    Args:
        values: x, (k,).
        band: w.
    """
    play, directions = float(values[0]), np.empty(len(values))
    for k, value in enumerate(values):
        play = min(max(play, value - band), value + band)
        directions[k] = (value - play) / band
    return directions


def speeds(readings: Sequence[Readings]) -> Floats:
    """Return the RMS speed of each channel over some logs [SI/s], (m,).

    Args:
        readings: of the logs.
    """
    squares, count = np.zeros(readings[0].values.shape[1]), 0
    for one in readings:
        lag = max(1, round(SPEED_OVER / one.interval))
        if len(one.time) > lag:
            changes = (one.values[lag:] - one.values[:-lag]) / (one.time[lag:] - one.time[:-lag])[:, None]
            squares, count = squares + np.sum(changes**2, axis=0), count + len(changes)
    return np.sqrt(squares / max(count, 1))
