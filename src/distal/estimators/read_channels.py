"""The sensors that an estimator reads, by their role, the time after which a silent one counts as
dead, and gaps between samples: several predictions bridge a long interval, so that sub-steps stay
short.

A row of a kernel's input is x = (dt, values, mask), see `distal.kernels.layout`. A row that bridges
a gap has no sample of its own: nothing is read in it, and displacements are interpolated along a
straight line to the reading that ends the gap.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.errors import DistalWarning, EstimationError
from distal.kernels.layout import MISSING, bridge
from distal.rig import Rig, Role, Sensor, measurand_of
from distal.sensor_errors import variance


@dataclass(frozen=True)
class Channels:
    """The sensors of a rig by role.

    Args:
        positions: sensors of drives' positions.
        forces: sensors of drives' forces or torques.
        tensions: sensors of tendons' tensions.
        angles: sensors of joints' angles, only while a reference is known (homing, fitting).
        interval: nominal, that of the fastest sensor [s], angles left out.
    """

    positions: tuple[Sensor, ...]
    forces: tuple[Sensor, ...]
    tensions: tuple[Sensor, ...]
    angles: tuple[Sensor, ...]
    interval: float

    @property
    def proximal(self) -> tuple[Sensor, ...]:
        """The sensors at the proximal end, from which maps learn: positions, tensions, forces."""
        return (*self.positions, *self.tensions, *self.forces)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sensors in the order in which estimators read them: positions, tensions,
        forces, angles.
        """
        return tuple(sensor.name for sensor in (*self.proximal, *self.angles))

    def of_message(self, position: int) -> list[int]:
        """Return the indices of a position and of what its drive's motor reads with it."""
        drive = self.positions[position].of
        at_motors = [*self.positions, *self.forces]
        return [k for k, s in enumerate(self.proximal) if s in at_motors and s.of == drive]

    @property
    def compared(self) -> tuple[Sensor, ...]:
        """The sensors whose values `adaptive` compares with predictions: forces, tensions and
        angles.
        """
        return (*self.forces, *self.tensions, *self.angles)


def channels_of(rig: Rig, name: str, references: Sequence[Sensor] = ()) -> Channels:
    """Return the sensors of a rig that an estimator reads.

    Args:
        name: of the estimator, for messages.
        references: sensors of joints' angles that are read too, while they are known.

    Raises:
        EstimationError: no drive's position is measured, two sensors measure the same, or a sensor
            has zero noise.
    """
    positions, forces, tensions = (
        tuple(sensor for sensor in rig.sensors if measurand_of(sensor).role is role)
        for role in (Role.POSITION, Role.EFFORT, Role.TENSION)
    )
    if not positions:
        raise EstimationError(
            f"{name}: the rig '{rig.name}' has no sensor that measures the position of a drive; "
            "add one to [[sensors]]"
        )
    rates = [sensor.rate for sensor in (*positions, *forces, *tensions)]
    interval = 1.0 / max(rates)
    channels = Channels(positions, forces, tensions, tuple(references), interval)
    for sensors in (channels.positions, channels.forces, channels.tensions, channels.angles):
        seen: dict[str, str] = {}
        for sensor in sensors:
            if sensor.of in seen:
                raise EstimationError(
                    f"{name}: sensors '{seen[sensor.of]}' and '{sensor.name}' both measure the "
                    f"{sensor.measures} "
                    f"of '{sensor.of}'; one is allowed"
                )
            seen[sensor.of] = sensor.name
            if sensor.delay > 0.0 and sensors is not channels.angles:
                warnings.warn(
                    f"{name}: sensor '{sensor.name}' is late by {sensor.delay:g} s; estimators "
                    "take its values as of "
                    "their stamps, so shift the column of the log by that",
                    DistalWarning,
                    stacklevel=2,
                )
    for sensor in (*channels.proximal, *channels.angles):
        if variance(sensor) == 0.0:
            raise EstimationError(
                f"{name}: sensor '{sensor.name}' has zero noise (and resolution); an estimator "
                "needs its standard "
                f"deviation, e.g. --set sensors.{sensor.name}.noise=…"
            )
    return channels


def sensor_for(sensors: tuple[Sensor, ...], part: str) -> Sensor | None:
    """Return the sensor of the drive or tendon called `part`, or None."""
    return next((sensor for sensor in sensors if sensor.of == part), None)


UNKNOWN_POSITION = {"slider": 0.01, "capstan": 1.0}
"""Kind of drive → standard deviation of its position where nothing measures it and no stop bounds
it [m, rad]. Source: judgement.
"""


DEAD = 0.5
"""Shortest time without a value after which a sensor is dead [s]: it may not come back. Source:
judgement.
"""

DEAD_INTERVALS = 5.0
"""Smallest number of its own intervals without a value after which a sensor is dead [1]. Source:
judgement.
"""


def dead_after(sensor: Sensor) -> float:
    """Return the time without a value after which a sensor is dead [s]: `DEAD`, or `DEAD_INTERVALS`
    of its own intervals where that is longer.
    """
    return max(DEAD, DEAD_INTERVALS / sensor.rate)


MOST_BRIDGES = 100_000
"""Largest number of predictions that bridge one gap [1]. Source: judgement."""

SPLIT = 1.25
"""An interval longer than this times the nominal one is bridged by several predictions [1]. Source:
judgement.
"""

STAMP_ROUNDING = 1e-9
"""Share of an interval by which a stamp may be off without another prediction [1]. Source: rounding
(of stamps).
"""


def first_values(samples: Floats) -> Floats:
    """Return the first finite value of each channel, (n_channels,), NaN for a channel that has
    none.
    """
    firsts: Floats = samples[np.isfinite(samples).argmax(axis=0), np.arange(samples.shape[1])]
    return firsts


def predictions(dt: float, interval: float) -> int:
    """Return the number of predictions for an interval `dt` [s] where samples are nominally an
    `interval` [s] apart.

    It is at most twice `MOST_BRIDGES`, also for an infinite `dt`.
    """
    parts = dt / (SPLIT * interval) - STAMP_ROUNDING
    return (
        max(1, ceil(parts)) if parts < 2 * MOST_BRIDGES else 2 * MOST_BRIDGES
    )  # dt may be infinite


def fill(
    values: Floats,
    mask: Floats,
    sample: Floats,
    is_finite: Bools,
    rows_after: int = 0,
    bridged: int = 0,
) -> None:
    """Write `values` and `mask` of one input row, (n_channels,) each, from the `sample` that ends
    the interval.

    Args:
        values: of the row, changed in place.
        mask: of the row, changed in place.
        sample: value where `is_finite`, else 0.
        is_finite: where the sample has a value.
        rows_after: number of rows that follow in the same interval; 0 for the sample's own row.
        bridged: number of leading channels that are interpolated along a straight line.
    """
    if rows_after == 0:
        values[:] = sample
        mask[:] = is_finite
        return
    values[:] = 0.0
    mask[:] = MISSING
    values[:bridged] = sample[:bridged]
    np.multiply(is_finite[:bridged], bridge(rows_after + 1), out=mask[:bridged])


def rows_with_gaps(
    name: str, steps: Floats, samples: Floats, interval: float, bridged: int
) -> tuple[Floats, NDArray[np.intp]]:
    """Return a kernel's input rows (dt, values, mask) for a log, and the index of each sample's own
    row among them.

    Args:
        name: of the estimator, for messages.
        steps: intervals before the samples [s], (k,).
        samples: values of the channels, NaN where missing, (k, n_channels).
        interval: nominal interval [s].
        bridged: number of leading channels that are interpolated along a straight line over a gap.

    Raises:
        EstimationError: too many predictions would be needed.
    """
    width = samples.shape[1]
    is_finite = np.isfinite(samples)
    filled = np.where(is_finite, samples, 0.0)
    if (
        len(steps) and predictions(float(steps.max()), interval) == 1
    ):  # no gaps, as most logs: a row for each sample
        return np.column_stack([steps, filled, is_finite]), np.arange(len(steps))
    parts = np.maximum(1.0, np.ceil(steps / (SPLIT * interval) - STAMP_ROUNDING))
    if parts.max(initial=1.0) > MOST_BRIDGES:
        raise EstimationError(
            f"{name}: a gap of {steps.max():g} s is too long to bridge "
            f"(at most {MOST_BRIDGES * SPLIT * interval:g} s); split the log there"
        )
    if parts.sum() > 4 * MOST_BRIDGES + 4 * len(steps):
        raise EstimationError(
            f"{name}: the stamps are {np.median(steps):g} s apart, the rig's sensors give a value "
            "every "
            f"{interval:g} s: {parts.sum():.3g} predictions would be needed; set the sensors' "
            "rate to the log's"
        )
    counts = parts.astype(np.int64)
    last = np.cumsum(counts) - 1
    rows = np.zeros((int(counts.sum()), 1 + 2 * width))
    rows[:, 0] = np.repeat(steps / parts, counts)
    values = rows[:, 1 : 1 + width]
    masks = rows[:, 1 + width :]
    values[last] = filled
    masks[last] = is_finite
    for i in np.flatnonzero(counts > 1):
        for after in range(1, int(counts[i])):
            row = last[i] - after
            fill(values[row], masks[row], filled[i], is_finite[i], after, bridged)
    return rows, last
