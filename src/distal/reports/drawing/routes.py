"""The way of a tendon past pulleys: straight lines that touch circles, and arcs between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import asin, atan2, cos, hypot, pi, sin

from distal.reports.drawing.sheet import Point

WRAP = 1.0
"""How far a tendon lies on the last pulley before it is fixed [rad]."""


@dataclass(frozen=True)
class Wheel:
    """A circle that a tendon goes round, from the drive outwards.

    Args:
        radius: zero for a point.
        way: +1 counter-clockwise, −1 clockwise, the way outwards; the tendon pulls it the other way
            round.
    """

    centre: Point
    radius: float = 0.0
    way: int = 1

    def point(self, heading: float) -> Point:
        """Return where a tendon that heads in some direction [rad] touches it."""
        arm = self.way * self.radius
        return self.centre[0] + arm * sin(heading), self.centre[1] - arm * cos(heading)


def route_heading(first: Wheel, last: Wheel) -> float:
    """Return the direction of the straight line that leaves one circle and meets the next one
    [rad].
    """
    across = last.centre[0] - first.centre[0]
    up = last.centre[1] - first.centre[1]
    apart = hypot(across, up)
    if apart == 0.0:
        return 0.0
    # circles that lie in one another have no such line: then the nearest to it
    ratio = (first.way * first.radius - last.way * last.radius) / apart
    return atan2(up, across) + asin(min(max(ratio, -1.0), 1.0))


def route(wheels: Sequence[Wheel], wrap: float) -> list[Point]:
    """Return the points of a tendon's way past at least two circles; on the last one it ends after
    some wrap [rad].
    """
    headings = [route_heading(first, last) for first, last in pairwise(wheels)]
    points = [wheels[0].point(headings[0])]
    for k, (wheel, arrives) in enumerate(zip(wheels[1:], headings)):
        last = k == len(headings) - 1
        turned = (
            wheel.way * wrap * (wheel.radius > 0.0) if last else _turn(headings[k + 1] - arrives)
        )
        count = 1 + int(abs(turned) / 0.08)
        points += [wheel.point(arrives + turned * step / count) for step in range(count + 1)]
    return points


def _turn(angle: float) -> float:
    """Return an angle as the shortest turn, from −π to π."""
    return (angle + pi) % (2 * pi) - pi
