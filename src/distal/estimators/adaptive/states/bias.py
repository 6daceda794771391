"""The systematic errors of a sensor of force, tension or angle: its offset and its gain."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.context import FilterContext
from distal.estimators.adaptive.states.state import Fading, Learning, State
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar, Vector
from distal.rig import Sensor
from distal.sensors import systematic_variance


@dataclass(frozen=True)
class SensorBias(State):
    """A bias, which stays, or walks by its `drift`; that of a reference of a joint's angle walks within its std.

    A reference's bias that walks is a first-order Gauss–Markov process: e^{−dt/T_i} of it is left after dt,
    T_i = 2 σ_i²/drift². It is what the model's angle and the joint's differ by, so that a moment's reference tells
    less than a long one.

    Args:
        context: the rig.
        sensor: whose bias it is.
    """

    context: FilterContext
    sensor: Sensor

    @property
    def lasting(self) -> bool:
        """It is a number of the sensor."""
        return True

    @property
    def kind(self) -> StateKind:
        """An offset."""
        return StateKind.SENSOR_BIAS

    @property
    def part(self) -> str:
        """The sensor's name."""
        return self.sensor.name

    @property
    def names(self) -> tuple[str, ...]:
        """``bias_SENSOR``."""
        return (f"bias_{self.sensor.name}",)

    @property
    def means(self) -> Floats:
        """None is expected beyond the known offset."""
        return np.zeros(1)

    @property
    def stds(self) -> Floats:
        """Bias and linearity together."""
        own = self.context.bias_std(self.sensor)
        return np.array([float(np.hypot(own, np.sqrt(systematic_variance(self.sensor))))])

    @property
    def _wanders(self) -> bool:
        return bool(self.sensor.measures == "angle" and self.sensor.bias.drift)

    @property
    def walk(self) -> float:
        """The bias's `drift` per √s; 0 for a reference's, which fades instead."""
        return 0.0 if self._wanders or self.sensor.bias.drift is None else float(self.sensor.bias.drift)

    def fading(self, dt: Scalar) -> Fading | None:
        """Return e^{−dt drift²/(2 σ_i²)} and σ_i of a reference that wanders, None for others.

        Args:
            dt: length of the interval [s].
        """
        if not self._wanders:
            return None
        path = f"{self.context.path(self.sensor)}.bias"
        std = self.context.number(f"{path}.std", float(self.stds[0]))
        drift = self.context.number(f"{path}.drift", self.sensor.bias.drift or 0.0)
        return Fading(ca.exp(-dt * drift**2 / (2 * std**2)), std)

    def sensor_error(self, sensor: Sensor, reading: Scalar, own: Vector) -> Scalar:
        """Return b where it is this sensor's.

        Args:
            reading: what it reads.
            own: b.
        """
        return own[0] if sensor.name == self.sensor.name else 0


@dataclass(frozen=True)
class SensorGain(State):
    """By which share a sensor of force or tension reads too much; it stays.

    Args:
        context: the rig.
        sensor: whose gain it is.
    """

    context: FilterContext
    sensor: Sensor

    @property
    def lasting(self) -> bool:
        """It is a number of the sensor."""
        return True

    @property
    def learning(self) -> Learning:
        """A force tells little of it."""
        return Learning.SLOWLY

    @property
    def kind(self) -> StateKind:
        """A gain."""
        return StateKind.SENSOR_GAIN

    @property
    def part(self) -> str:
        """The sensor's name."""
        return self.sensor.name

    @property
    def names(self) -> tuple[str, ...]:
        """``gain_SENSOR``."""
        return (f"gain_{self.sensor.name}",)

    @property
    def means(self) -> Floats:
        """None is expected beyond the known gain [1]."""
        return np.zeros(1)

    @property
    def stds(self) -> Floats:
        """The std of its `gain`, as a share of it [1]."""
        return np.array([self.context.gain_std(self.sensor)])

    def sensor_error(self, sensor: Sensor, reading: Scalar, own: Vector) -> Scalar:
        """Return that share times the reading where it is this sensor's.

        Args:
            reading: what it reads.
            own: that share, (1,).
        """
        return own[0] * reading if sensor.name == self.sensor.name else 0


def sensor_biases(context: FilterContext) -> list[State]:
    """Return a block for the offset and one for the gain of each compared sensor that errs systematically in them."""
    sensors = context.channels.compared
    blocks: list[State] = [SensorBias(context, sensor) for sensor in sensors]
    blocks += [SensorGain(context, sensor) for sensor in sensors]
    return [block for block in blocks if block.stds[0] > 0.0]
