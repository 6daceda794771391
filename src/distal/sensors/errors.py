"""The errors of real sensors: linearity, bias, random noise, resolution, in the order in which they arise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.expressions import Expression
from distal.rig import Rig, Sensor, gain_of, step_of

_HARMONICS = 3


@dataclass(frozen=True)
class Curves:
    """Smooth systematic deviations of several sensors over their travels, the same wherever x is the same.

    Σ_j a_j sin(π j ξ + φ_j)/j over ξ = (x − low)/(high − low), j = 1..3, scaled so that the largest magnitude over the
    travel is `largest`; beyond the ends a curve keeps the value that it has there.

    Args:
        low: lower ends of the travels, (n,), `high` the upper ones; where they are not above them, there is no curve.
        weights: scale · a_j/j, (n, 3); `phases` are φ_j.
    """

    low: Floats
    high: Floats
    weights: Floats
    phases: Floats

    @classmethod
    def drawn(
        cls, travels: Sequence[tuple[float, float]], largest: Sequence[float], rngs: Sequence[np.random.Generator]
    ) -> Curves:
        """Draw a curve for each sensor by its own generator, over its travel and of its `largest` magnitude, (n,)."""
        low, high = (np.array([ends[k] for ends in travels]) for k in (0, 1))
        orders = np.arange(1, _HARMONICS + 1)
        drawn = [(rng.normal(size=_HARMONICS) / orders, rng.uniform(0.0, 2.0 * np.pi, _HARMONICS)) for rng in rngs]
        weights, phases = (np.array([curve[k] for curve in drawn]) for k in (0, 1))
        unscaled = cls(np.zeros(len(low)), np.ones(len(low)), weights, phases)
        peaks = np.abs(unscaled.at(np.linspace(0.0, 1.0, 501)[:, None] * np.ones(len(low)))).max(axis=0)
        scales = np.where(high > low, np.asarray(largest) / peaks, 0.0)
        return cls(low, np.where(high > low, high, low + 1.0), scales[:, None] * weights, phases)

    def at(self, x: Floats) -> Floats:
        """Return the deviations at true values x, (k, n)."""
        share = np.clip((x - self.low) / (self.high - self.low), 0.0, 1.0)
        orders = np.arange(1, _HARMONICS + 1)
        deviations: Floats = np.sum(self.weights * np.sin(np.pi * orders * share[..., None] + self.phases), axis=-1)
        return deviations


AHEAD = 256
"""So many samples' noise is drawn at a time."""


class SensorErrors:
    """The errors of n sensors in one run, however few of their samples come at a time.

    Linearities are defined over `travels`; one of `rngs` for each draws curve and noise, the same whatever is switched off.
    """

    def __init__(
        self, sensors: Sequence[Sensor], travels: Sequence[tuple[float, float]], rngs: Sequence[np.random.Generator]
    ) -> None:
        of_curves, self._rngs = zip(*(rng.spawn(2) for rng in rngs))
        self._gain = np.array([gain_of(sensor).value for sensor in sensors])
        self._bias = np.array([sensor.bias.value for sensor in sensors])
        self._noise = np.array([sensor.noise for sensor in sensors])
        self._step = np.array([step_of(sensor) for sensor in sensors])
        self._curves = Curves.drawn(travels, [sensor.linearity for sensor in sensors], of_curves)
        self._rounds, self._drawn = bool(np.any(self._step > 0.0)), np.zeros((0, len(sensors)))

    @property
    def numbers(self) -> Floats:
        """Gain, bias, noise, step, low and high end, three weights and three phases of each sensor, (n, 12)."""
        curves = self._curves
        first = self._gain, self._bias, self._noise, self._step, curves.low, curves.high
        return np.column_stack([*first, curves.weights, curves.phases])

    def draws(self, count: int) -> Floats:
        """Return the random numbers that the next samples will have, (count, n)."""
        if len(self._drawn) < count:
            more = max(AHEAD, count)
            self._drawn = np.vstack([self._drawn, np.column_stack([rng.normal(size=more) for rng in self._rngs])])
        return self._drawn[:count]

    def read(self, true: Floats) -> Floats:
        """Return what the sensors read of the next true values in time [SI], (k, n).

        That is the gain times the true value, plus linearity, bias and noise, rounded to the resolution.
        """
        read: Floats = self._gain * true + self._bias + self._curves.at(true) + self._noise * self.draws(len(true))
        self._drawn = self._drawn[len(true) :]
        if self._rounds:
            read = quantised(read, self._step)
        return read


def quantised(values: Floats, step: Floats | float) -> Floats:
    """Return `values` as multiples of a `step` [the same unit], ties up; as they are where it is 0."""
    size = np.where(np.asarray(step) > 0, step, 1.0)
    return np.where(np.asarray(step) > 0, np.floor(values / size + 0.5) * size, values)


def quantised_symbol(value: Expression, step: Expression) -> Expression:
    """Return the same of an expression: a `value` as a multiple of a `step` [the same unit]."""
    size = ca.if_else(step > 0, step, 1)
    return ca.if_else(step > 0, ca.floor(value / size + 0.5) * size, value)


def measure(sensor: Sensor, true: Floats, travel: tuple[float, float], rng: np.random.Generator) -> Floats:
    """Return what a sensor reads of a whole run, (n,), of `true` values [SI] over a `travel`; see `SensorErrors`."""
    return SensorErrors([sensor], [travel], [rng]).read(true[:, None])[:, 0]


def quantisation_variance(step: float) -> float:
    """Return the variance of what rounding to a step Δ adds, Δ²/12 (Widrow and Kollár, Quantization Noise, 2008)."""
    return float(step**2 / 12.0)


def variance(sensor: Sensor) -> float:
    """Return the variance of the random error: σ² + Δ²/12 with noise σ and resolution Δ."""
    return float(sensor.noise**2 + quantisation_variance(step_of(sensor)))


LINEARITY_STD = 0.6
"""Std of a linearity curve over places and curves, as a share of its largest magnitude (tests/sensors/test_errors.py)."""


def systematic_variance(sensor: Sensor) -> float:
    """Return the variance of the linearity error at a random place, (0.6 · largest deviation)²."""
    return float((LINEARITY_STD * sensor.linearity) ** 2)


def place_offsets(rig: Rig, names: Sequence[str]) -> Floats:
    """Return the known offsets that are taken off the readings of drives' places, 0 for other sensors [SI], (n,)."""
    sensors = {sensor.name: sensor for sensor in rig.sensors}
    return np.array([sensors[name].bias.value if sensors[name].measures == "position" else 0.0 for name in names])
