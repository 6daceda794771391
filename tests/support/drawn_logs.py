"""Logs of the plants in `drawn_plants`: those to fit a rig to, and those to judge it on."""

from __future__ import annotations

import numpy as np

from distal import Log
from distal.arrays import Floats
from distal.logs import FROM_SENSOR
from tests.support.drawn_plants import (
    PARTS,
    STEP,
    identified,
    nudged,
    parameters_of,
    ramps,
    simulated,
)
from tests.support.drawn_rigs import RATE, WIDER, Drawn

FITTED, JUDGED = 3, 3
"""Logs that a rig is fitted to; logs that it is judged on, the last of the wider motion."""

FASTER = 1.3
"""How fast that is, beside the others."""


def positions_of(rig: Drawn, wish: Floats, level: Floats) -> Floats:
    """Return where drives go, (k, d), so that the rig as described would have these angles and this
    share of its tension.

    Args:
        rig: the rig.
        wish: angles [rad], (k, j).
        level: share of the usual tension, where tendons pull against each other, (k,).
    """
    p = parameters_of(rig.raw, {})
    own = [np.flatnonzero(column) for column in p["levers"].T]
    single = np.array([len(tendons) == 1 for tendons in own])
    lever = np.array([p["levers"][tendons[0], d] for d, tendons in enumerate(own)])
    arms = np.array([p["arms"][tendons[0]] for tendons in own])
    stiffness = np.array([p["stiffness"][tendons].sum() for tendons in own])
    taut = np.where(single, [p["taut"][tendons[0]] for tendons in own], 0.0)
    torque = p["spring"] * (wish - p["rest"]) + p["weight"] * np.sin(wish - p["hanging"])
    against = single - arms @ np.linalg.pinv(arms) @ single  # tensions that turn no joint
    against = against / against[single].mean() if np.abs(against).max() > 1e-6 else 0.0 * against
    pulls = torque @ np.linalg.pinv(arms) + rig.tension * np.outer(level, against)
    pulls = np.where(single, np.maximum(pulls, 0.05 * rig.tension), pulls)
    positions: Floats = (wish @ arms.T + pulls / stiffness - taut) / lever
    return positions


def drives_alone(rig: Drawn, positions: Floats) -> Floats:
    """Return where drives go, (k, d), whose second half has each drive move alone in turn.

    A drive whose tendon pulls against others goes to and fro by half of what the usual tension
    stretches it; another one by half of what the joints reach.
    """
    p = parameters_of(rig.raw, {})
    count, drives = positions.shape
    part = count // (2 * drives)
    wave = np.sin(2 * np.pi * np.arange(part) / part)
    moved = positions.copy()
    moved[count - part * drives :] = positions[count - part * drives]
    for d, levers in enumerate(p["levers"].T):
        own = np.flatnonzero(levers)
        opposed = len(own) == 1 and not rig.kind.startswith("spring")
        reached = rig.reach.min() * np.abs(p["arms"][own[0]]).max()
        stretch = rig.tension / p["stiffness"][own[0]] if opposed else reached
        begin = count - part * (drives - d)
        moved[begin : begin + part, d] += 0.5 * stretch / levers[own[0]] * wave
    return moved


def logs_of(rig: Drawn, seed: int, alone: bool = False) -> tuple[list[Log], dict[str, float]]:
    """Return the logs of a rig, those to fit first, and by number the share of its std that these
    logs leave; in one of those to fit, each drive may move `alone` once.
    """
    rate, count = 1.0 / STEP if rig.inert else PARTS * RATE, FITTED + JUDGED
    rngs, moves = [np.random.default_rng([seed, log, 72]) for log in range(count)], []
    for log, rng in enumerate(rngs):
        wide, fast = (WIDER, FASTER) if log == count - 1 else (1.0, 1.0)
        pressed = rig.pressed if log < FITTED else 0.0 * rig.pressed
        wish = np.column_stack(
            [ramps(rng, wide * a, fast, rate, b) for a, b in zip(rig.reach, pressed)]
        )
        wave = 2.0 * np.pi * (rng.uniform(0.05, 0.2) * np.arange(len(wish)) / rate + rng.uniform())
        positions = positions_of(rig, wish, 1.0 + 0.35 * np.sin(wave))
        moves.append(drives_alone(rig, positions) if alone and log == FITTED - 1 else positions)
    positions, others = np.stack(moves, axis=1), nudged(rig.raw, rig.truth)
    of = [range(count), *[range(FITTED)] * len(others)]
    runs = simulated(rig.raw, [rig.truth, *others], of, positions, rig.inert)
    every, joints, logs = round(rate / RATE), [joint["name"] for joint in rig.raw["joints"]], []
    names = ["theta"] if len(joints) == 1 else [f"theta_{joint}" for joint in joints]
    for log, (rng, (angles, efforts)) in enumerate(zip(rngs, runs[0])):
        calibrates, said = log < FITTED, "outside" if log == count - 1 else "motion"
        exact = {
            "position": positions[::every, log],
            "force": efforts,
            "angle": angles + rig.offsets,
        }
        read: dict[str, dict[str, Floats]] = {kind: {} for kind in exact}
        for sensor in rig.raw["sensors"]:
            own, step = read[sensor["measures"]], sensor.get("resolution", 0.0)
            column = exact[sensor["measures"]][:, len(own)]
            column = column + sensor["noise"] * rng.normal(size=len(column))
            own[sensor["name"]] = step * np.round(column / step) if step else column
        truth = dict(zip(names, read["angle"].values() if calibrates else angles.T))
        source = f"drawn {seed}, {'calibration' if calibrates else said} {log}"
        channels = {**read["position"], **read["force"]}
        logs.append(
            Log(
                np.arange(len(angles)) / RATE,
                channels,
                truth,
                source,
                FROM_SENSOR if calibrates else "the plant",
            )
        )
    return logs, identified(rig.raw, runs[1:])
