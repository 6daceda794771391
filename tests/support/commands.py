"""Servos behind commands, and how often a joint then hunts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from distal import LiveInverse, Rig
from distal.arrays import Floats
from distal.inverse import Command, Feedback
from tests.support.servo_plants import PERIOD, Servos


def constant_parts(time: Floats, *references: Floats) -> list[tuple[int, int]]:
    """Return (begin, end), indices with the end excluded, of the parts of `time` in which all
    `references` are constant for at least 1 s.
    """
    moves = [np.abs(np.diff(reference)) > 1e-9 for reference in references]
    changes = np.flatnonzero(np.any(moves, axis=0)) + 1
    edges = [0, *changes.tolist(), len(time)]
    return [(a, b) for a, b in pairwise(edges) if b > a and time[b - 1] - time[a] >= 1.0]


GOES_THERE = 1.5
"""Of the way to the first command of a run [s]."""

LEAST_TENSION = 2.0

FOR, HUNTS = 2.0, float(np.deg2rad(0.3))
"""How long wanted angles rest [s] and by how much a joint then turns back [rad] where it hunts."""


def inextensible(rig: Rig, angles: Floats, positions: Floats) -> Floats:
    """Return the drives' places by lengths alone, from those at the first sample, (k, n_drives)."""
    found = np.tile(positions, (len(angles), 1))
    joints = [joint.name for joint in rig.joints]
    for d, drive in enumerate(rig.drives):
        own = [tendon for tendon in rig.tendons if tendon.drive == drive.name]
        drawn = np.zeros(len(angles))
        for name, arm in own[0].arms().items():
            angle = angles[:, joints.index(name)]
            shape = getattr(own[0], "insertion", None)
            if shape is not None and shape.kind == "pinned":
                r, length = shape.radius.value, shape.free_length.value
                drawn += (
                    np.sign(arm) * r * np.sin(angle)
                    + np.sqrt(length**2 - (r * (1 - np.cos(angle))) ** 2)
                    - length
                )
            else:
                drawn += arm * angle
        lever = 1.0 if drive.kind == "slider" else drive.radius.value * own[0].winding
        found[:, d] += (drawn - drawn[0]) / lever
    return found


def run(plant: Any, sent_positions: Floats) -> tuple[Floats, list[dict[str, float]]]:
    """Return true angles, (k, n_joints), and what was read, while places are sent one after the
    other.
    """
    servos = Servos(plant, getattr(plant, "errors", None))
    begin = plant.positions + servos.errors(plant.positions)
    for k in range(round(GOES_THERE / PERIOD)):
        share = min(1.0, (k + 1) * PERIOD / (GOES_THERE - 0.5))
        servos.step(begin + share * (sent_positions[0] - begin))
    angles, read = zip(*(servos.step(row) for row in sent_positions))
    return np.array(angles), list(read)


def driven(
    plant: Any,
    rig: Rig,
    desired: Floats,
    free: Sequence[int],
    start: Floats,
    law: Callable[..., Command | Floats],
) -> Floats:
    """Return true angles while a law (time, wanted, readings, true angles) says what is sent, from
    `start` on.

    A law that returns commands sends speeds, another one places.
    """
    servos = Servos(plant, getattr(plant, "errors", None))
    begin = plant.positions + servos.errors(plant.positions)
    angles, read = servos.step(begin)
    for k in range(round(GOES_THERE / PERIOD)):
        share = min(1.0, (k + 1) * PERIOD / (GOES_THERE - 0.5))
        angles, read = servos.step(begin + share * (start - begin))
    found = np.empty((len(desired), len(rig.joints)))
    for k, row in enumerate(desired):
        found[k] = angles
        said = law(k * PERIOD, row[list(free)], read, angles)
        if isinstance(said, Command) and not servos.speeds:
            servos = Servos(plant, servos.errors, speeds=True)
        angles, read = servos.step(said.speeds if isinstance(said, Command) else said)
    return found


def live_law(rig: Rig, feedback: Feedback, speeds: bool = False) -> Callable[..., Command | Floats]:
    """Return the live inverse as a law, of places or of speeds."""
    inverse = LiveInverse(rig, least_tension=LEAST_TENSION, feedback=feedback)

    def law(
        time: float, desired: Floats, read: dict[str, float], angles: Floats
    ) -> Command | Floats:
        command = inverse.step(time, desired, np.array([read[name] for name in inverse.channels]))
        return command if speeds else command.positions

    return law


def hunts(time: Floats, desired: Floats, angles: Floats) -> int:
    """Return the number of rests of the wanted angles in which a joint, after the first second,
    moves to and fro.
    """
    count = 0
    for begin, end in constant_parts(time, *desired.T):
        late = angles[begin + round(1.0 / PERIOD) : end]
        if time[end - 1] - time[begin] >= FOR and max(map(swings, late.T)) > 1:
            count += 1
    return count


def swings(angle: Floats) -> int:
    """Return how often an angle turns back by more than `HUNTS`."""
    count, way, farthest = 0, 0.0, float(angle[0])
    for value in angle.tolist():
        away = value - farthest
        if way * away > 0.0:
            farthest = value
        elif abs(away) > HUNTS:
            count, way, farthest = count + 1, float(np.sign(away)), value
    return count
