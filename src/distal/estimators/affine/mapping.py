"""The numbers of `[affine]` at work: design, prediction and variance of a whole log, and the frame of readings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from distal.estimators.affine.readings import NAME, Readings, speeds
from distal.estimators.affine.regression import independent
from distal.estimators.channels import channels_of
from distal.rig import Affine, AffineJoint, Rig
from distal.sensors import variance

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def noise_of(rig: Rig) -> Floats:
    """Return the standard deviation of each channel's random error [SI], (m,).

    Args:
        rig: the description.
    """
    channels = channels_of(rig, NAME)
    sensors = (*channels.positions, *channels.tensions, *channels.forces)
    return np.sqrt([variance(sensor) for sensor in sensors])


def frame(readings: Sequence[Readings], rig: Rig, bands: Sequence[float]) -> tuple[Affine, Bools]:
    """Return an `Affine` with centre, scale, range and distance of some logs, and which channels tell something.

    Its maps are zero, for the caller to fill in.

    Args:
        readings: of the logs.
        rig: the description.
        bands: half-width of the play of each position sensor [SI].
    """
    names, noise = channels_of(rig, NAME).names, noise_of(rig)
    values = np.vstack([one.values for one in readings])
    centre, spread = values.mean(axis=0), values.std(axis=0)
    kept = independent(values - centre, noise)
    scale = np.where(spread > 0.0, spread, 1.0)
    z = (values - centre)[:, kept] / scale[kept]
    distance = np.zeros((len(names), len(names)))
    if kept.any():
        distance[np.ix_(kept, kept)] = np.linalg.pinv(z.T @ z / len(z))
    reach = float(np.sqrt(np.max(np.sum(z @ distance[np.ix_(kept, kept)] * z, axis=1), initial=1.0)))
    size = 1 + len(names) + len(bands)
    joints = [
        AffineJoint(joint=j.name, coefficients=(0.0,) * size, covariance=((0.0,) * size,) * size, std=1.0)
        for j in rig.joints
    ]
    dropped = []
    for name, column, own, sigma in zip(names, spread, kept, noise):
        if not own:
            why = "was constant" if column <= 1.5 * sigma else "follows from the others"
            dropped.append(f"{name}: {why}")
    made = Affine(
        channels=names,
        centre=_row(centre),
        scale=_row(scale),
        low=_row(values.min(axis=0)),
        high=_row(values.max(axis=0)),
        rate=_row(speeds(readings)),
        dead_band=_row(np.asarray(bands)),
        distance=rows(distance),
        reach=reach,
        correlation_time=readings[0].interval,
        logs=len(readings),
        dropped=tuple(dropped),
        joints=tuple(joints),
    )
    return made, kept


def design(affine: Affine, readings: Readings) -> Floats:
    """Return the columns (1, scaled readings, directions), (k, 1 + m + n_positions).

    Args:
        affine: with centre and scale.
        readings: of a log.
    """
    scaled = (readings.values - np.asarray(affine.centre)) / np.asarray(affine.scale)
    return np.column_stack([np.ones(len(scaled)), scaled, readings.directions])


def half_ranges(affine: Affine, noise: Floats) -> Floats:
    """Return half of each channel's learned range [SI], at least three standard deviations of its noise, (m,).

    Args:
        affine: with the range.
        noise: standard deviation of each channel's random error [SI], (m,).
    """
    halves: Floats = np.maximum(
        0.5 * (np.asarray(affine.high) - np.asarray(affine.low)), np.maximum(3.0 * noise, 1e-12)
    )
    return halves


def outside(affine: Affine, values: Floats, noise: Floats) -> Floats:
    """Return how far readings are outside the learned range, 0 within; 1 is half a range beyond its end, (k,).

    The larger of a single reading's excess and that of the Mahalanobis distance, which sees combinations that never came.

    Args:
        affine: with the range.
        values: readings, (k, m).
        noise: standard deviation of each channel's random error [SI], (m,).
    """
    beyond = np.maximum(np.asarray(affine.low) - values, values - np.asarray(affine.high)) / half_ranges(affine, noise)
    z = (values - np.asarray(affine.centre)) / np.asarray(affine.scale)
    far = np.sqrt(np.maximum(np.sum(z @ np.asarray(affine.distance) * z, axis=1), 0.0)) / affine.reach - 1.0
    excess: Floats = np.maximum(0.0, np.maximum(beyond.max(axis=1), far))
    return excess


def predicted(affine: Affine, readings: Readings, noise: Floats, joint: int = 0) -> tuple[Floats, Floats]:
    """Return angle and standard deviation of a joint over a log, as the estimator gives them.

    σ² = φᵀ C φ + s² (1 + d²), φ the columns, C the coefficients' covariance, d from `outside`.

    Args:
        affine: the map.
        readings: of the log.
        noise: standard deviation of each channel's random error [SI], (m,).
        joint: its index.
    """
    columns, own = design(affine, readings), affine.joints[joint]
    leverage = np.sum(columns @ np.asarray(own.covariance) * columns, axis=1)
    far = outside(affine, readings.values, noise)
    return columns @ np.asarray(own.coefficients), np.sqrt(leverage + own.std**2 * (1.0 + far**2))


def rows(matrix: Floats) -> tuple[tuple[float, ...], ...]:
    """Return a matrix as tuples of plain numbers.

    Args:
        matrix: to convert.
    """
    return tuple(_row(row) for row in matrix)


def _row(values: Floats) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
