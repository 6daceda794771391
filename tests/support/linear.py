"""A linear rig and its textbook filter, written without the package's model: what filters must
equal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from distal import Log, Rig, load_rig
from distal.arrays import Floats


def linear_rig() -> Rig:
    """Pulleys, no friction, tendons always taut: everything is linear."""
    values: dict[str, object] = {"joints.0.friction": None}
    for i in range(2):
        values |= {
            f"drives.{i}.friction.load": {"value": 0.0, "std": 0.0},
            f"tendons.{i}.damping": 0.0,
        }
        values[f"tendons.{i}.pretension"] = 20.0
    return load_rig("pulley-antagonist").with_values(values)


@dataclass(frozen=True)
class LinearModel:
    """x⁺ = Φ x + G₀ u₀ + G₁ u₁ + c of the linear rig over one interval, u going from u₀ to u₁ in a
    straight line.
    """

    transition: Floats
    input_maps: tuple[Floats, Floats]
    constant: Floats


def linear_model(dt: float, count: int) -> LinearModel:
    """Return the linear rig's interval as matrices, from its constants."""
    k, r, pre = 806.0, 9.53e-3, 20.0
    inertias = np.array([4.239e-4, 1e-3, 1e-3])
    dampings = np.array([8e-3, 0.5, 0.5])
    arms = np.array([[-r, 1, 0], [r, 0, 1.0]])
    stiffness, bias = -k * arms.T @ arms, -arms.T @ np.array([pre, pre])
    h = dt / count

    def kick(length: float, along: float) -> Floats:
        a = np.exp(-dampings * length / inertias)
        b = (1 - a) / dampings
        pull = (b[:, None] * np.eye(3))[:, 1:]
        # acts on (q, v, u0, u1, 1)
        matrix = np.eye(11)
        blocks = [
            b[:, None] * stiffness,
            np.diag(a),
            (1 - along) * pull,
            along * pull,
            (b * bias)[:, None],
        ]
        matrix[3:6] = np.hstack(blocks)
        return matrix

    drift = np.eye(11)
    drift[:3, 3:6] = h * np.eye(3)
    total = drift @ kick(h / 2, 0.0)
    for i in range(1, count):
        total = drift @ kick(h, i / count) @ total
    total = kick(h / 2, 1.0) @ total
    return LinearModel(total[:6, :6], (total[:6, 6:8], total[:6, 8:10]), total[:6, 10])


def linear_log(seed: int = 0, n: int = 200) -> Log:
    """Return a made-up log of the linear rig: what is in it does not matter to the comparison."""
    rng = np.random.default_rng(seed)
    time = 0.01 * np.arange(n)
    pull = 3 + np.sin(2 * np.pi * 0.5 * time)
    channels = {
        "x1": 2e-3 * np.sin(3 * time) + rng.normal(0, 2e-5, n),
        "x2": -2e-3 * np.sin(3 * time) + rng.normal(0, 2e-5, n),
        "u1": 20 + pull + rng.normal(0, 0.2, n),
        "u2": 20 + 6 - pull + rng.normal(0, 0.2, n),
    }
    return Log(time, channels)
