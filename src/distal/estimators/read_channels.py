"""The sensors that an estimator reads, by their role, and the time after which a silent one counts
as dead.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

from distal.errors import DistalWarning, EstimationError
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
        others: any other, such as the numbers of an IMU; only `adaptive` compares them.
        interval: nominal, that of the fastest sensor [s], angles left out.
    """

    positions: tuple[Sensor, ...]
    forces: tuple[Sensor, ...]
    tensions: tuple[Sensor, ...]
    angles: tuple[Sensor, ...]
    others: tuple[Sensor, ...]
    interval: float

    @property
    def proximal(self) -> tuple[Sensor, ...]:
        """The sensors at the proximal end, from which maps learn: positions, tensions, forces."""
        return (*self.positions, *self.tensions, *self.forces)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sensors in the order in which estimators read them: positions, tensions,
        forces, others, angles.
        """
        return tuple(sensor.name for sensor in (*self.proximal, *self.others, *self.angles))

    @property
    def compared(self) -> tuple[Sensor, ...]:
        """The sensors whose values `adaptive` compares with predictions: forces, tensions, angles,
        others.
        """
        return (*self.forces, *self.tensions, *self.angles, *self.others)


def channels_of(
    rig: Rig, name: str, references: Sequence[Sensor] = (), others: bool = False
) -> Channels:
    """Return the sensors of a rig that an estimator reads.

    Args:
        name: of the estimator, for messages.
        references: sensors of joints' angles that are read too, while they are known.
        others: whether sensors of any other kind are read too.

    Raises:
        EstimationError: no drive's position is measured, two sensors measure the same, or a sensor
            has zero noise.
    """
    positions, forces, tensions, added = (
        tuple(sensor for sensor in rig.sensors if measurand_of(sensor).role is role)
        for role in (Role.POSITION, Role.EFFORT, Role.TENSION, Role.COMPARED)
    )
    if not positions:
        raise EstimationError(
            f"{name}: the rig '{rig.name}' has no sensor that measures the position of a drive; "
            "add one to [[sensors]]"
        )
    compared = added if others else ()
    rates = [sensor.rate for sensor in (*positions, *forces, *tensions, *compared)]
    interval = 1.0 / max(rates)
    channels = Channels(positions, forces, tensions, tuple(references), compared, interval)
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
            if sensor.delay > 0.0:
                warnings.warn(
                    f"{name}: sensor '{sensor.name}' is late by {sensor.delay:g} s; estimators "
                    "take its values as of "
                    "their stamps, so shift the column of the log by that",
                    DistalWarning,
                    stacklevel=2,
                )
    for sensor in (*channels.proximal, *channels.angles, *channels.others):
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
