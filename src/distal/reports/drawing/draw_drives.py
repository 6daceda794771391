"""Drives in a drawing: a motor with its spool, or a slider on its rail, in a column to the left of
the joints.

In all functions, `lines` is the text beside a drive, whose badges are repeated on the drawn drive.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from math import pi

from distal.reports.drawing.labels import label_of, rounded_label
from distal.reports.drawing.sensors import sensor_lines, sensors_of_part
from distal.reports.drawing.sheet import BADGE, DrawnLine, Point, Sheet, arc
from distal.results import FAINT, INK, PALE, SOFT, WHITE
from distal.rig import Capstan, Rig, Slider

RAIL = 1.1
"""Length of a slider's rail with the motor at its end [in]. Source: layout."""

HALF = 0.12
"""Half the length of a slider's carriage [in]. Source: layout."""

TRAVEL = 0.4
"""Longest distance between a slider's stops in the drawing [in]; longer ones are drawn to another
scale. Source: layout.
"""


def drive_lines(rig: Rig, drive: Slider | Capstan) -> list[DrawnLine]:
    """Return the lines of text beside a drive: its name, sizes and sensors."""
    lines = [DrawnLine(drive.name, bold=True)]
    unit = "m"
    if isinstance(drive, Capstan):
        unit = "rad"
        lines.append(DrawnLine(f"spool r {label_of(drive.radius.value, 'm')}"))
        gears = {getattr(sensor, "gear", 1.0) for sensor in sensors_of_part(rig, drive)} - {1.0}
        lines += [DrawnLine(f"gear {rounded_label(gear)} : 1") for gear in sorted(gears)]
    if drive.stops is not None:
        lines.append(DrawnLine(f"stops {' … '.join(label_of(stop, unit) for stop in drive.stops)}"))
    if drive.backlash is not None:
        lines.append(DrawnLine(f"backlash {label_of(drive.backlash.width.value, unit)}"))
    return [*lines, *sensor_lines(rig, drive)]


def draw_capstan(
    sheet: Sheet, drive: Capstan, lines: Sequence[DrawnLine], at: Point, scale: float, way: int
) -> None:
    """Draw a motor with its spool, seen along the shaft.

    Args:
        at: centre of the spool [in].
        scale: scale of the drawing [in/m].
        way: +1 where a positive angle turns counter-clockwise on paper, −1 where it turns
            clockwise.
    """
    from matplotlib.patches import FancyBboxPatch

    half = motor_half(drive, scale)
    x, y = at
    body = FancyBboxPatch(
        (x - half + 0.04, y - half + 0.04),
        2 * half - 0.08,
        2 * half - 0.08,
        boxstyle="round,pad=0.04",
        facecolor=FAINT,
        edgecolor=INK,
        lw=0.9,
        zorder=1.5,
    )
    sheet.patch(body, (x - half, y - half), (x + half, y + half))
    for a, b in product((-1, 1), repeat=2):
        sheet.disc((x + a * (half - 0.055), y + b * (half - 0.055)), 0.018, WHITE, SOFT, order=1.6)
    sheet.disc(at, scale * drive.radius.value, PALE, order=2.0)
    sheet.disc(at, 0.03, INK, order=2.2)
    sheet.mark(lines, {"φ": at, "τ": (x - half, y - half)})
    sheet.arrow(arc(at, half + 0.1, pi - 0.5 * way, pi + 0.5 * way), SOFT)
    sheet.write((x - half - 0.17, y), "+φ", colour=SOFT, ha="right")


def motor_half(drive: Capstan, scale: float) -> float:
    """Return half the side of a motor's flange [in].

    Args:
        scale: scale of the drawing [in/m].
    """
    return max(1.15 * scale * drive.radius.value, 0.2)


def draw_slider(
    sheet: Sheet,
    drive: Slider,
    lines: Sequence[DrawnLine],
    right: Point,
    lanes: Sequence[float],
    scale: float,
) -> float:
    """Draw a carriage on its rail, pulled from the left; return the horizontal position at which
    its tendons begin [in].

    Args:
        right: right end of the rail [in].
        lanes: heights of the tendons [in].
        scale: scale of the drawing [in/m].
    """
    x, y = right
    left = x - RAIL
    low, high = drive.stops or (0.0, 0.0)
    factor = min(scale, TRAVEL / (high - low)) if drive.stops else 0.0
    # positive is away from the joint; without stops the carriage stands in the middle of its rail
    zero = x - HALF - 0.06 - factor * max(-low, 0.0) if drive.stops else x - 0.45
    up = max(max(lanes) - y, 0.0) + 0.1
    for edge in (-0.035, 0.035):
        sheet.line([(left, y + edge), (x, y + edge)], SOFT, 0.8, zorder=1.5)
    sheet.box((left, y - 0.15), (left + 0.2, y + 0.15), FAINT, 1.7)
    sheet.line([(left + 0.2, y), (zero - HALF, y)], INK, 2.0, zorder=1.8)
    sheet.box((zero - HALF, y - up), (zero + HALF, y + up), PALE, 2.5)
    if drive.stops:
        for edge, side in ((zero - factor * high - HALF, -1), (zero - factor * low + HALF, 1)):
            start, end = sorted((edge, edge + 0.05 * side))
            sheet.box((start, y - 0.1), (end, y + 0.1), INK, 2.4)
    sheet.mark(lines, {"U": (left + 0.2, y), "x": (zero, y - up)})
    sheet.arrow([(zero + 0.05, y + up + 0.07), (zero - 0.2, y + up + 0.07)], SOFT)
    sheet.write((zero - 0.28, y + up + 0.07), "+x", colour=SOFT, ha="right")
    return zero + HALF


def glyph_width(rig: Rig, scale: float) -> float:
    """Return the width of the column of drives without the text beside them [in].

    Args:
        scale: scale of the drawing [in/m].
    """
    return max(
        2 * motor_half(d, scale) + 0.45 if isinstance(d, Capstan) else RAIL + BADGE
        for d in rig.drives
    )
