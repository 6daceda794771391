"""Systematic errors of sensors: offset, gain, and the curve of a position sensor."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.state import State
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar
from distal.rig import Sensor
from distal.sensor_errors import LINEARITY_STD, systematic_variance


def sensor_biases(context: FilterContext) -> Iterator[State]:
    """Yield the offset b of each compared sensor in which it is uncertain, then the gain error γ of
    each, as a share of its reading; forces tell little of that.
    """
    sensors = context.channels.compared
    yield from (bias for bias in (_bias(context, sensor) for sensor in sensors) if bias.std > 0.0)
    for sensor in sensors:
        std = context.gain_std(sensor)
        if std > 0.0:
            to = ("reading", sensor.name)
            name = f"gain_{sensor.name}"
            kind = StateKind.SENSOR_GAIN
            yield State(name, kind, sensor.name, 0.0, std, to=to, times=_proportional)


def _proportional(reading: Scalar) -> Scalar:
    return reading


def _bias(context: FilterContext, sensor: Sensor) -> State:
    """Return the offset of a sensor, which stays, or walks by the bias's `drift`.

    The offset of a reference of a joint's angle stays within its std instead: with a `drift` it is
    a first-order Gauss–Markov process, of which e^{−dt/T} is left after dt, T = 2 σ²/drift². It is
    the difference between the model's angle and the joint's, so that a short reference tells less
    than a long one.
    """
    std = float(np.hypot(context.bias_std(sensor), np.sqrt(systematic_variance(sensor))))
    of = f"bias_{sensor.name}", StateKind.SENSOR_BIAS, sensor.name, 0.0, std
    to = ("reading", sensor.name)
    drift = float(sensor.bias.drift or 0.0)
    if sensor.measures != "angle" or drift == 0.0:
        return State(*of, to=to, walk=drift)
    path = f"{context.path(sensor)}.bias"
    std_by = partial(context.number, f"{path}.std")
    inputs = {f"{path}.std": std, f"{path}.drift": drift}
    return State(*of, to=to, std_by=std_by, fades_in=partial(_lasts, context, path), inputs=inputs)


def _lasts(context: FilterContext, path: str) -> Scalar:
    return 2 * context.number(f"{path}.std") ** 2 / context.number(f"{path}.drift") ** 2


BASIS = 6
"""Number of basis functions of a sensor's linearity over its travel [1]: more changed no error on
the logs of `make accuracy`. Source: benchmark (benchmarks/accuracy).
"""

SMOOTHNESS = 3.0
"""Order j₀ at which the prior of the weights decreases, in half waves over the travel [1];
`distal.sensor_errors` draws curves so. Source: judgement.
"""


def linearities(context: FilterContext) -> Iterator[State]:
    """Yield the weights w_j of each position sensor's error Σ w_j cos(π j ξ), ξ = 0 … 1 over the
    travel; none where the sensor has no systematic error. Their prior means are zeros.

    A posture that lasts shows only one point of the curve, so that references teach it slowly.
    """
    for i in range(context.n_drives):
        sensor = context.position_sensor(i)
        if sensor is None:
            continue
        for j, std in enumerate(_weight_stds(context, sensor)):
            yield State(
                f"linearity_{sensor.name}_{j}",
                StateKind.LINEARITY,
                sensor.name,
                0.0,
                float(std),
                to=("reading", sensor.name),
                times=partial(_cosine, context, i, j),
            )


def _weight_stds(context: FilterContext, sensor: Sensor) -> Floats:
    """Return the prior standard deviations of the weights [m, rad].

    The error is a Gaussian process over the travel with a squared-exponential spectrum: the stds of
    w_j decrease as exp(−(j/j₀)²/2), scaled so that the mean variance over the travel is that of the
    linearity. The variance of a bias adds to that of the constant weight.
    """
    bias = context.bias_std(sensor)
    if sensor.linearity == 0.0:
        return np.array([bias] if bias > 0.0 else [])
    shape = np.exp(-0.5 * (np.arange(BASIS) / SMOOTHNESS) ** 2)
    shape /= np.sqrt(shape[0] ** 2 + 0.5 * np.sum(shape[1:] ** 2))
    stds: Floats = LINEARITY_STD * sensor.linearity * shape
    stds[0] = np.hypot(stds[0], bias)
    return stds


def _cosine(context: FilterContext, drive: int, order: int, reading: Scalar) -> Scalar:
    """Return cos(π j ξ) of the `order` j at a `reading`.

    By cos(π (j + 1) ξ) = 2 cos(π ξ) cos(π j ξ) − cos(π (j − 1) ξ) one cosine suffices for all
    (Chebyshev).
    """
    low, high = (context.number(f"drives.{drive}.travel.{end}") for end in ("low", "high"))
    terms = [ca.SX(1), ca.cos(ca.pi * ((reading - low) / (high - low)))]
    for _ in range(order - 1):
        terms.append(2 * terms[1] * terms[-1] - terms[-2])
    return terms[order]
