"""The systematic errors of a sensor of force, tension or angle: its offset and its gain."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.state import Fading, Learning, OfSensor, State
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar, Vector
from distal.rig import Sensor
from distal.sensor_errors import systematic_variance


@dataclass(frozen=True)
class SensorBias(OfSensor):
    """The offset b of a sensor, which stays, or walks by the bias's `drift`.

    The offset of a reference of a joint's angle stays within its std instead: with a `drift` it is
    a first-order Gauss–Markov process, of which e^{−dt/T} is left after dt, T = 2 σ²/drift². It is
    the difference between the model's angle and the joint's, so that a short reference tells less
    than a long one.
    """

    quantity: ClassVar[str] = "bias"
    kind: ClassVar[StateKind] = StateKind.SENSOR_BIAS

    @property
    def stds(self) -> Floats:
        """Prior standard deviation of b, from bias and linearity together."""
        linearity = np.sqrt(systematic_variance(self.sensor))
        return np.array([float(np.hypot(self.context.bias_std(self.sensor), linearity))])

    @property
    def _wanders(self) -> bool:
        return bool(self.sensor.measures == "angle" and self.sensor.bias.drift)

    @property
    def walk(self) -> float:
        """The bias's `drift` per √s; 0 for a reference, which fades instead."""
        return (
            0.0
            if self._wanders or self.sensor.bias.drift is None
            else float(self.sensor.bias.drift)
        )

    def inputs(self) -> Iterator[tuple[str, float]]:
        """Yield std and drift of a reference with a drift."""
        if self._wanders:
            path = f"{self.context.path(self.sensor)}.bias"
            yield f"{path}.std", float(self.stds[0])
            yield f"{path}.drift", float(self.sensor.bias.drift or 0.0)

    def fading(self, dt: Scalar) -> Fading | None:
        """Return e^{−dt drift²/(2 σ²)} and σ for a reference with a drift, None for others."""
        if not self._wanders:
            return None
        path = f"{self.context.path(self.sensor)}.bias"
        std = self.context.number(f"{path}.std")
        drift = self.context.number(f"{path}.drift")
        return Fading(ca.exp(-dt * drift**2 / (2 * std**2)), std)

    def sensor_error(self, sensor: Sensor, reading: Scalar, values: Vector) -> Scalar:
        """Return b if it is the offset of this sensor, else 0."""
        return values[0] if sensor.name == self.sensor.name else 0


@dataclass(frozen=True)
class SensorGain(OfSensor):
    """The gain error γ of a sensor of force or tension, as a share of its reading; it stays. Forces
    tell little of it.
    """

    quantity: ClassVar[str] = "gain"
    kind: ClassVar[StateKind] = StateKind.SENSOR_GAIN
    learning: ClassVar[Learning] = Learning.SLOWLY

    @property
    def stds(self) -> Floats:
        """Prior standard deviation of γ: that of the sensor's `gain`, as a share of it [1]."""
        return np.array([self.context.gain_std(self.sensor)])

    def sensor_error(self, sensor: Sensor, reading: Scalar, values: Vector) -> Scalar:
        """Return γ times the reading if it is the gain error of this sensor, else 0."""
        return values[0] * reading if sensor.name == self.sensor.name else 0


def sensor_biases(context: FilterContext) -> list[State]:
    """Return a block for the offset and one for the gain of each compared sensor in which these are
    uncertain.
    """
    blocks = [
        error(context, sensor)
        for error in (SensorBias, SensorGain)
        for sensor in context.channels.compared
    ]
    return [block for block in blocks if block.stds[0] > 0.0]
