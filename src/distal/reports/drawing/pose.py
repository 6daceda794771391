"""Where the joints of a rig stand in a drawing: in the zero pose, each joint seen along its own
axis.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan2, cos, hypot, pi, sin

import numpy as np

from distal.arrays import Floats
from distal.reports.drawing.sheet import Point
from distal.rig import Joint, Rig

APART = 3.4
"""Distance between joints that would stand at one point [largest moment arms]. Source: layout."""

STUB = 2.6
"""Length of a link that the rig does not describe [largest moment arms]. Source: layout."""


@dataclass(frozen=True)
class Stand:
    """Where a joint stands on paper, in metres, or in inches after `scaled`; x points right, y up.

    Args:
        centre: position of the joint's axis.
        turn: +1 where a positive angle turns counter-clockwise on paper, −1 where it turns
            clockwise.
        parent: index of the joint on whose link it sits, None for the base.
        drawn_apart: whether it is drawn away from its position because another joint stands there.
        towards: direction of its link at zero angle [rad].
        reach: length of its link.
        mass_at: position of the centre of mass, None where the rig does not give it.
        described: whether the rig describes the link.
    """

    centre: Point
    turn: int
    parent: int | None
    drawn_apart: bool
    towards: float
    reach: float
    mass_at: Point | None
    described: bool

    @property
    def tip(self) -> Point:
        """Position of the end of the joint's link."""
        return self.centre[0] + self.reach * cos(self.towards), self.centre[1] + self.reach * sin(
            self.towards
        )

    def scaled(self, scale: float) -> Stand:
        """Return the stand with its lengths multiplied by `scale`."""
        centre = scale * self.centre[0], scale * self.centre[1]
        mass_at = (
            None if self.mass_at is None else (scale * self.mass_at[0], scale * self.mass_at[1])
        )
        return replace(self, centre=centre, mass_at=mass_at, reach=scale * self.reach)


View = tuple[Floats, Floats, int]
"""Unit vector that points right on paper, unit vector that points up, and +1 where a positive angle
turns counter-clockwise (−1 where clockwise).
"""


def views_of(rig: Rig) -> list[View]:
    """Return for each joint the view along its axis.

    Joints with parallel axes are seen from the same side. The others are seen so that +θ turns as
    at the first joint; a tendon that stays on one side of all joints then does so on paper, too.
    """
    views: list[View] = []
    for joint in rig.joints:
        right, up, turn = view_along(joint.axis)
        desired = views[0][2] if views else turn
        for parallel, view in zip(rig.joints, views):
            along = float(np.asarray(parallel.axis) @ np.asarray(joint.axis))
            if abs(along) > 0.99:
                desired = view[2] * (1 if along > 0 else -1)
                break
        views.append((right, up * desired * turn, desired))
    return views


def view_along(axis: tuple[float, float, float]) -> View:
    """Return the view along an axis, given as a unit vector; for the axis y, x points right, z
    points up and +θ turns clockwise.
    """
    a = np.asarray(axis)
    right = np.array([1.0, 0.0, 0.0]) - a[0] * a
    if float(np.linalg.norm(right)) < 0.3:
        right = np.array([0.0, 1.0, 0.0]) - a[1] * a
    right = right / np.linalg.norm(right)
    up = np.cross(a, right)
    points_up = up[2] if abs(up[2]) > 1e-6 else up[1]
    turn = 1 if points_up > 0 else -1
    return right, turn * up, turn


def stands(rig: Rig, arm: float) -> list[Stand]:
    """Return where the joints stand on paper, in metres.

    Args:
        arm: largest moment arm [m], by which undescribed lengths are chosen.
    """
    views = views_of(rig)
    centres: list[Point] = []
    apart: list[bool] = []
    for i, joint in enumerate(rig.joints):
        parent = rig.parent_of(i)
        if parent is None:
            offset = np.asarray(joint.offset) - np.asarray(rig.joints[0].offset)
            position = float(offset @ views[0][0]), float(offset @ views[0][1])
        else:
            across, up = _on_paper(np.asarray(joint.offset), views[parent])
            position = centres[parent][0] + across, centres[parent][1] + up
        moved = False
        near = 0.3 if parent is not None else 2.0
        while any(hypot(position[0] - x, position[1] - y) < near * arm for x, y in centres):
            # joints on the base are moved down, joints on a link outwards
            position = (
                (position[0] + APART * arm, position[1])
                if parent is not None
                else (position[0], position[1] - APART * arm)
            )
            moved = True
        centres.append(position)
        apart.append(moved)
    placed = []
    for i, joint in enumerate(rig.joints):
        towards, reach, mass_at, described = _link(joint, centres[i], views[i], arm)
        child = next((k for k in range(len(rig.joints)) if rig.parent_of(k) == i), None)
        if child is not None:
            across = centres[child][0] - centres[i][0]
            up = centres[child][1] - centres[i][1]
            towards = atan2(up, across)
            reach = hypot(across, up)
        placed.append(
            Stand(
                centres[i],
                views[i][2],
                rig.parent_of(i),
                apart[i],
                towards,
                reach,
                mass_at,
                described,
            )
        )
    return placed


def _on_paper(vector: Floats, view: View) -> Point:
    """Return a vector as seen on paper; a vector that points mostly towards the reader is drawn to
    the right at its full length.
    """
    across = float(vector @ view[0])
    up = float(vector @ view[1])
    length = float(np.linalg.norm(vector))
    return (across, up) if hypot(across, up) > 0.5 * length else (length, 0.0)


def _link(
    joint: Joint, centre: Point, view: View, arm: float
) -> tuple[float, float, Point | None, bool]:
    """Return direction and length of a joint's link, its centre of mass, and whether the rig
    describes it.
    """
    if joint.link is not None:
        across, up = _on_paper(np.asarray(joint.link.centre), view)
        if hypot(across, up) > 0.0:
            return (
                atan2(up, across),
                2.0 * hypot(across, up),
                (centre[0] + across, centre[1] + up),
                True,
            )
    elif joint.gravity is not None and joint.gravity.distance.value > 0.0:
        # at its hanging angle the centre of mass is straight below
        towards = -pi / 2 - view[2] * joint.gravity.hanging_angle.value
        length = joint.gravity.distance.value
        at = (centre[0] + length * cos(towards), centre[1] + length * sin(towards))
        return towards, max(1.4 * length, 1.5 * arm), at, True
    return 0.0, STUB * arm, None, False


def gravity_on_paper(rig: Rig) -> tuple[Floats, float] | None:
    """Return the direction of free fall on paper, (right, up, towards the reader), and its size
    [m/s²].

    The result is None where the rig has no weight.
    """
    if any(joint.gravity is not None for joint in rig.joints):
        return np.array([0.0, -1.0, 0.0]), 9.80665
    pull = np.asarray(rig.base.gravity)
    size = float(np.linalg.norm(pull))
    if size == 0.0 or not any(
        joint.link is not None and joint.link.mass.value > 0.0 for joint in rig.joints
    ):
        return None
    for k, angle in reversed(list(enumerate(rig.base.orientation))):
        # the base is turned by roll, pitch and yaw about the world's axes; gravity is turned back
        # by these angles, the last one first
        i = (k + 1) % 3
        j = (k + 2) % 3
        c = cos(angle)
        s = sin(angle)
        pull = pull.copy()
        pull[i], pull[j] = c * pull[i] + s * pull[j], c * pull[j] - s * pull[i]
    right, up, _ = view_along(rig.joints[0].axis)
    return np.array([pull @ right, pull @ up, pull @ np.cross(right, up)]) / size, size
