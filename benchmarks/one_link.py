"""A plant of one link between two position-controlled tendons, with one of the parts that real rigs have.

It shares no code with `distal.model`: RK4 at 0.1 ms (0.5 ms with a cable) in NumPy; creep as a differential equation; a sheath as a cable of
`POINTS` massless points, solved by an active set at every stage; backlash by cases.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, exp, pi, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

from distal import Log

Floats = NDArray[np.float64]

RADIUS, STIFFNESS, INERTIA, DAMPING = 0.01, 2000.0, 2e-4, 6e-3
RATE, STEP, STEP_WITH_CABLE = 100.0, 1e-4, 5e-4
POINTS = 16
"""Points of a cable."""


def part_of(values: Mapping[str, Any], path: str) -> dict[str, float]:
    """Return the numbers below a path of a mapping of paths to numbers or tables."""
    found: dict[str, float] = {}
    for key, value in values.items():
        if key == path:
            found.update(value)
        elif key.startswith(path + "."):
            found[key.removeprefix(path + ".")] = value
    return found


class Cable:
    """A cable of many points in a sheath; tension is in every stretch, at most e^{±μβ/N} from the next."""

    def __init__(self, friction: float, wrap: float, let_out: float = 1.0, nodes: int = 0) -> None:
        self.drawn, self.out = exp(friction * wrap / POINTS), exp(friction * wrap * let_out / POINTS)
        self.springs = np.array([2 * POINTS, *[POINTS] * (POINTS - 1), 2 * POINTS]) * STIFFNESS
        self.points: Any = None

    def settle(self, drive: float, joint: float) -> None:
        """Let the points slide, and keep where they come to rest."""
        self.points, self.sliding = self.settled(drive, joint)

    def settled(self, drive: float, joint: float) -> tuple[Floats, Any]:
        """Return where the points come to rest: no two stretches differ by more than friction holds; an active set."""
        n, springs = POINTS, self.springs
        if self.points is None:
            self.points, self.sliding = drive + (joint - drive) * (np.arange(n) + 0.5) / n, np.zeros(n, dtype=int)
        sliding = self.sliding
        for _ in range(60):
            # a point is held where it was, drawn in (near = e far), or let out (far = e near)
            slack = drive <= joint
            near = np.where(sliding == 0, 0.0, np.where((sliding > 0) | slack, 1.0, self.out)) * springs[:-1]
            far = np.where(sliding == 0, 0.0, np.where((sliding < 0) | slack, 1.0, self.drawn)) * springs[1:]
            own = np.where(sliding == 0, 1.0, near + far)
            right = np.where(sliding == 0, self.points, 0.0)
            right[0] += near[0] * drive
            right[-1] += far[-1] * joint
            bands = np.zeros((3, n))
            bands[0, 1:], bands[1], bands[2, :-1] = -far[:-1], own, -near[1:]
            moved = solve_banded((1, 1), bands, right, check_finite=False)
            line = np.concatenate([[drive], moved, [joint]])
            pulls = springs * (line[:-1] - line[1:])
            wanted = np.where(pulls[:-1] > self.drawn * pulls[1:] + 1e-9, 1, 0)
            wanted = np.where(pulls[1:] > self.out * pulls[:-1] + 1e-9, -1, wanted)
            wanted = np.where(sliding == 0, wanted, sliding)
            # what would slide back is held
            wanted = np.where((sliding * (moved - self.points) < -1e-12) & (sliding != 0), 0, wanted)
            if np.array_equal(wanted, sliding):
                break
            sliding = wanted
        return moved, sliding

    def tensions(self, drive: float, joint: float) -> tuple[float, float]:
        """Return the tensions at the drive and at the joint."""
        points, _ = self.settled(drive, joint)
        return max(float(self.springs[0] * (drive - points[0])), 0.0), max(float(self.springs[-1] * (points[-1] - joint)), 0.0)


def springs_torque(values: Mapping[str, Any], angle: float) -> float:
    """Return the springs' torque on the joint [N m]."""
    spring, total = part_of(values, "joints.0.spring"), 0.0
    if spring:
        total -= spring["stiffness"] * angle + spring.get("quadratic", 0) * angle**2 + spring.get("cubic", 0) * angle**3
    between = part_of(values, "joints.0.extension_spring")
    if between:
        x, r, far = angle - between["line_angle"], between["radius"], between["distance"]
        length = sqrt((r * cos(x) - far) ** 2 + (r * sin(x)) ** 2)
        force = max(between["preload"] + between["stiffness"] * (length - between["free_length"]), 0.0)
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
        self.cable = Cable(**sheath) if sheath else None
        self.far_side: float | None = None

    def tensions(self, left: float, right: float, angle: float, crept: float) -> tuple[float, float, float]:
        """Return the tensions at the left joint's end, the left drive's end, and of the right tendon."""
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
        """Move what is inside to where the left drive and the joint are; return the left tendon's end."""
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
    values: Mapping[str, Any], noise: Mapping[str, float], rng: np.random.Generator, duration: float, source: str
) -> Log:
    """Return a log of the plant with sensors' noise and its true angle."""
    plant = Link(values)
    phase, fast = rng.uniform(0, 2 * pi, 2), rng.uniform(0.2, 0.5, 2)
    middle = (2.5e-3 if plant.joint_gap else 1e-3) + plant.slack / 2
    viscous = float(values.get("drives.0.damping", 0.0))

    def places(t: float) -> tuple[float, float]:
        turn = RADIUS * (0.45 * sin(2 * pi * fast[0] * t + phase[0]) + 0.2 * sin(2 * pi * fast[1] * t + phase[1]))
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
        left, right = places(t)
        end = plant.settle(left, right, y[0])
        if plant.cable is not None:
            plant.cable.settle(end, RADIUS * y[0])
        if k == 0:
            y[2] = 0.0  # a load that has just come
        if k >= 0 and k % every == 0:
            own, at_drive, other = plant.tensions(end, right, y[0], y[2])
            speed = (places(t + step)[0] - left) / step
            rows.append([t, left, right, at_drive + viscous * speed, other, y[0]])
        later = t + (step if k >= 0 else 0.0)
        ends = [(end, right), *(((end if plant.gap else places(s)[0]), places(s)[1]) for s in ((t + later) / 2, later))]
        a = rates(*ends[0], y)
        b = rates(*ends[1], y + step / 2 * a)
        c = rates(*ends[1], y + step / 2 * b)
        d = rates(*ends[2], y + step * c)
        y = y + step / 6 * (a + 2 * b + 2 * c + d)
    time, x1, x2, u1, u2, angle = np.array(rows).T
    clean = {"x1": x1, "x2": x2, "u1": u1, "u2": u2}
    channels = {name: each + noise[name] * rng.normal(size=len(time)) for name, each in clean.items()}
    return Log(time, channels, {"theta": angle}, source, "the plant")
