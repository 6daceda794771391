"""The route of a tendon past pulleys: straight lines that touch circles, and arcs between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import asin, atan2, cos, hypot, pi, sin

from distal.reports.drawing.sheet import Point

WRAP = 1.0
"""Angle over which a tendon lies on its last pulley [rad]. Source: layout."""


@dataclass(frozen=True)
class Wheel:
    """A circle that a tendon passes, or a point.

    Args:
        centre: centre of the circle.
        radius: radius of the circle, zero for a point.
        way: direction in which the tendon goes round on its way outwards, +1 counter-clockwise, −1
            clockwise; its pull turns the wheel the other way.
    """

    centre: Point
    radius: float = 0.0
    way: int = 1

    def point(self, heading: float) -> Point:
        """Return the point at which a straight tendon with a `heading` [rad] touches the wheel."""
        arm = self.way * self.radius
        return self.centre[0] + arm * sin(heading), self.centre[1] - arm * cos(heading)


def route_heading(first: Wheel, last: Wheel) -> float:
    """Return the direction of the straight line that leaves one wheel and touches the next one
    [rad].
    """
    across = last.centre[0] - first.centre[0]
    up = last.centre[1] - first.centre[1]
    apart = hypot(across, up)
    if apart == 0.0:
        return 0.0
    # circles of which one lies in the other have no such line: the nearest direction is taken
    ratio = (first.way * first.radius - last.way * last.radius) / apart
    return atan2(up, across) + asin(min(max(ratio, -1.0), 1.0))


def route(wheels: Sequence[Wheel], wrap: float) -> list[Point]:
    """Return the points of a tendon's route past at least two wheels.

    Args:
        wrap: angle over which the tendon lies on the last wheel [rad].
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
