"""Rigs that are hardly known, with plants of their own; no code of `distal.model` is shared.

A user describes them by round numbers: arms to a third, stiffness and friction to a factor of two
to five. The plants have no inertia (`drawn_plants.balanced`). Calibration logs have the angles.

* "held": a wrist of three joints at 40 Hz with motor torques; in some logs only one drive moves.
* "stop and go": the same wrist read 2.4 times a second, no torques, more play; motions with long
  rests.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from distal import Log
from distal.arrays import Floats
from distal.logs import FROM_SENSOR
from tests.support.drawn_plants import PARTS, at_rest, efforts, parameters_of
from tests.support.drawn_rigs import Raw

KINDS = ("held", "stop and go", "sheath", "rolling")
FITTED, JUDGED = 4, 3
"""Logs with the angles for a fit, and logs that nothing has seen."""
DURATION = {"held": 30.0, "stop and go": 300.0, "sheath": 30.0, "rolling": 60.0}
RATE = {"held": 40.0, "stop and go": 2.4, "sheath": 40.0, "rolling": 20.0}
"""Length of a log [s] and samples a second."""


def drawn(kind: str, seed: int) -> np.random.Generator:
    """Return what the numbers of a rig are drawn from."""
    return np.random.default_rng([seed, 91, KINDS.index(kind)])


@cache
def described(kind: str, seed: int) -> tuple[Raw, dict[str, float]]:
    """Return the description of a wrist by its user, and the plant's numbers by path where it has
    them.
    """
    return wrist_rig(drawn(kind, seed), kind)


@cache
def log_of(kind: str, seed: int, index: int) -> Log:
    """Return one of the logs of a wrist: `FITTED` with angles as an encoder reads them, then
    `JUDGED` with true ones.
    """
    raw, truth = described(kind, seed)
    rng = np.random.default_rng([seed, 92, index])
    return logged(kind, raw, rng, index, lambda wish: balanced(raw, truth, wish, rng))


def guess(rng: np.random.Generator, true: float, factor: float) -> Raw:
    """Return what a user takes a number for: a round one, known to a factor."""
    guess = float(f"{true * factor ** (0.5 * np.clip(rng.normal(), -2.0, 2.0)):.1g}")
    return {"value": guess, "std": guess * 0.5 * (factor - 1.0 / factor) / 2.0}


class Parameters:
    """True numbers by path as they are drawn, and what the user takes them for."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.truth = rng, dict[str, float]()

    def about(self, path: str, usual: float, factor: float) -> Raw:
        true = usual * float(np.exp(0.3 * self.rng.normal()))
        self.truth[path] = true
        return guess(self.rng, true, factor)

    def both(self, path: str, usual: float, factor: float, parts: float) -> Raw:
        """Return the same for two parts that the user takes for alike, and that differ by a
        share.
        """
        guess = self.about(path.format(0), usual, factor)
        self.truth[path.format(1)] = self.truth[path.format(0)] * float(
            np.exp(parts * self.rng.normal())
        )
        return guess


def wrist_rig(rng: np.random.Generator, kind: str) -> tuple[Raw, dict[str, float]]:
    forces, n = kind == "held", Parameters(rng)
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


def wishes(
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


def logged(
    kind: str,
    raw: Raw,
    rng: np.random.Generator,
    index: int,
    moved: Callable[[Floats], tuple[Floats, Floats, Floats]],
    rate: float | None = None,
) -> Log:
    """Return a log of what `moved` makes of wished angles: angles, places and efforts."""
    rate, joints = RATE[kind] if rate is None else rate, len(raw["joints"])
    # the first logs move one drive each
    held = index if kind == "held" and index < joints else None
    angles, positions, read = moved(wishes(rng, kind, joints, held, rate))
    calibrates = index < FITTED
    names = ["theta"] if joints == 1 else [f"theta_{joint['name']}" for joint in raw["joints"]]
    if calibrates:
        angles = angles + np.deg2rad(0.05) * rng.normal(size=angles.shape)
    channels = {}
    for measured, columns in {"position": positions, "force": read}.items():
        sensors = [sensor for sensor in raw["sensors"] if sensor["measures"] == measured]
        for sensor, column in zip(sensors, columns.T):
            channels[sensor["name"]] = column + sensor["noise"] * rng.normal(size=len(column))
    return Log(
        np.arange(len(angles)) / rate,
        channels,
        dict(zip(names, angles.T)),
        f"{kind} {'calibration' if calibrates else 'judged'} {index}",
        FROM_SENSOR if calibrates else "the plant",
    )


def balanced(
    raw: Raw, truth: dict[str, float], wish: Floats, rng: np.random.Generator, pace: float = 1.0
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
