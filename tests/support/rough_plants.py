"""Rigs that are hardly known, four kinds of them, with plants of their own; no code of
`distal.model` is shared.

A user describes them by round numbers: arms to a third, stiffness and friction to a factor of two
to five. The plants have no inertia (`drawn_plants.balanced`); the rolling joint has its own
equilibrium. Calibration logs have the angles.

* "held": a wrist of three joints at 40 Hz with motor torques; in some logs only one drive moves.
* "stop and go": the same wrist read 2.4 times a second, no torques, more play; motions with long
  rests.
* "sheath": one joint, two tendons through a sheath that is bent otherwise in each log (0 to 270°),
  tensions, 40 Hz.
* "rolling": eight rolling segments that the user takes for one joint, two wires, another load in
  each log, 20 Hz.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from distal import Log
from distal.logs import FROM_SENSOR
from tests.support.drawn_plants import PARTS, at_rest, efforts, parameters_of
from tests.support.drawn_rigs import Raw

Floats = NDArray[np.float64]

KINDS = ("held", "stop and go", "sheath", "rolling")
FITTED, JUDGED = 4, 3
"""Logs with the angles for a fit, and logs that nothing has seen."""
DURATION = {"held": 30.0, "stop and go": 300.0, "sheath": 30.0, "rolling": 60.0}
RATE = {"held": 40.0, "stop and go": 2.4, "sheath": 40.0, "rolling": 20.0}
"""Length of a log [s] and samples a second."""
SEGMENTS, HALF_WIDTH = 8, 6e-3
"""Of the rolling joint: segments, and how far each wire runs from the middle [m]."""


@cache
def described(kind: str, seed: int) -> tuple[Raw, dict[str, float]]:
    """Return the description of a rig by its user, and the plant's numbers by path where it has
    them.
    """
    rng = np.random.default_rng([seed, 91, KINDS.index(kind)])
    return {"sheath": _sheath_rig, "rolling": _rolling_rig}.get(kind, _wrist_rig)(rng, kind)


@cache
def log_of(kind: str, seed: int, index: int) -> Log:
    """Return one of the logs of a plant: `FITTED` with angles as an encoder reads them, then
    `JUDGED` with true ones.
    """
    return _log(kind, *described(kind, seed), np.random.default_rng([seed, 92, index]), index)


def log_at(kind: str, seed: int, rate: float) -> Log:
    """Return the first judged log as it would be with another rate [Hz] of its sensors; the motion
    is the same.
    """
    raw, truth = described(kind, seed)
    return _log(kind, raw, truth, np.random.default_rng([seed, 92, FITTED]), FITTED, rate)


def _guessed(rng: np.random.Generator, true: float, factor: float) -> Raw:
    """Return what a user takes a number for: a round one, known to a factor."""
    guess = float(f"{true * factor ** (0.5 * np.clip(rng.normal(), -2.0, 2.0)):.1g}")
    return {"value": guess, "std": guess * 0.5 * (factor - 1.0 / factor) / 2.0}


class _Parameters:
    """True numbers by path as they are drawn, and what the user takes them for."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.truth = rng, dict[str, float]()

    def about(self, path: str, usual: float, factor: float) -> Raw:
        true = usual * float(np.exp(0.3 * self.rng.normal()))
        self.truth[path] = true
        return _guessed(self.rng, true, factor)

    def both(self, path: str, usual: float, factor: float, parts: float) -> Raw:
        """Return the same for two parts that the user takes for alike, and that differ by a
        share.
        """
        guess = self.about(path.format(0), usual, factor)
        self.truth[path.format(1)] = self.truth[path.format(0)] * float(
            np.exp(parts * self.rng.normal())
        )
        return guess


def _wrist_rig(rng: np.random.Generator, kind: str) -> tuple[Raw, dict[str, float]]:
    forces, n = kind == "held", _Parameters(rng)
    joints, drives, tendons, sensors = list[Raw](), list[Raw](), list[Raw](), list[Raw]()
    for j in range(3):
        friction = {
            "coefficient": n.about(
                f"joints.{j}.friction.coefficient", 0.12 if forces else 0.2, 4.0
            ),
            "radius": 3e-3,
        }
        joints.append(
            {
                "name": ("pitch", "yaw", "jaw")[j],
                "inertia": 2e-6,
                "damping": 3e-4,
                "friction": friction,
                "initial": {"value": 0.0, "std": np.deg2rad(10)},
            }
        )
        rubs = {"constant": n.about(f"drives.{j}.friction.constant", 3e-3, 4.0)}
        drives.append(
            {
                "name": f"motor{j}",
                "kind": "capstan",
                "inertia": 5e-6,
                "radius": 6e-3,
                "friction": rubs,
            }
        )
        # both cables of a pair lie on the same pulleys and are of one rope, which the user takes
        # for granted
        t, across = len(tendons), dict.fromkeys(range(j), 2.5e-3) | {j: 4.5e-3}
        arms = [n.about(f"tendons.{t}.crossings.{k}.radius", arm, 1.5) for k, arm in across.items()]
        stiffness = n.about(f"tendons.{t}.stiffness", 1.5e4 if forces else 8e3, 3.0)
        pretension = n.about(f"tendons.{t}.pretension", 8.0, 2.0)
        n.truth |= {
            path.replace(f".{t}.", f".{t + 1}.", 1): v
            for path, v in n.truth.items()
            if f"tendons.{t}." in path
        }
        for side in (1, -1):
            crossings = [
                {"joint": joints[k]["name"], "kind": "pulley", "radius": arm, "side": side}
                for k, arm in enumerate(arms)
            ]
            tendons.append(
                {
                    "name": f"{joints[j]['name']}_{'ab'[side < 0]}",
                    "drive": f"motor{j}",
                    "crossings": crossings,
                    "stiffness": stiffness,
                    "pretension": pretension,
                }
            )
        rate = RATE[kind]
        sensors.append(
            {
                "name": f"phi{j}",
                "measures": "position",
                "of": f"motor{j}",
                "rate": rate,
                "noise": 1e-3,
            }
        )
        if forces:
            sensors.append(
                {
                    "name": f"tau{j}",
                    "measures": "force",
                    "of": f"motor{j}",
                    "rate": rate,
                    "noise": 2e-3,
                }
            )
    return {
        "name": f"rough {kind}",
        "joints": joints,
        "drives": drives,
        "tendons": tendons,
        "sensors": sensors,
    }, n.truth


def _pair(n: _Parameters, kind: str, radius: float, stiffness: float, extra: Raw) -> Raw:
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
    n = _Parameters(rng)
    friction = n.both("tendons.{}.path.friction", 0.12, 3.0, 0.1)
    raw = _pair(
        n, kind, 8e-3, 4e3, {"path": {"friction": friction, "wrap": {"value": 2.4, "std": 1.5}}}
    )
    raw["joints"][0]["spring"] = {"stiffness": n.about("joints.0.spring.stiffness", 0.05, 2.0)}
    return raw, n.truth


def _rolling_rig(rng: np.random.Generator, kind: str) -> tuple[Raw, dict[str, float]]:
    n = _Parameters(rng)
    raw = _pair(n, kind, HALF_WIDTH, 6e3, {})
    raw["joints"][0]["external_torque"] = {"std": 0.03}
    return raw, n.truth


def _wishes(
    rng: np.random.Generator, kind: str, joints: int, held: int | None, rate: float
) -> Floats:
    """Return what angles the operator wishes, (PARTS k, joints) [rad]: ramps with rests; one joint
    alone in some logs.
    """
    rate, reach = PARTS * rate, 0.6 if joints > 1 else 0.7
    count = round(DURATION[kind] * rate)
    columns = []
    for j in range(joints):
        positions = [0.0]
        while len(positions) < count:
            aim, speed = rng.uniform(-reach, reach), rng.uniform(0.2, 0.8)
            steps = max(2, round(abs(aim - positions[-1]) / speed * rate))
            rest = rng.uniform(2.0, 6.0) if kind == "stop and go" else rng.uniform(0.1, 1.0)
            positions += [
                *np.linspace(positions[-1], aim, steps + 1)[1:],
                *[aim] * round(rest * rate),
            ]
        columns.append(np.array(positions[:count]) * (1.0 if held is None or j == held else 0.0))
    return np.column_stack(columns)


def _log(
    kind: str,
    raw: Raw,
    truth: dict[str, float],
    rng: np.random.Generator,
    index: int,
    rate: float | None = None,
) -> Log:
    rate = RATE[kind] if rate is None else rate
    joints = len(raw["joints"])
    held = (
        index if kind == "held" and index < joints else None
    )  # the first logs move one drive each
    wish = _wishes(rng, kind, joints, held, rate)
    if kind == "rolling":
        angles, positions, read = _rolling(truth, wish[:, 0], rng, RATE[kind] / rate)
    else:
        own = dict(truth)
        if kind == "sheath":
            own |= dict.fromkeys(
                [f"tendons.{t}.path.wrap" for t in (0, 1)], float(np.deg2rad(rng.uniform(0, 270)))
            )
        angles, positions, read = _balanced(raw, own, wish, rng, RATE[kind] / rate)
    calibrates = index < FITTED
    names = ["theta"] if joints == 1 else [f"theta_{joint['name']}" for joint in raw["joints"]]
    if calibrates:
        angles = angles + np.deg2rad(0.05) * rng.normal(size=angles.shape)
    values = {"position": positions, "force": read}
    channels = {}
    for kind_of, columns in values.items():
        for sensor, column in zip(
            [s for s in raw["sensors"] if s["measures"] == kind_of], columns.T
        ):
            channels[sensor["name"]] = column + sensor["noise"] * rng.normal(size=len(column))
    time, source = (
        np.arange(len(angles)) / rate,
        f"{kind} {'calibration' if calibrates else 'judged'} {index}",
    )
    return Log(
        time,
        channels,
        dict(zip(names, angles.T)),
        source,
        FROM_SENSOR if calibrates else "the plant",
    )


def _balanced(
    raw: Raw, truth: dict[str, float], wish: Floats, rng: np.random.Generator, pace: float
) -> tuple[Floats, Floats, Floats]:
    """Return angles (k, j), places and efforts (k, d); drives go where stiff tendons would bring
    the joints to the wish.
    """
    made = parameters_of(raw, truth)
    p = {name: value[None] for name, value in made.items()}
    levers, arms = made["levers"], made["arms"]
    lengths = wish @ arms.T
    if levers.shape[1] == levers.shape[0]:  # each its own drive: some tension beside
        beats = 1.0 + 0.4 * np.sin(
            2 * np.pi * rng.uniform(0.05, 0.2) * pace * np.arange(len(wish)) / (PARTS * 40.0)
        )
        lengths = lengths + (8.0 / made["stiffness"]) * beats[:, None]
    positions = lengths @ np.linalg.pinv(levers).T
    angles, tensions = at_rest(p, (positions @ levers.T)[:, None, :], np.zeros(1, dtype=np.intp))
    p["mass"] = 0.0 * p["mass"]
    silent = not any(one["measures"] == "force" for one in raw["sensors"])
    read = positions[:0] if silent else efforts(p, positions[::PARTS][:, None, :], tensions)[:, 0]
    return angles[:, 0], positions[::PARTS], read


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
