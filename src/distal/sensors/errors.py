"""The errors of real sensors: linearity, bias, random noise, resolution, in the order in which they arise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from distal.rig import Rig, Sensor, gain_of, step_of

Floats = NDArray[np.float64]

_HARMONICS = 3


def linearity_curve(x: Floats, low: float, high: float, largest: float, rng: np.random.Generator) -> Floats:
    """Return a smooth systematic deviation over the travel, of at most `largest`, the same wherever x is the same.

    Σ_j a_j sin(π j ξ + φ_j)/j over ξ = (x − low)/(high − low), j = 1..3, with random amplitudes and phases, scaled so
    that its largest magnitude over the travel is `largest`.

    Args:
        x: true values, (n,).
        low: lower end of the travel.
        high: upper end of the travel.
        largest: largest magnitude.
        rng: draws the curve.
    """
    amplitudes = rng.normal(size=_HARMONICS)
    phases = rng.uniform(0.0, 2.0 * np.pi, size=_HARMONICS)
    orders = np.arange(1, _HARMONICS + 1)

    def curve(at: Floats) -> Floats:
        fraction = (at - low) / (high - low)
        waves = np.sin(np.pi * orders * fraction[:, None] + phases)
        deviation: Floats = waves @ (amplitudes / orders)
        return deviation

    peak = float(np.abs(curve(np.linspace(low, high, 501))).max())
    # beyond the ends the curve keeps the value it has there
    return largest * curve(np.clip(x, low, high)) / peak


def measure(sensor: Sensor, true: Floats, travel: tuple[float, float], rng: np.random.Generator) -> Floats:
    """Return what a sensor reads: gain times true value, plus linearity, bias and noise, rounded to its resolution.

    Args:
        sensor: its description.
        true: what there is to measure, SI, (n,).
        travel: ends of the travel over which the linearity is defined.
        rng: draws the curve and the noise; the same draws are made whatever is switched off.
    """
    curve_rng, noise_rng = rng.spawn(2)
    read = gain_of(sensor).value * true + sensor.bias.value
    low, high = travel
    if sensor.linearity > 0.0 and high > low:
        read = read + linearity_curve(true, low, high, sensor.linearity, curve_rng)
    read = read + sensor.noise * noise_rng.normal(size=true.shape)
    step = step_of(sensor)
    if step > 0.0:
        read = np.round(read / step) * step
    return read


def variance(sensor: Sensor) -> float:
    """Return the variance of the random error: σ² + Δ²/12 with noise σ and resolution Δ."""
    return float(sensor.noise**2 + step_of(sensor) ** 2 / 12.0)


LINEARITY_STD = 0.6
"""Standard deviation of a linearity curve over places and curves, as a share of its largest magnitude.

Measured over many curves by ``tests/sensors/test_errors.py``.
"""


def systematic_variance(sensor: Sensor) -> float:
    """Return the variance of the linearity error at a random place, (0.6 · largest deviation)²."""
    return float((LINEARITY_STD * sensor.linearity) ** 2)


def place_offsets(rig: Rig, names: Sequence[str]) -> Floats:
    """Return the known offsets that are taken off the readings of drives' places, 0 for other sensors [SI], (n,).

    Args:
        rig: the description.
        names: of the sensors.
    """
    sensors = {sensor.name: sensor for sensor in rig.sensors}
    return np.array([sensors[name].bias.value if sensors[name].measures == "position" else 0.0 for name in names])
