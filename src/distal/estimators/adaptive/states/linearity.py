"""The systematic error of a position sensor: a smooth curve over the drive's travel, the same at
every return to a position.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.state import Learning, State
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar, Vector
from distal.rig import Sensor
from distal.sensor_errors import LINEARITY_STD

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
