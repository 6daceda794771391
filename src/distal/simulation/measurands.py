"""What there is to measure of a simulated motion, for each measurand (see `distal.rig.measurands`)."""

from __future__ import annotations

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.kernels import Layout
from distal.model import Mechanism
from distal.rig import Sensor
from distal.simulation.plant import Motion


def columns_of(plant: Mechanism, sensor: Sensor) -> tuple[int, int]:
    """Return where in the plant's output (`plant_function`) stands what a sensor measures, and its rate; −1: none."""
    rig, n = plant.rig, plant.n_bodies
    if sensor.measures == "tension":
        return 2 * n + [tendon.name for tendon in rig.tendons].index(sensor.of), -1
    of_joint = sensor.measures in ("angle", "torque")
    names = [part.name for part in (rig.joints if of_joint else rig.drives)]
    body = names.index(sensor.of) + (0 if of_joint else plant.n_joints)
    if sensor.measures in ("torque", "force"):
        return 2 * n + plant.n_tendons + body, -1
    return body, n + body


def true_values(motion: Motion, sensor: Sensor) -> Floats:
    """Return what there is to measure over a motion, (k,)."""
    own, rate = columns_of(motion.plant, sensor)
    # a command is ahead of where the drive is
    return motion.y[:, own] + sensor.lag * motion.y[:, rate] if sensor.lag > 0.0 else motion.y[:, own]


def range_of(motion: Motion, sensor: Sensor) -> tuple[float, float]:
    """Return the travel over which a sensor's linearity is defined: between stops, else what the motion uses."""
    rig = motion.plant.rig
    parts = {"angle": rig.joints, "position": rig.drives}.get(sensor.measures, ())
    stops = next((part.stops for part in parts if part.name == sensor.of), None)
    if stops is not None:
        return stops
    values = true_values(motion, sensor)
    return float(values.min()), float(values.max())


SENSOR = Layout(gain=1, bias=1, noise=1, step=1, low=1, high=1, weights=3, phases=3)
"""Numbers of a sensor, in the order of `SensorErrors.numbers`."""


def reading_function(plant: Mechanism) -> ca.Function:
    """Return (y, numbers, draws) → what the sensors read, as `SensorErrors` has it.

    Args:
        plant: the plant's equations; delays of its sensors are left out.
    """
    sensors = plant.rig.sensors
    y = ca.SX.sym("y", 3 * plant.n_bodies + plant.n_tendons)
    numbers, draws = ca.SX.sym("numbers", SENSOR.size, len(sensors)), ca.SX.sym("draws", len(sensors))
    read = []
    for k, sensor in enumerate(sensors):
        own = {name: SENSOR.part(numbers[:, k], name) for name in ("gain", "bias", "noise", "step", "low", "high")}
        weights, phases = SENSOR.part(numbers[:, k], "weights"), SENSOR.part(numbers[:, k], "phases")
        at, changes = columns_of(plant, sensor)
        true = y[at] + sensor.lag * y[changes] if sensor.lag > 0.0 else y[at]
        share = ca.fmin(ca.fmax((true - own["low"]) / (own["high"] - own["low"]), 0), 1)
        curve = sum((weights[i] * ca.sin(np.pi * (i + 1) * share + phases[i]) for i in range(3)), ca.SX(0))
        value = own["gain"] * true + own["bias"] + curve + own["noise"] * draws[k]
        step = ca.if_else(own["step"] > 0, own["step"], 1)
        read.append(ca.if_else(own["step"] > 0, ca.floor(value / step + 0.5) * step, value))
    return ca.Function("reading", [y, numbers, draws], [ca.densify(ca.vertcat(*read))])
