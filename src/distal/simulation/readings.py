"""The readings of the sensors in a simulated motion, at the sensors' rates."""

from __future__ import annotations

from math import ceil

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.expressions import Vector
from distal.model import Mechanism, Moment
from distal.rig import Rig, travel_of
from distal.sensor_errors import SensorErrors


def moment_of(plant: Mechanism, y: Vector) -> Moment:
    """Return the motion at one moment from an output y, (n_y,), of a plant's kernel
    (`plant_function`).
    """
    n = plant.n_bodies
    return Moment(
        plant, y[:n], y[n : 2 * n], y[2 * n : 2 * n + plant.n_tendons], y[2 * n + plant.n_tendons :]
    )


class Sampler:
    """What a plant's sensors read in the run of a seed, each at its own rate, along a motion that
    may come in pieces.
    """

    def __init__(self, plant: Mechanism, seed: int) -> None:
        self._rig = rig = plant.rig
        y = ca.SX.sym("y", 3 * plant.n_bodies + plant.n_tendons)
        p = plant.parameters
        moment = moment_of(plant, y)
        readings = [ca.SX(moment.read(sensor)) for sensor in rig.sensors]
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
        rngs = np.random.default_rng(seed).spawn(len(rig.sensors))
        self._errors = [
            SensorErrors([sensor], [travel_of(sensor, rig)], [rng])
            for sensor, rng in zip(rig.sensors, rngs)
        ]

    def read(self, y: Floats, grid: Floats, stamps: Floats) -> Floats:
        """Return what the sensors read at the next `stamps`, (k, n_sensors) [SI], NaN for a sensor
        that is not due.

        Args:
            y: outputs of the plant's kernel, (n, n_y).
            grid: times of these outputs [s], (n,); between them the motion is a straight line.
            stamps: rising, of `stamps_of` [s], (k,).
        """
        read = np.full((len(stamps), len(self._errors)), np.nan)
        true: Floats = y[:, self._columns]
        if len(self._computed):
            true[:, self._computed] = np.array(self._function(y.T)).T
        for k, (sensor, errors) in enumerate(zip(self._rig.sensors, self._errors)):
            times = np.round(stamps * sensor.rate) / sensor.rate
            due = np.flatnonzero(np.round(times, 9) == stamps)
            if len(due):
                at = np.interp(times[due] - sensor.delay, grid, true[:, k])
                read[due, k] = errors.read(at[:, None])[:, 0]
        return read


def stamps_of(rig: Rig, begin: float, end: float) -> Floats:
    """Return the stamps from `begin` up to `end`, which is excluded, at which at least one of a
    rig's sensors is sampled [s], (k,). They are rounded, so that those of several rates meet.
    """
    rates = {sensor.rate for sensor in rig.sensors} or {100.0}
    each = (np.arange(ceil(begin * r - 1e-6), ceil(end * r - 1e-6)) / r for r in rates)
    return np.unique(np.round(np.concatenate([*each]), 9))
