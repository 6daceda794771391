"""What there is to measure of a simulated motion, for each measurand (see `distal.rig.measurands`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from distal.model import Mechanism
from distal.rig import Sensor

Floats = NDArray[np.float64]


def true_values(
    plant: Mechanism, sensor: Sensor, motion: dict[str, Floats], grid: Floats
) -> tuple[Floats, tuple[float, float]]:
    """Return what there is to measure over a grid, (k,), and the travel of the sensor's linearity.

    Args:
        plant: the plant's equations.
        sensor: one of its rig's.
        motion: of the plant; see `run_plant`.
        grid: its stamps [s], (k,).
    """
    rig = plant.rig
    if sensor.measures == "angle":
        index = [joint.name for joint in rig.joints].index(sensor.of)
        values, stops = motion["q"][:, index], rig.joints[index].stops
    elif sensor.measures == "torque":
        values, stops = motion["torques"][:, [joint.name for joint in rig.joints].index(sensor.of)], None
    elif sensor.measures == "tension":
        values, stops = motion["tensions"][:, [tendon.name for tendon in rig.tendons].index(sensor.of)], None
    else:
        index = [drive.name for drive in rig.drives].index(sensor.of)
        stops = rig.drives[index].stops if sensor.measures == "position" else None
        values = motion["q"][:, plant.n_joints + index] if sensor.measures == "position" else motion["pulls"][:, index]
    # without stops the travel is what the motion uses
    travel = stops if stops is not None else (float(values.min()), float(values.max()))
    if sensor.lag > 0.0:  # a command is ahead of where the drive is
        values = values + sensor.lag * np.gradient(values, grid)
    return values, travel
