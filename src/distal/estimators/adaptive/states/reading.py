"""Unknowns of readings: what they depend on, such as the angle at which an IMU is mounted, and the
systematic errors of sensors: offset, gain, and the curve of a position sensor.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.state import Fading, Learning, OfSensor, State
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar, Vector
from distal.rig import Parameter, Sensor, measurand_of
from distal.sensor_errors import LINEARITY_STD, systematic_variance


@dataclass(frozen=True)
class UnknownOfReading(State):
    """An uncertain quantity that one or several readings depend on, by its name; it stays."""

    lasting: ClassVar[bool] = True

    name: str
    number: Parameter

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the state, (1,)."""
        return (self.name,)

    @property
    def means(self) -> Floats:
        """Prior mean: the rig's value, (1,)."""
        return np.array([self.number.value])

    @property
    def stds(self) -> Floats:
        """Prior standard deviation: the rig's, (1,)."""
        return np.array([self.number.filter_std])

    def unknowns(self, values: Vector) -> dict[str, Scalar]:
        """Return name → the quantity."""
        return {self.name: values[0]}


def unknowns_of_readings(context: FilterContext) -> list[State]:
    """Return a block for each quantity of readings whose std is not zero; sensors share those of
    the same name.
    """
    unknowns = [unknown for s in context.channels.others for unknown in measurand_of(s).unknowns(s)]
    values = {
        unknown.name: unknown.number for unknown in unknowns if unknown.number.filter_std > 0.0
    }
    return [UnknownOfReading(name, number) for name, number in values.items()]


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


BASIS = 6
"""Number of basis functions of a sensor's linearity over its travel [1]: more changed no error on
the logs of `make accuracy`. Source: benchmark (benchmarks/accuracy).
"""

SMOOTHNESS = 3.0
"""Order j₀ at which the prior of the weights decreases, in half waves over the travel [1];
`distal.sensor_errors` draws curves so. Source: judgement.
"""


@dataclass(frozen=True)
class Linearity(State):
    """The weights w_j of a position sensor's error Σ w_j cos(π j ξ), ξ = 0 … 1 over the travel.

    The error is a Gaussian process over the travel with a squared-exponential spectrum: the stds of
    w_j decrease as exp(−(j/j₀)²/2), scaled so that the mean variance over the travel is that of the
    linearity. The variance of a bias adds to that of the constant weight. A posture that lasts
    shows only one point of the curve, so that references teach it slowly.
    """

    kind: ClassVar[StateKind] = StateKind.LINEARITY
    lasting: ClassVar[bool] = True
    learning: ClassVar[Learning] = Learning.FROM_REFERENCES_SLOWLY

    context: FilterContext
    drive: int
    sensor: Sensor

    @property
    def part(self) -> str:
        """Name of the sensor."""
        return self.sensor.name

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the weights: ``linearity_SENSOR_j``."""
        return tuple(f"linearity_{self.sensor.name}_{j}" for j in range(len(self.stds)))

    @property
    def means(self) -> Floats:
        """Prior means of the weights: the sensor's known `curve`, else zeros [m, rad]."""
        weights = np.zeros(len(self.stds))
        curve = getattr(self.sensor, "curve", ())
        weights[: len(curve)] = curve[: len(weights)]
        return weights

    @cached_property
    def stds(self) -> Floats:
        """Prior standard deviations of the weights [m, rad]; empty where the sensor has no
        systematic error.
        """
        sensor = self.sensor
        bias = self.context.bias_std(self.sensor)
        if sensor.linearity == 0.0:
            return np.array([bias]) if bias > 0.0 else np.zeros(0)
        shape = np.exp(-0.5 * (np.arange(BASIS) / SMOOTHNESS) ** 2)
        shape /= np.sqrt(shape[0] ** 2 + 0.5 * np.sum(shape[1:] ** 2))
        stds: Floats = LINEARITY_STD * sensor.linearity * shape
        stds[0] = np.hypot(stds[0], bias)
        return stds

    def position_error(self, drive: int, reading: Scalar, values: Vector) -> Scalar:
        """Return the error Σ w_j cos(π j ξ) of this drive's sensor [m, rad], 0 for another drive.

        By cos(π (j + 1) ξ) = 2 cos(π ξ) cos(π j ξ) − cos(π (j − 1) ξ) one cosine suffices
        (Chebyshev).
        """
        count = len(self.stds)
        if drive != self.drive or count == 0:
            return 0
        path = f"drives.{self.drive}.travel"
        low = self.context.number(f"{path}.low")
        high = self.context.number(f"{path}.high")
        terms = [ca.SX(1), ca.cos(ca.pi * ((reading - low) / (high - low)))]
        while len(terms) < count:
            terms.append(2 * terms[1] * terms[-1] - terms[-2])
        return ca.dot(ca.vertcat(*terms[:count]), values)


def linearities(context: FilterContext) -> list[State]:
    """Return a block for each position sensor with a systematic error."""
    sensors = ((i, context.position_sensor(i)) for i in range(context.n_drives))
    blocks = [Linearity(context, i, sensor) for i, sensor in sensors if sensor is not None]
    return [block for block in blocks if len(block.stds)]
