"""Between a log's numbers and SI: gain, quantisation step, factor and unit of a sensor."""

from __future__ import annotations

from math import pi

from distal.errors import UnitError
from distal.rig.quantities import Parameter
from distal.rig.sensors.by_unit import AngleSensor, ForceSensor, TorqueSensor
from distal.rig.sensors.registry import Sensor
from distal.units import unit_factor


def gain_of(sensor: Sensor) -> Parameter:
    """Return the gain of a sensor, its reading per unit of what it measures; exactly 1 but for
    forces and torques.
    """
    return sensor.gain if isinstance(sensor, (ForceSensor, TorqueSensor)) else Parameter(value=1.0)


def step_of(sensor: Sensor) -> float:
    """Return the quantisation step of what a sensor measures [SI], behind its gear: `resolution` is
    that before the gear.
    """
    return sensor.resolution / (sensor.gear if isinstance(sensor, AngleSensor) else 1.0)


def log_factor(sensor: Sensor) -> float:
    """Return the factor from a log's numbers to SI, without the sensor's `sign`.

    Raises:
        UnitError: the unit is unknown or has the wrong dimension.
    """
    if isinstance(sensor, TorqueSensor):
        unit, torque = sensor.logged
        try:
            return torque * unit_factor(sensor.unit or unit, unit)
        except UnitError as problem:
            needs = (
                "; a load cell in N needs its lever, a current a torque_constant"
                if unit == sensor.si
                else ""
            )
            raise UnitError(f"{problem}{needs}") from None
    gear = sensor.gear if isinstance(sensor, AngleSensor) else 1.0
    if isinstance(sensor, AngleSensor) and sensor.counts_per_turn is not None:
        return 2 * pi / (sensor.counts_per_turn * gear)
    return unit_factor(sensor.unit or sensor.si, sensor.si) / gear


def log_unit(sensor: Sensor) -> str:
    """Return the unit of a sensor's numbers in the log."""
    return sensor.unit or (sensor.logged[0] if isinstance(sensor, TorqueSensor) else sensor.si)
