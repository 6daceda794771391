"""A plant of one link between two position-controlled tendons, with one of the parts that real rigs
have.

It shares no code with `distal.model`: RK4 at 0.1 ms (0.5 ms with a cable) in NumPy; creep as a
differential equation; a sheath as a cable of many points (`tests/support/cable.py`); backlash by
cases.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, pi, sin, sqrt
from typing import Any

import numpy as np

from distal import Log
from distal.arrays import Floats
from tests.support.cable import Cable

RADIUS, STIFFNESS, INERTIA, DAMPING = 0.01, 2000.0, 2e-4, 6e-3
RATE, STEP, STEP_WITH_CABLE = 100.0, 1e-4, 5e-4


def part_of(values: Mapping[str, Any], path: str) -> dict[str, float]:
    """Return the numbers below a path of a mapping of paths to numbers or tables."""
    found: dict[str, float] = {}
    for key, value in values.items():
        if key == path:
            found.update(value)
        elif key.startswith(path + "."):
            found[key.removeprefix(path + ".")] = value
    return found


def springs_torque(values: Mapping[str, Any], angle: float) -> float:
    """Return the springs' torque on the joint [N m]."""
    spring, total = part_of(values, "joints.0.spring"), 0.0
    if spring:
        total -= (
            spring["stiffness"] * angle
            + spring.get("quadratic", 0) * angle**2
            + spring.get("cubic", 0) * angle**3
        )
    between = part_of(values, "joints.0.extension_spring")
    if between:
        x, r, far = angle - between["line_angle"], between["radius"], between["distance"]
        length = sqrt((r * cos(x) - far) ** 2 + (r * sin(x)) ** 2)
        force = max(
            between["preload"] + between["stiffness"] * (length - between["free_length"]), 0.0
        )
        total -= force * r * far * sin(x) / length
    return total


class Link:
    """The plant: what is inside it, and the forces that follow."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        self.values = values
        self.slack = float(values.get("tendons.0.slack", 0.0))
        self.creep = part_of(values, "tendons.0.creep")
        self.gap = part_of(values, "drives.0.backlash")
        self.joint_gap = part_of(values, "joints.0.backlash").get("width", 0.0)
        sheath = part_of(values, "tendons.0.path")
        sheath.pop("nodes", None)
        self.cable = Cable(STIFFNESS, **sheath) if sheath else None
        self.far_side: float | None = None

    def tensions(
        self, left: float, right: float, angle: float, crept: float
    ) -> tuple[float, float, float]:
        """Return the tensions at the left joint's end, the left drive's end, and of the right
        tendon.
        """
        pulley = self.pulley(left, right, angle)
        other = STIFFNESS * max(right + RADIUS * pulley, 0.0)
        if self.cable is not None:
            at_drive, at_joint = self.cable.tensions(left, RADIUS * pulley)
            return at_joint, at_drive, other
        own = STIFFNESS * max(left - RADIUS * pulley - self.slack - crept, 0.0)
        return own, own, other

    def pulley(self, left: float, right: float, angle: float) -> float:
        """Return the angle of the pulley; both tendons are taut where the joint has backlash."""
        if self.joint_gap == 0.0:
            return angle
        free = (left - right) / (2 * RADIUS)
        return min(max(free, angle - self.joint_gap / 2), angle + self.joint_gap / 2)

    def settle(self, left: float, right: float, angle: float) -> float:
        """Move what is inside to where the left drive and the joint are; return the left tendon's
        end.
        """
        if self.gap:
            half = self.gap["width"] / 2
            far = left if self.far_side is None else self.far_side
            if not self.gap.get("held", True):
                # its tendon draws the far side back until friction holds it
                pull = STIFFNESS * max(far - RADIUS * angle, 0.0)
                far -= max(pull - self.gap["friction"], 0.0) / STIFFNESS
            self.far_side = left = min(max(far, left - half), left + half)
        return left


def link_log(
    values: Mapping[str, Any],
    noise: Mapping[str, float],
    rng: np.random.Generator,
    duration: float,
    source: str,
) -> Log:
    """Return a log of the plant with sensors' noise and its true angle."""
    plant = Link(values)
    phase, fast = rng.uniform(0, 2 * pi, 2), rng.uniform(0.2, 0.5, 2)
    middle = (2.5e-3 if plant.joint_gap else 1e-3) + plant.slack / 2
    viscous = float(values.get("drives.0.damping", 0.0))

    def positions(t: float) -> tuple[float, float]:
        turn = RADIUS * (
            0.45 * sin(2 * pi * fast[0] * t + phase[0]) + 0.2 * sin(2 * pi * fast[1] * t + phase[1])
        )
        both = middle * (1 + 0.5 * sin(2 * pi * 0.3 * t + phase[1]))
        return both + turn + plant.slack / 2, both - turn

    def rates(left: float, right: float, y: Floats) -> Floats:
        own, at_drive, other = plant.tensions(left, right, y[0], y[2])
        torque = RADIUS * (own - other) + springs_torque(values, y[0]) - DAMPING * y[1]
        slow = 0.0
        if plant.creep:
            slow = (plant.creep["share"] * at_drive / STIFFNESS - y[2]) / plant.creep["time"]
        return np.array([y[1], torque / INERTIA, slow])

    step = STEP if plant.cable is None else STEP_WITH_CABLE
    every = round(1 / RATE / step)
    y, rows = np.zeros(3), []
    # it settles before the log begins
    for k in range(-round(1.0 / step), round(duration / step)):
        t = max(k, 0) * step
        left, right = positions(t)
        end = plant.settle(left, right, y[0])
        if plant.cable is not None:
            plant.cable.settle(end, RADIUS * y[0])
        if k == 0:
            y[2] = 0.0  # a load that has just come
        if k >= 0 and k % every == 0:
            _, at_drive, other = plant.tensions(end, right, y[0], y[2])
            speed = (positions(t + step)[0] - left) / step
            rows.append([t, left, right, at_drive + viscous * speed, other, y[0]])
        later = t + (step if k >= 0 else 0.0)
        ends = [
            (end, right),
            *(
                ((end if plant.gap else positions(s)[0]), positions(s)[1])
                for s in ((t + later) / 2, later)
            ),
        ]
        a = rates(*ends[0], y)
        b = rates(*ends[1], y + step / 2 * a)
        c = rates(*ends[1], y + step / 2 * b)
        d = rates(*ends[2], y + step * c)
        y = y + step / 6 * (a + 2 * b + 2 * c + d)
    time, x1, x2, u1, u2, angle = np.array(rows).T
    clean = {"x1": x1, "x2": x2, "u1": u1, "u2": u2}
    channels = {
        name: each + noise[name] * rng.normal(size=len(time)) for name, each in clean.items()
    }
    return Log(time, channels, {"theta": angle}, source, "the plant")
