"""Rigs that are hardly known, of all kinds: those of `tests/support/rough_plants`, and two more.

* "sheath": one joint, two tendons through a sheath that is bent otherwise in each log (0 to 270°),
  tensions, 40 Hz.
* "rolling": eight rolling segments that the user takes for one joint, two wires, another load in
  each log, 20 Hz; it has its own equilibrium.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from tests.support.drawn_plants import PARTS
from tests.support.drawn_rigs import Raw
from tests.support.rough_plants import (
    FITTED,
    RATE,
    Parameters,
    balanced,
    drawn,
    logged,
    wrist_rig,
)

from distal import Log

Floats = NDArray[np.float64]

SEGMENTS, HALF_WIDTH = 8, 6e-3
"""Of the rolling joint: segments, and how far each wire runs from the middle [m]."""


@cache
def described(kind: str, seed: int) -> tuple[Raw, dict[str, float]]:
    """Return the description of a rig by its user, and the plant's numbers by path where it has
    them.
    """
    rig = {"sheath": _sheath_rig, "rolling": _rolling_rig}.get(kind, wrist_rig)
    return rig(drawn(kind, seed), kind)


@cache
def log_of(kind: str, seed: int, index: int) -> Log:
    """Return one of the logs of a plant: `FITTED` with angles as an encoder reads them, then
    `JUDGED` with true ones.
    """
    return _log(kind, seed, index)


def log_at(kind: str, seed: int, rate: float) -> Log:
    """Return the first judged log as it would be with another rate [Hz] of its sensors; the motion
    is the same.
    """
    return _log(kind, seed, FITTED, rate)


def _log(kind: str, seed: int, index: int, rate: float | None = None) -> Log:
    raw, truth = described(kind, seed)
    rng = np.random.default_rng([seed, 92, index])
    pace = 1.0 if rate is None else RATE[kind] / rate

    def moved(wish: Floats) -> tuple[Floats, Floats, Floats]:
        if kind == "rolling":
            return _rolling(truth, wish[:, 0], rng, pace)
        own = dict(truth)
        if kind == "sheath":
            bent = float(np.deg2rad(rng.uniform(0, 270)))
            own |= dict.fromkeys([f"tendons.{t}.path.wrap" for t in (0, 1)], bent)
        return balanced(raw, own, wish, rng, pace)

    return logged(kind, raw, rng, index, moved, rate)


def _pair(n: Parameters, kind: str, radius: float, stiffness: float, extra: Raw) -> Raw:
    """Return one joint between two tendons, each with its own slider and load cell."""
    tendons, drives, sensors, rate = list[Raw](), list[Raw](), list[Raw](), RATE[kind]
    arm = n.both("tendons.{}.insertion.radius", radius, 1.5, 0.03)
    spring = n.both("tendons.{}.stiffness", stiffness, 4.0, 0.1)
    for t, side in enumerate((1, -1)):
        drives.append({"name": f"slider{t}", "kind": "slider", "mass": 0.02})
        tendons.append(
            {
                "name": f"wire{t}",
                "joint": "joint",
                "drive": f"slider{t}",
                "side": side,
                "insertion": {"kind": "pulley", "radius": arm},
                "stiffness": spring,
                **extra,
            }
        )
        sensors.append(
            {
                "name": f"x{t}",
                "measures": "position",
                "of": f"slider{t}",
                "rate": rate,
                "noise": 2e-5,
            }
        )
        sensors.append(
            {"name": f"u{t}", "measures": "force", "of": f"slider{t}", "rate": rate, "noise": 0.1}
        )
    joint = {
        "name": "joint",
        "inertia": 2e-5,
        "damping": 1e-3,
        "initial": {"value": 0.0, "std": np.deg2rad(15)},
        "friction": {
            "coefficient": n.about("joints.0.friction.coefficient", 0.15, 4.0),
            "radius": 3e-3,
        },
    }
    return {
        "name": f"rough {kind}",
        "joints": [joint],
        "drives": drives,
        "tendons": tendons,
        "sensors": sensors,
    }


def _sheath_rig(rng: np.random.Generator, kind: str) -> tuple[Raw, dict[str, float]]:
    n = Parameters(rng)
    friction = n.both("tendons.{}.path.friction", 0.12, 3.0, 0.1)
    raw = _pair(
        n, kind, 8e-3, 4e3, {"path": {"friction": friction, "wrap": {"value": 2.4, "std": 1.5}}}
    )
    raw["joints"][0]["spring"] = {"stiffness": n.about("joints.0.spring.stiffness", 0.05, 2.0)}
    return raw, n.truth


def _rolling_rig(rng: np.random.Generator, kind: str) -> tuple[Raw, dict[str, float]]:
    n = Parameters(rng)
    raw = _pair(n, kind, HALF_WIDTH, 6e3, {})
    raw["joints"][0]["external_torque"] = {"std": 0.03}
    return raw, n.truth


def _rolling(
    truth: dict[str, float], wish: Floats, rng: np.random.Generator, pace: float
) -> tuple[Floats, Floats, Floats]:
    """Return the same for eight segments that roll on one another: wires of both sides lose and
    gain length unlike.

    A wire a beside the middle loses 2 a sin(θ/2N) + 2 h (1 − cos(θ/2N)) a contact, h the segments'
    half height.
    """
    a, h, n = HALF_WIDTH, 1.2 * HALF_WIDTH, SEGMENTS
    stiffness, load = [truth[f"tendons.{t}.stiffness"] for t in (0, 1)], rng.uniform(-0.03, 0.03)
    friction = 0.02 * truth["joints.0.friction.coefficient"] / 0.15

    def lost(side: float, q: float) -> tuple[float, float]:
        half = q / (2 * n)
        return side * 2 * a * np.sin(half) + 2 * h * (1 - np.cos(half)), side * a * np.cos(
            half
        ) / n + h * np.sin(half) / n

    def shape(side: float, q: float) -> tuple[float, float]:
        length, slope = lost(side, q)
        return n * length, n * slope

    squeeze = 6.0 + 2.0 * np.sin(2 * np.pi * 0.05 * pace * np.arange(len(wish)) / (PARTS * 20.0))
    positions = np.array(
        [
            [shape(s, w)[0] + t / k for s, k in zip((1, -1), stiffness)]
            for w, t in zip(wish, squeeze)
        ]
    )
    q, angles, pulls = float(wish[0]), np.empty(len(wish)), np.empty((len(wish), 2))
    for i, ends in enumerate(positions):
        for _ in range(30):
            lengths = [shape(s, q) for s in (1, -1)]
            tension = [
                k * max(x - length, 0.0) for k, x, (length, _) in zip(stiffness, ends, lengths)
            ]
            torque = sum(t * slope for t, (_, slope) in zip(tension, lengths)) + load * np.cos(q)
            limit = friction * a * sum(tension)
            left = torque - np.clip(torque, -limit, limit)
            if abs(left) < 1e-9:
                break
            q += left / (sum(k * slope**2 for k, (_, slope) in zip(stiffness, lengths)) + 1e-3)
        angles[i], pulls[i] = q, tension
    return angles[::PARTS, None], positions[::PARTS], pulls[::PARTS]
