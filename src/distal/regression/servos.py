"""How servos give way, by logs that have the goals that were sent.

A servo of stiffness K and dead band δ, a lag T behind, is at s where  u − s = F/K + δ d + T ds/dt,
with u its goal, F its force and d in [−1, 1] the way in which it last moved. Least squares over all
logs gives 1/K, δ and T, each drive by itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.arrays import Floats
from distal.logs import Log
from distal.rig import Capstan, Rig, Slider

TURNS = 3.0
"""A drive has turned over after so many standard deviations of its sensor's noise."""

TRIMMED = 3.0
"""Samples that are further off than so many robust standard deviations are left out, twice."""

CLEARLY = 3.0
"""A number is written where it is so many standard errors above zero."""

INDEPENDENT = 0.25
"""Residuals are correlated over so long [s]."""

FEWEST = 100
"""Samples of a drive that are needed."""


def servos_of(logs: Sequence[Log], rig: Rig) -> dict[str, object]:
    """Return path by names → value of the servos whose goals are in the logs: stiffness [N m/rad,
    N/m] and dead band [rad, m].
    """
    servos: dict[str, object] = {}
    for drive in rig.drives:
        parts = [part for log in logs if (part := _rows(log, rig, drive)) is not None]
        if not parts:
            continue
        matrix, left = (np.concatenate(each) for each in zip(*((m, y) for m, y, _ in parts)))
        count = sum(seconds for _, _, seconds in parts) / INDEPENDENT
        if len(left) < FEWEST:
            continue
        values, errors = _trimmed(matrix, left, count)
        path = f"drives.{drive.name}.servo"
        if values[0] > CLEARLY * errors[0]:
            servos[f"{path}.stiffness"] = float(f"{1.0 / values[0]:.6g}")
        if values[1] > CLEARLY * errors[1]:
            servos[f"{path}.dead_band"] = float(f"{values[1]:.6g}")
    return servos


def _rows(log: Log, rig: Rig, drive: Capstan | Slider) -> tuple[Floats, Floats, float] | None:
    """Return the columns F, d and ds/dt of a drive, (k, 3), what its servo leaves, (k,), and for
    how long [s]; None where the log lacks one of them.
    """
    sensors = {s.measures: s for s in rig.sensors if s.of == drive.name}
    if drive.name not in log.goals or not {"position", "force"} <= set(sensors):
        return None
    position, force = (log.channels.get(sensors[kind].name) for kind in ("position", "force"))
    if position is None or force is None:
        return None
    goal = log.goals[drive.name]
    way = _way(position, TURNS * sensors["position"].noise)
    matrix = np.column_stack([force, way, np.gradient(position, log.time)])
    left = goal - position
    known = np.isfinite(matrix).all(axis=1) & np.isfinite(left)
    return matrix[known], left[known], float(np.ptp(log.time)) * float(known.mean())


def _way(positions: Floats, half: float) -> Floats:
    """Return which way a drive last moved, −1 to 1, by a play of some half-width."""
    ways = np.zeros(len(positions))
    held = np.nan
    half = max(half, 1e-9)
    for k, position in enumerate(positions.tolist()):
        held = position if np.isnan(held) else min(max(held, position - half), position + half)
        ways[k] = (position - held) / half
    return ways


def _trimmed(matrix: Floats, left: Floats, count: float) -> tuple[Floats, Floats]:
    """Return least squares without outliers, and standard errors for `count` independent
    samples.
    """
    kept = np.ones(len(left), dtype=bool)
    values = np.zeros(matrix.shape[1])
    for _ in range(3):
        values[:] = np.linalg.lstsq(matrix[kept], left[kept], rcond=None)[0]
        rest = left - matrix @ values
        spread = 1.48 * float(np.median(np.abs(rest[kept]))) + 1e-12
        kept = np.abs(rest) <= TRIMMED * spread
    information = matrix[kept].T @ matrix[kept] * min(count / len(left), 1.0)
    inverse = np.linalg.pinv(information)
    return values, spread * np.sqrt(np.maximum(np.diagonal(inverse), 0.0))
