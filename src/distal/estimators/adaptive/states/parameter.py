"""Parameters of the model that are not known for certain: every one with a std that shows in the sensors."""

from __future__ import annotations

from dataclasses import dataclass
from math import erf, exp, pi, sqrt
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.estimators.adaptive.setup import Setup
from distal.estimators.adaptive.states.state import State
from distal.rig import number
from distal.sensors import variance

Floats = NDArray[np.float64]

SMALLEST_VALUE = 0.01
"""A parameter that cannot be negative is kept above this share of its std."""

SMALLEST_FACTOR = 0.05
"""A common factor is kept above this."""

UNSEEN = 0.1
"""Friction of a drive whose std is below this share of its force sensor's noise does not show."""


@dataclass(frozen=True)
class UncertainParameter(State):
    """One parameter (its value), or several alike (a common factor).

    Tendons whose stiffness (or damping) has the same relative std are from one spool: they err together.

    Args:
        name: of the state.
        indices: of the parameters in the model's vector.
        factor: whether the state multiplies the parameters' values.
        mean: prior mean.
        std: prior standard deviation.
        walks: random walk per √s.
        bound: the state is kept at or above this.
    """

    name: str
    indices: tuple[int, ...]
    factor: bool
    mean: float
    std: float
    walks: float
    bound: float

    @property
    def names(self) -> tuple[str, ...]:
        """The path of the parameter, or of the factor."""
        return (self.name,)

    @property
    def means(self) -> Floats:
        """Its prior mean."""
        return np.array([self.mean])

    @property
    def stds(self) -> Floats:
        """Its prior standard deviation."""
        return np.array([self.std])

    @property
    def walk(self) -> float:
        """Its random walk per √s."""
        return self.walks

    @property
    def lowest(self) -> float:
        """What it is kept above."""
        return self.bound

    def parameters(self, own: Any, p: Any) -> Any:
        """Return the parameters with this one's value, or these times their factor.

        Args:
            own: value or factor.
            p: the parameters so far, (n_p,).
        """
        changed = ca.SX(p)
        for i in self.indices:
            changed[i] = p[i] * own[0] if self.factor else own[0]
        return changed


def uncertain_parameters(setup: Setup) -> list[UncertainParameter]:
    """Return the uncertain parameters as blocks, those without effect on a displacement-driven joint left out.

    A parameter that cannot be negative has its prior cut at zero: mean and variance are those of the cut normal.

    Args:
        setup: the rig.
    """
    p, found = setup.mechanism.parameters, list[UncertainParameter]()
    shared: dict[tuple[str, float, float], list[int]] = {}

    def walk(std: float, drift: float) -> float:
        return setup.robustness.parameter_walk * std if np.isnan(drift) else drift

    for i, name in enumerate(p.names):
        value, std, drift = float(p.values[i]), float(p.stds[i]), float(p.drifts[i])
        if std == 0.0 or _without_effect(setup, name, std):
            continue
        kind = name.split(".", 2)[2]
        if name.startswith("tendons.") and kind in ("stiffness", "damping") and value > 0.0:
            key = (kind, round(std / value, 9), round(walk(std, drift) / value, 9))
            shared.setdefault(key, []).append(i)
            continue
        mean, spread, lowest = value, std, -np.inf
        if number(setup.mechanism.rig, name).quantity.bound != "any":
            mean, spread = cut_normal(value, std)
            lowest = SMALLEST_VALUE * spread
        found.append(UncertainParameter(name, (i,), False, mean, spread, walk(spread, drift), lowest))
    for (kind, relative, walked), indices in shared.items():
        mean, spread = cut_normal(1.0, relative)
        name = p.names[indices[0]]
        if len(indices) > 1:
            several = sum(key[0] == kind and len(own) > 1 for key, own in shared.items()) > 1
            which = "+".join(p.names[i].split(".")[1] for i in indices)
            name = f"tendons.{which}.{kind}" if several else f"tendons.{kind}"
        found.append(UncertainParameter(f"{name}.factor", tuple(indices), True, mean, spread, walked, SMALLEST_FACTOR))
    return found


def _without_effect(setup: Setup, name: str, std: float) -> bool:
    """Return whether a parameter's std cannot be seen: a drive's inertia and stops, friction far below the noise."""
    if not name.startswith("drives."):
        return False
    index = int(name.split(".")[1])
    drive, sensor = setup.mechanism.rig.drives[index], setup.force_sensor(index)
    if name.endswith(("friction.load", "friction.constant")):
        noise = np.sqrt(variance(sensor)) if sensor is not None else drive.nominal_force.std
        force = std * max(abs(drive.nominal_force.value), 1.0) if name.endswith("load") else std
        return bool(force < UNSEEN * noise)
    return not name.endswith((".damping", ".radius"))


def cut_normal(mean: float, std: float) -> tuple[float, float]:
    """Return mean and standard deviation of a normal distribution cut at zero.

    Args:
        mean: of the whole normal distribution.
        std: of it.
    """
    lower = -mean / std
    if lower < -4.0:
        return mean, std
    density, above = exp(-lower * lower / 2) / sqrt(2 * pi), 0.5 * (1 - erf(lower / sqrt(2)))
    ratio = density / above
    return mean + std * ratio, std * sqrt(max(1 + lower * ratio - ratio * ratio, 1e-6))
