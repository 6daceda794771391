"""The readings of the sensors in a simulated motion: without errors (`Readings`), and with them, as
one function (`reading_function`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.expressions import Vector
from distal.model import Mechanism, Moment
from distal.rig import Rig, Sensor, travel_of
from distal.sensor_errors import SENSOR, SensorErrors, reading


def moment_of(plant: Mechanism, y: Vector) -> Moment:
    """Return the motion at one moment from an output y, (n_y,), of a plant's kernel
    (`plant_function`).
    """
    n = plant.n_bodies
    return Moment(
        plant, y[:n], y[n : 2 * n], y[2 * n : 2 * n + plant.n_tendons], y[2 * n + plant.n_tendons :]
    )


class Readings:
    """The readings without errors of some of a plant's sensors, by default of all."""

    def __init__(self, plant: Mechanism, sensors: Sequence[Sensor] | None = None) -> None:
        y = ca.SX.sym("y", 3 * plant.n_bodies + plant.n_tendons)
        p = plant.parameters
        moment = moment_of(plant, y)
        readings = [
            ca.SX(moment.read(sensor))
            for sensor in (plant.rig.sensors if sensors is None else sensors)
        ]
        # most sensors read one of the plant's outputs: those are taken as they are
        positions = {y[i].element_hash(): i for i in range(y.numel())}
        self._columns = np.array(
            [positions.get(reading.element_hash(), -1) for reading in readings], dtype=np.intp
        )
        self._computed = np.flatnonzero(self._columns < 0)
        computed = ca.vertcat(*(readings[k] for k in self._computed))
        self._function = ca.Function(
            "readings", [y], [ca.substitute(computed, p.symbols, ca.DM(p.values))]
        )

    def at(self, y: Floats) -> Floats:
        """Return the readings [SI], (k, n_sensors), at outputs y, (k, n_y), of the plant's
        kernel.
        """
        readings: Floats = y[:, self._columns]
        if len(self._computed):
            readings[:, self._computed] = np.array(self._function(y.T)).T
        return readings


ErrorsByRate: TypeAlias = dict[float, tuple[list[int], SensorErrors]]
"""Rate of sensors [Hz] → the indices of the sensors with this rate, and their errors."""


def errors_by_rate(rig: Rig, seed: int) -> ErrorsByRate:
    """Return the errors of a rig's sensors in the run of a seed."""
    sensors = rig.sensors
    errors = ErrorsByRate()
    rngs = np.random.default_rng(seed).spawn(len(sensors))
    for rate in sorted({sensor.rate for sensor in sensors}):
        at = [k for k, sensor in enumerate(sensors) if sensor.rate == rate]
        ranges = [travel_of(sensors[k], rig) for k in at]
        errors[rate] = at, SensorErrors([sensors[k] for k in at], ranges, [rngs[k] for k in at])
    return errors


def reading_function(plant: Mechanism) -> ca.Function:
    """Return the function (y, numbers, draws) → what the sensors read, without their delays.

    The output y is that of the plant's kernel, the numbers are a column of `SENSOR` for each
    sensor, and the draws are standard normal.
    """
    sensors = plant.rig.sensors
    y = ca.SX.sym("y", 3 * plant.n_bodies + plant.n_tendons)
    parameters = ca.SX.sym("numbers", SENSOR.size, len(sensors))
    draws = ca.SX.sym("draws", len(sensors))
    moment = moment_of(plant, y)
    readings = [
        reading(moment.read(s), SENSOR.parts(parameters[:, k]), draws[k])
        for k, s in enumerate(sensors)
    ]
    read = ca.substitute(
        ca.vertcat(*readings), plant.parameters.symbols, ca.DM(plant.parameters.values)
    )
    return ca.Function("reading", [y, parameters, draws], [ca.densify(read)])
