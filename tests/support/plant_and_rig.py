"""Simulated logs of a rig whose plant differs from its description."""

from __future__ import annotations

from typing import Any

import numpy as np

from distal import Log, Rig, load_rig, simulate
from tests.support.cases import WINDOW, scenario

FREE = ("tendons.*.stiffness", "joints.0.friction.coefficient", "joints.0.damping")

KINDS = ("ramps", "weights", "servo")


def start_rig() -> Rig:
    """Return the paper's rig in a wide window; its preload is known, so that friction has one
    unknown.
    """
    return load_rig("paper-2008-printed").with_values(
        {**WINDOW, "joints.0.friction.preload.std": 0.0}
    )


def drawn_plant(seed: int) -> tuple[dict[str, Any], tuple[float, float, float]]:
    """Return a plant within ±10 % in k, ±20 % in μ and ±30 % in b, and these three."""
    rng = np.random.default_rng([seed, 44])
    k = 806.0 * (1 + 0.1 * rng.uniform(-1, 1))
    mu = 0.5 * (1 + 0.2 * rng.uniform(-1, 1))
    b = 8e-3 * (1 + 0.3 * rng.uniform(-1, 1))
    names = (
        "tendons.0.stiffness",
        "tendons.1.stiffness",
        "joints.0.friction.coefficient",
        "joints.0.damping",
    )
    return dict(zip(names, (k, k, mu, b))), (k, mu, b)


def logs_of(
    rig: Rig,
    plant: dict[str, Any],
    seed: int,
    kinds: tuple[str, ...] = KINDS,
    duration: float = 10.0,
) -> list[Log]:
    """Return a log of each kind of scenario, drawn from a seed."""
    logs = []
    for i, kind in enumerate(kinds):
        drawn = scenario(kind, "as the rig", 100 * seed + i)
        named = drawn.model_copy(
            update={"plant": plant, "duration": duration, "name": f"{kind} {seed}"}
        )
        logs.append(simulate(rig, named, 100 * seed + i))
    return logs


def without_truth(log: Log) -> Log:
    """Return the log as one has it without an encoder."""
    channels = {name: values for name, values in log.channels.items() if name != "encoder"}
    return Log(log.time, channels, {}, log.source)
