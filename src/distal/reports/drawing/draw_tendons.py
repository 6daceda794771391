"""Tendons in a drawing: from the drive past a spring and the base to the joints, each with its
colour and dash.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from distal.reports.drawing.draw_joints import coil
from distal.reports.drawing.labels import label_of, rounded_label
from distal.reports.drawing.pose import Stand
from distal.reports.drawing.routes import WRAP, Wheel, route
from distal.reports.drawing.sensors import sensor_lines
from distal.reports.drawing.sheet import PITCH, SIZE, DrawnLine, Point, Sheet, width_of
from distal.results import COLOURS, DASHES, WHITE
from distal.rig import Linkage, Pinned, Rig, Tendon

BESIDE = 0.026
"""Distance between tendons that lie side by side on equal pulleys [in]. Source: layout."""

SPRING = 0.46
"""Length of a tendon's spring [in]. Source: layout."""


def wheels(rig: Rig, stands: Sequence[Stand], scale: float) -> list[list[Wheel]]:
    """Return for each tendon the circles and pins that it passes, from the base outwards [in].

    Args:
        scale: scale of the drawing [in/m].
    """
    names = rig.joint_names
    taken: dict[tuple[int, int, int], int] = {}
    past = []
    for tendon in rig.tendons:
        circles = []
        for meeting in tendon.meetings:
            for name, arm in meeting.arms({}).items():
                j = names.index(name)
                stand = stands[j]
                # a tendon that pulls counter-clockwise goes round clockwise on its way outwards
                way = -stand.turn if arm >= 0 else stand.turn
                wheel = Wheel(stand.centre, abs(arm) * scale, way)
                if isinstance(meeting.shape, Pinned):
                    wheel = Wheel(
                        wheel.point(0.0 if stand.parent is None else stands[stand.parent].towards)
                    )
                else:
                    key = (j, way, round(wheel.radius / BESIDE))
                    rank = taken[key] = taken.get(key, -1) + 1
                    wheel = replace(wheel, radius=wheel.radius + rank * BESIDE)
                circles.append(wheel)
        past.append(circles)
    return past


def tendon_lines(rig: Rig, tendon: Tendon) -> list[DrawnLine]:
    """Return the lines of text below a tendon: its sizes and sensors."""
    sizes = f"k {label_of(tendon.stiffness.value, 'N/m')}"
    if not tendon.pretension.absent:
        sizes += f", T₀ {label_of(tendon.pretension.value, 'N')}"
    if not tendon.slack.absent:
        sizes += f", slack {label_of(tendon.slack.value, 'm')}"
    lines = [DrawnLine(sizes)]
    if tendon.path is not None:
        kind = "sheath" if tendon.path.nodes else "guides"
        lines.append(
            DrawnLine(
                f"{kind} {label_of(tendon.path.wrap.value, 'rad')}, μ "
                f"{rounded_label(tendon.path.friction.value)}"
            )
        )
    return [*lines, *sensor_lines(rig, tendon)]


def draw_tendon(
    sheet: Sheet,
    rig: Rig,
    index: int,
    start: Wheel,
    level: tuple[Point, Point],
    eye: Point,
    past: Sequence[Wheel],
) -> None:
    """Draw a tendon with its spring, its name above it and its sizes below.

    Args:
        index: index of the tendon.
        start: the spool on which it is wound, or its end at a carriage.
        level: left and right end of its level part [in].
        eye: point at which it passes through the base [in].
        past: the circles and pins that it passes after the base.
    """
    tendon = rig.tendons[index]
    colour = COLOURS[index % len(COLOURS)]
    dash = DASHES[index % len(DASHES)]
    (left, y), (right, _) = level
    lines = tendon_lines(rig, tendon)
    middle = (left + right) / 2
    proximal = (middle - SPRING / 2, y)
    distal = (middle + SPRING / 2, y)  # ends of the spring
    wrap = 0.35 if isinstance(tendon.meetings[-1].shape, Linkage) else WRAP
    begin = route([start, Wheel((left, y))], 0.0)
    if start.radius:  # what is wound on the spool
        begin = [*(start.point(-start.way * 0.1 * k) for k in reversed(range(14))), *begin]
    end = [distal, (right, y), *route([Wheel(eye), *past], wrap)]
    for way in ([*begin, proximal], end):
        # a white edge shows which of two crossing tendons is in front
        sheet.line(way, WHITE, 2.8, zorder=3.9, solid_capstyle="butt")
        sheet.line(way, colour, 1.5, ls=dash, zorder=4.0)
    sheet.line(coil(proximal, distal), colour, 1.3, zorder=4.0)
    if tendon.path is not None and tendon.path.nodes:
        sheet.bar([(right - 0.1, y), (right, y), (eye[0] - 0.05, eye[1])], WHITE, 4.5, order=3.7)
    if past[-1].radius:
        sheet.disc(end[-1], 0.032, colour, colour, order=4.3)
    sheet.disc(eye, 0.028, WHITE, order=4.4)
    sheet.mark(lines, {"T": ((distal[0] + right) / 2, y)})
    sheet.write((middle, y + 0.135), tendon.name, bold=True, ha="center")
    for k, line in enumerate(lines):
        sheet.block((middle - line.width / 2, y - 0.135 - k * PITCH), [line])


def lane_room(rig: Rig) -> tuple[float, float]:
    """Return the width of the text on tendons, and the distance between neighbouring tendons
    [in].
    """
    blocks = [tendon_lines(rig, tendon) for tendon in rig.tendons]
    names = [width_of(tendon.name, SIZE, True) for tendon in rig.tendons]
    lines = [line.width for block in blocks for line in block]
    return max(*names, *lines, SPRING + 0.5), 0.22 + PITCH * (1 + max(map(len, blocks)))
