"""Rigs in which one kind of state at a time is uncertain, and short made-up logs that go through
every branch.

The logs need not be good physics: twin and filter must agree on any numbers. They move, rest, turn
and stick.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import numpy as np

from distal import Rig, load_rig
from distal.arrays import Floats
from distal.rig import build_rig

CERTAIN = {
    "joints.0.friction.coefficient": {"value": 0.3, "std": 0.0},
    "sensors.x1.linearity": 0.0,
    "sensors.x2.linearity": 0.0,
    "drives.*.friction.load": {"value": 0.002, "std": 0.0},
    "tendons.*.stiffness": {"value": 806.0, "std": 0.0},
    "tendons.*.pretension": 2.0,
}
"""Values of `pulley-antagonist` with which nothing but the joint's motion is uncertain."""

ROUGH = {
    "tendons.0.insertion.radius": {"value": 9.53e-3, "std": 3e-3},
    "tendons.0.stiffness": {"value": 806.0, "std": 600.0},
    "joints.0.friction.coefficient": {"value": 0.3, "std": 0.2, "drift": 0.05},
}
ROUGH_CAPSTAN = {
    "drives.0.radius": {"value": 8e-3, "std": 2e-3},
    "joints.0.friction.coefficient": {"value": 0.15, "std": 0.1},
}
TORQUE = {"joints.0.external_torque": {"std": 0.02, "correlation_time": 0.3}}
FACTORS = {
    "tendons.*.stiffness": {"value": 806.0, "shared": {"name": "spool", "std": 0.1}},
    "tendons.*.damping": {"value": 0.2, "std": 0.3, "drift": 0.05},
}
SHARED = {
    "tendons.0.stiffness": {
        "value": 806.0,
        "std": 40.0,
        "drift": 2.0,
        "shared": {"name": "spool", "std": 0.1},
    },
    "tendons.1.stiffness": {"value": 806.0, "drift": 3.0, "shared": {"name": "spool", "std": 0.1}},
    "joints.0.friction.preload": {"value": 1.0, "std": 0.1, "shared": {"name": "axle", "std": 0.2}},
    "joints.0.friction.coefficient": {"value": 0.3, "shared": {"name": "axle", "std": 0.2}},
}
PARAMETERS = {
    "joints.0.friction": {
        "coefficient": {"value": 0.3, "std": 0.2},
        "radius": 3e-3,
        "preload": {"value": 1.0, "std": 0.5, "drift": 0.2},
        "stribeck": {"excess": {"value": 0.3, "std": 0.1}, "speed": 0.5},
    },
    "joints.0.spring": {
        "stiffness": {"value": 0.05, "std": 0.02},
        "rest_angle": {"value": -0.1, "std": 0.2},
    },
    "joints.0.gravity": {
        "mass": {"value": 0.08, "std": 0.01},
        "distance": 0.015,
        "hanging_angle": {"value": 0.1, "std": 0.1, "drift": 0.05},
    },
    "joints.0.stops": [-0.1, 0.25],
    "joints.0.stop_stiffness": {"value": 1.0, "std": 0.1},
    "tendons.0.insertion.radius": {"value": 9.53e-3, "std": 1e-4},
    "tendons.1.stiffening": {"value": 20.0, "std": 10.0},
    "tendons.1.pretension": {"value": 2.0, "std": 0.3},
}
LINEARITY = {
    "sensors.x1.linearity": 1e-4,
    "sensors.x1.bias": {"value": 1e-4, "std": 5e-5},
    "sensors.x2.bias": {"value": -1e-4, "std": 5e-5},
    "drives.0.stops": [-4e-3, 8e-3],
    "drives.1.nominal_force": 3.0,
}
BIASES = {
    "sensors.u1.bias": {"value": 0.1, "std": 0.3, "drift": 0.1},
    "sensors.u2.linearity": 0.2,
    "sensors.t1.bias": {"value": -0.1, "std": 0.2, "drift": 0.05},
    "sensors.encoder.bias": {"value": 0.02, "std": 0.01, "drift": 0.02},
}
DECLARED = {
    "drives.0.friction": {
        "constant": {"value": 0.1, "std": 0.05},
        "load": {"value": 0.05, "std": 0.02},
    },
    "drives.1.friction": {
        "constant": {"value": 0.15, "std": 0.1},
        "load": 0.03,
        "stribeck": {"excess": 0.4, "speed": 0.01},
    },
    "drives.0.damping": {"value": 0.5, "std": 0.2},
}
PATH = {
    "tendons.0.path": {
        "friction": {"value": 0.5, "std": 0.05},
        "wrap": {"value": 2.0, "std": 0.1},
    },
    "tendons.1.path": {
        "friction": 0.4,
        "wrap": {"value": 2.2, "std": 0.1},
    },
}
"""μβ is 1 and 0.88: drawing a tendon in takes 2.7 and 2.2 times as much of its tension as letting
it out gives back.
"""

LINKAGE = {
    "tendons.0.insertion": {
        "kind": "linkage",
        "radius": 9.53e-3,
        "centre": 0.1,
        "slope": {"value": 0.3, "std": 0.05},
        "curvature": {"value": 0.4, "std": 0.05},
    },
    "tendons.1.insertion": {
        "kind": "pinned",
        "radius": 9.53e-3,
        "free_length": {"value": 0.2, "std": 1e-3},
    },
}
NEAR_STOPS = {
    "drives.*.stops": [-0.85e-3, 2.75e-3],
    "sensors.x1.linearity": 1e-4,
    "sensors.x2.linearity": 1e-4,
}
"""The slow ramp of `motion` passes these stops, 6 µm per sample."""

STOPS = {"drives.*.stops": [-1.5e-3, 3.5e-3]}


def sliders(*changes: Mapping[str, object], without: tuple[str, ...] = ()) -> Rig:
    """Return two sliders on a pulley with sensors x1, u1, x2, u2, t1 (a tension) and encoder, less
    those in `without`.
    """
    raw = load_rig("pulley-antagonist").model_dump()
    sensors = [
        *(s for s in raw["sensors"] if s["name"] != "encoder"),
        {"name": "t1", "measures": "tension", "of": "left", "noise": 0.15},
        {"name": "encoder", "measures": "angle", "of": "link", "noise": 5e-3, "resolution": 0.01},
    ]
    raw["sensors"] = [s for s in sensors if s["name"] not in (without or ("t1", "encoder"))]
    values: dict[str, Any] = {}
    for change in (CERTAIN, *changes):
        values |= deepcopy(change)
    kept = {s["name"] for s in raw["sensors"]}
    values = {
        k: v for k, v in values.items() if not k.startswith("sensors.") or k.split(".")[1] in kept
    }
    return build_rig(raw, "two sliders").with_values(values)


HYSTERESIS = {
    "drives.0.hysteresis": {
        "constant": 0.02,
        "load": 0.05,
        "slope": {"value": -0.2, "std": 0.05},
    },
    "drives.0.friction": {"constant": 0.0, "load": 0.0},
}


def capstan(*changes: Mapping[str, object]) -> Rig:
    """Return a motor that winds both tendons of a joint; nothing but the joint's motion is
    uncertain.
    """
    values: dict[str, Any] = {
        "joints.0.friction.coefficient": {"value": 0.15, "std": 0.0},
        "drives.0.friction.constant": {"value": 0.02, "std": 0.0},
        "drives.0.friction.load": {"value": 0.05, "std": 0.0},
        "tendons.*.stiffness": {"value": 2.3e4, "std": 0.0},
        "tendons.*.pretension": {"value": 20.0, "std": 0.0},
    }
    for change in changes:
        values |= deepcopy(change)
    return load_rig("capstan-joint").with_values(values)


ORDER = ("position", "tension", "force", "angle")
"""In which order estimators read what is measured."""

# ---- logs
# ------------------------------------------------------------------------------------------


def stamps(n: int, interval: float, rng: np.random.Generator) -> Floats:
    """Return irregular stamps, ±15 % of the interval."""
    return 0.3 + np.cumsum(interval * rng.uniform(0.85, 1.15, n))


def motion(time: Floats) -> Floats:
    """Return a motion between −1 and 1 in three parts of 0.4 s: to and fro, at rest, and a slow
    ramp; then again.
    """
    part = np.mod(time - time[0], 1.2)
    swing = np.sin(2 * np.pi * np.minimum(part, 0.4) / 0.32)
    return np.where(part < 0.8, swing, 1.0 + 0.4 * (part - 0.8))


def slider_log(rig: Rig, n: int = 120, rest: int | None = None) -> tuple[Floats, Floats]:
    """Return stamps and samples of a rig of `sliders`, in the order in which estimators read them;
    from the sample `rest` on nothing moves.
    """
    rng, amplitude = np.random.default_rng(0), 1.6e-3
    time = stamps(n, 0.01, rng)
    way = motion(time)
    if rest is not None:
        way[rest:] = way[rest]
    rate = np.gradient(way, time)
    rate[np.abs(rate) < 0.3] = 0.0
    theta = 0.8 * amplitude * way / 9.53e-3
    pulls = [3.0 + 1.2 * way, 3.0 - 0.8 * way]
    found = {
        "x1": 1e-3 + amplitude * way,
        "x2": 1e-3 - amplitude * way,
        "u1": pulls[0] * (1 + 0.15 * np.sign(rate)),
        "u2": pulls[1] * (1 - 0.15 * np.sign(rate)),
        "t1": pulls[0],
        "encoder": theta,
    }
    sensors = [s for measured in ORDER for s in rig.sensors_of(measured)]
    return time, np.column_stack([found[s.name] + s.noise * rng.normal(size=n) for s in sensors])


def capstan_log(rig: Rig) -> tuple[Floats, Floats]:
    """Return stamps and samples of `capstan` rigs: motor angle, torque, and the reference."""
    rng, n = np.random.default_rng(1), 160
    time = stamps(n, 0.005, rng)
    way = motion(2 * (time - time[0]))
    noise = [s.noise for s in rig.sensors[:2]]
    angle = 0.3 * way + noise[0] * rng.normal(size=n)
    torque = 0.08 * way + 0.03 * np.sign(np.gradient(way)) + noise[1] * rng.normal(size=n)
    columns = [angle, torque, 0.18 * way + 2e-3 * rng.normal(size=n)]
    return time, np.column_stack(columns[: 2 + len(rig.sensors_of("angle"))])


def spoiled(samples: Floats, positions: int, size: float) -> Floats:
    """Return the samples with wild, missing and lost values: see the comments.

    Args:
        samples: (n, n_channels).
        positions: how many channels, the first ones, are displacements.
        size: of a wild value, in ranges of its channel.
    """
    rng = np.random.default_rng(2)
    spoilt = samples.copy()
    n, width = samples.shape
    for column in range(width):
        for row in rng.choice(np.arange(5, n - 5), 4, replace=False):
            spoilt[row, column] += rng.choice([-1, 1]) * size * np.ptp(samples[:, column])
    spoilt[rng.uniform(size=samples.shape) < 0.3] = np.nan
    # a drive that is lost for 12 samples, so that its joint follows
    spoilt[n // 2 : n // 2 + 12, 0] = np.nan
    # a real jump: the reading after a wild one agrees with it
    spoilt[n // 4 - 2 : n // 4 + 3, :positions] = samples[n // 4 - 2 : n // 4 + 3, :positions]
    spoilt[n // 4 :, 0] += 0.3 * size * np.ptp(samples[:, 0])
    return spoilt


def with_gap(time: Floats) -> Floats:
    """Return the stamps with a gap before each of two rows."""
    shifted = time.copy()
    for row in (30, 70):
        shifted[row:] += 0.065
    return shifted
