"""The errors of real sensors: linearity, bias, random noise, resolution, in the order in which they
arise.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.expressions import Expression, symbols
from distal.kernels import Layout
from distal.rig import Sensor, gain_of, step_of

HARMONICS = 3
"""Number of sine waves in a linearity curve [1]. Source: judgement."""

SENSOR = Layout(gain=1, bias=1, noise=1, step=1, low=1, high=1, weights=HARMONICS, phases=HARMONICS)
"""Layout of the numbers that describe one sensor's errors in a run: gain [1], bias, noise std and
quantisation step [SI], the ends of its travel [SI], and weights [SI] and phases [rad] of its
linearity curve. Source: definition (a layout).
"""


def reading(true: Expression, sensor: Mapping[str, Expression], draw: Expression) -> Expression:
    """Return what a sensor reads of a `true` value [SI]: gain · true + bias + curve + noise · draw,
    rounded to its step.

    Args:
        sensor: its numbers by the names in `SENSOR`.
        draw: a standard normal random number.
    """
    noisy = (
        sensor["gain"] * true
        + sensor["bias"]
        + linearity_curve(true, sensor)
        + sensor["noise"] * draw
    )
    return quantised(noisy, sensor["step"])


def linearity_curve(true: Expression, sensor: Mapping[str, Expression]) -> Expression:
    """Return the linearity error at a `true` value x [SI], a smooth systematic deviation that
    depends on x alone.

    It is Σ_j a_j sin(π j ξ + φ_j)/j over ξ = (x − low)/(high − low), j = 1..3; the numbers of the
    `sensor` are `weights` a_j/j and `phases` φ_j. Beyond an end of the travel the curve keeps its
    value at that end.
    """
    share = ca.fmin(ca.fmax((true - sensor["low"]) / (sensor["high"] - sensor["low"]), 0), 1)
    waves = (
        ca.sin(np.pi * (i + 1) * share + sensor["phases"][i]) * sensor["weights"][i]
        for i in range(HARMONICS)
    )
    return sum(waves, 0 * share)


def quantised(value: Expression, step: Expression) -> Expression:
    """Return a `value` rounded to the nearest multiple of a `step` [the same unit], ties upwards;
    unchanged where the step is 0.
    """
    size = ca.if_else(step > 0, step, 1)
    return ca.if_else(step > 0, ca.floor(value / size + 0.5) * size, value)


def quantised_values(values: Floats, step: float) -> Floats:
    """Return `values` as multiples of a `step` [the same unit], (k,): see `quantised`."""
    rounded: Floats = np.array(quantised(ca.DM(values), ca.DM(step))).ravel()
    return rounded


@cache
def _reading() -> ca.Function:
    """Return (true, numbers of `SENSOR`, draw) → `reading`."""
    true, values, draw = inputs = symbols(ca.SX, true=1, numbers=SENSOR.size, draw=1)
    return ca.Function("reading", inputs, [reading(true, SENSOR.parts(values), draw)])


def drawn_curve(
    ends: tuple[float, float], largest: float, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Return weights [SI] and phases [rad] of a random linearity curve over a travel with these
    `ends`; its largest magnitude is `largest` [SI], 0 where the travel is empty.
    """
    weights = rng.normal(size=HARMONICS) / np.arange(1, HARMONICS + 1)
    phases = rng.uniform(0.0, 2.0 * np.pi, HARMONICS)
    curve = {"low": 0.0, "high": 1.0, "weights": weights, "phases": phases}
    peak = np.abs(np.array(linearity_curve(ca.DM(np.linspace(0.0, 1.0, 501)), curve))).max()
    return (largest / peak if ends[1] > ends[0] else 0.0) * weights, phases


class SensorErrors:
    """The errors of a sensor in one run, whose samples may come in groups of any size.

    Its linearity curve is defined over a `travel` [SI]. Curve and noise are drawn by `rng`, and do
    not depend on which errors are zero.
    """

    def __init__(
        self, sensor: Sensor, travel: tuple[float, float], rng: np.random.Generator
    ) -> None:
        of_curve, self._rng = rng.spawn(2)
        low, high = travel
        weights, phases = drawn_curve(travel, sensor.linearity, of_curve)
        fixed = gain_of(sensor).value, sensor.bias.value, sensor.noise, step_of(sensor)
        ends = low, high if high > low else low + 1.0
        self._values = np.concatenate([fixed, ends, weights, phases])

    def read(self, true: Floats) -> Floats:
        """Return what the sensor reads at the next samples, in the order of time, of `true` values
        [SI], (k,); see `reading`.
        """
        draws = self._rng.normal(size=len(true))
        read: Floats = np.array(_reading()(true[None], self._values, draws[None])).ravel()
        return read


def quantisation_variance(step: float) -> float:
    """Return the variance of the error of rounding to a `step` Δ: Δ²/12 (Widrow and Kollár,
    Quantization Noise, 2008).
    """
    return float(step**2 / 12.0)


def variance(sensor: Sensor) -> float:
    """Return the variance of a sensor's random error: σ² + Δ²/12 with noise σ and resolution Δ."""
    return float(sensor.noise**2 + quantisation_variance(step_of(sensor)))


LINEARITY_STD = 0.6
"""Std of linearity curves over positions and draws, as a share of the largest magnitude [1].
Source: definition (std of `drawn_curve`, tests/test_sensor_models.py).
"""


def systematic_variance(sensor: Sensor) -> float:
    """Return the variance of the linearity error at a random position, (0.6 L)² with the largest
    deviation L.
    """
    return float((LINEARITY_STD * sensor.linearity) ** 2)
