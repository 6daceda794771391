"""A cable in its sheath as a plant: massless points between springs, solved by an active set; no
code of `distal.model`.
"""

from __future__ import annotations

from math import exp
from typing import Any

import numpy as np
from scipy.linalg.lapack import dgtsv

from distal.arrays import Floats

POINTS = 16
"""Points of a cable."""


class Cable:
    """A cable of many points in a sheath; tension is in every stretch, at most e^{±μβ/N} from the
    next.
    """

    def __init__(
        self, stiffness: float, friction: float, wrap: float, let_out: float = 1.0
    ) -> None:
        self.drawn, self.out = (
            exp(friction * wrap / POINTS),
            exp(friction * wrap * let_out / POINTS),
        )
        self.springs = np.array([2 * POINTS, *[POINTS] * (POINTS - 1), 2 * POINTS]) * stiffness
        self.points: Any = None

    def settle(self, drive: float, joint: float) -> None:
        """Let the points slide, and keep where they come to rest."""
        self.points, self.sliding = self.settled(drive, joint)

    def settled(self, drive: float, joint: float) -> tuple[Floats, Any]:
        """Return where the points come to rest: no two stretches differ by more than friction
        holds; an active set.
        """
        n, springs = POINTS, self.springs
        if self.points is None:
            self.points, self.sliding = (
                drive + (joint - drive) * (np.arange(n) + 0.5) / n,
                np.zeros(n, dtype=int),
            )
        sliding = self.sliding
        for _ in range(60):
            # a point is held where it was, drawn in (near = e far), or let out (far = e near)
            slack = drive <= joint
            near = (
                np.where(sliding == 0, 0.0, np.where((sliding > 0) | slack, 1.0, self.out))
                * springs[:-1]
            )
            far = (
                np.where(sliding == 0, 0.0, np.where((sliding < 0) | slack, 1.0, self.drawn))
                * springs[1:]
            )
            own = np.where(sliding == 0, 1.0, near + far)
            right = np.where(sliding == 0, self.points, 0.0)
            right[0] += near[0] * drive
            right[-1] += far[-1] * joint
            *_, moved, _ = dgtsv(-near[1:], own, -far[:-1], right)
            line = np.concatenate([[drive], moved, [joint]])
            pulls = springs * (line[:-1] - line[1:])
            desired = np.where(pulls[:-1] > self.drawn * pulls[1:] + 1e-9, 1, 0)
            desired = np.where(pulls[1:] > self.out * pulls[:-1] + 1e-9, -1, desired)
            desired = np.where(sliding == 0, desired, sliding)
            # what would slide back is held
            desired = np.where(
                (sliding * (moved - self.points) < -1e-12) & (sliding != 0), 0, desired
            )
            if np.array_equal(desired, sliding):
                break
            sliding = desired
        return moved, sliding

    def tensions(self, drive: float, joint: float) -> tuple[float, float]:
        """Return the tensions at the drive and at the joint."""
        points, _ = self.settled(drive, joint)
        return max(float(self.springs[0] * (drive - points[0])), 0.0), max(
            float(self.springs[-1] * (points[-1] - joint)), 0.0
        )
