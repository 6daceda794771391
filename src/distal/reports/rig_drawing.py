"""A drawing of a rig to scale: drives, tendons, pulleys, links, springs, stops and sensors, with
their sizes.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from math import dist, log10
from typing import TYPE_CHECKING

import numpy as np

from distal.arrays import Floats
from distal.reports.drawing.arms import changing_arms, draw_curves, draw_table, table_width
from distal.reports.drawing.draw_drives import (
    draw_capstan,
    draw_slider,
    drive_lines,
    glyph_width,
    motor_half,
)
from distal.reports.drawing.draw_joints import (
    draw_coupling,
    draw_joint,
    draw_link,
    draw_pin,
    joint_lines,
)
from distal.reports.drawing.draw_tendons import draw_tendon, lane_room, wheels
from distal.reports.drawing.labels import label_of
from distal.reports.drawing.pose import Stand, gravity_on_paper, stands
from distal.reports.drawing.routes import Wheel
from distal.reports.drawing.sheet import PITCH, SIZE, DrawnLine, Point, Sheet, width_of
from distal.reports.page import svg_of
from distal.results import FAINT, INK, PALE, SOFT
from distal.rig import Capstan, Pinned, Rig

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FAN = 0.6
"""Width of the region in which tendons spread from their level parts to their heights at the base
[in]. Source: layout.
"""

PANEL = (2.6, 1.2)
"""Width and height of the axes for moment arms that change [in]. Source: layout."""


def draw_rig(rig: Rig) -> Figure:
    """Return a drawing of a rig in its zero pose.

    Joints, pulleys and spools are to scale, tendons are shortened. Each joint is seen along its own
    axis.
    """
    sheet = Sheet()
    arms = np.array([[t.arms().get(joint.name, 0.0) for joint in rig.joints] for t in rig.tendons])
    largest = float(np.abs(arms).max()) or max(tendon.total_arm for tendon in rig.tendons) or 1e-2
    placed = stands(rig, largest)
    scale = _scale(rig, placed, largest)
    placed = [stand.scaled(scale) for stand in placed]
    past = wheels(rig, placed, scale)
    around = [_around(past, stand) for stand in placed]
    base = -around[0] - 0.3
    lines = [joint_lines(rig, j, stand.turn) for j, stand in enumerate(placed)]
    _draw_base(sheet, placed, past, base)
    for j, stand in enumerate(placed):
        draw_link(
            sheet, stand, [child.centre for child in placed if child.parent == j] or [stand.tip]
        )
    names = rig.joint_names
    for j, (joint, stand) in enumerate(zip(rig.joints, placed)):
        if joint.coupled is not None:
            leader = placed[names.index(joint.coupled.joint)]
            draw_coupling(sheet, leader.centre, stand.centre, joint.coupled.ratio)
        draw_joint(sheet, rig, j, stand, scale, around[j], lines[j])
    for i, tendon in enumerate(rig.tendons):
        if isinstance(tendon.meetings[-1].shape, Pinned):
            stand = placed[names.index(tendon.meetings[-1].joints[0])]
            draw_pin(sheet, stand, past[i][-1].centre)
    _draw_proximal(sheet, rig, placed, past, scale, base)
    _write_joints(sheet, placed, lines, around, base + 0.1)
    _finish(sheet, rig, arms, placed, scale)
    return sheet.figure


def rig_svg(rig: Rig) -> str:
    """Return the drawing of a rig as an SVG element with a description in words."""
    joints, tendons = (
        ", ".join(part.name for part in parts) for parts in (rig.joints, rig.tendons)
    )
    drives = ", ".join(f"{drive.name} ({drive.kind})" for drive in rig.drives)
    description = (
        f"Drawing of the rig {rig.name}: joints {joints}; drives {drives}; tendons {tendons}"
    )
    return svg_of(draw_rig(rig), description)


def _scale(rig: Rig, placed: Sequence[Stand], largest: float) -> float:
    """Return the scale of the drawing [in/m], at which the joints and the drives fit into their
    space.
    """
    xs = [
        x
        for stand in placed
        for x in (stand.centre[0] - largest, stand.centre[0] + largest, stand.tip[0])
    ]
    ys = [
        y
        for stand in placed
        for y in (stand.centre[1] - largest, stand.centre[1] + largest, stand.tip[1])
    ]
    limits = [
        0.62 / largest,
        (3.4 + 0.8 * max(len(placed) - 3, 0)) / (max(xs) - min(xs)),
        3.4 / (max(ys) - min(ys)),
    ]
    spools = [drive.radius.value for drive in rig.drives if isinstance(drive, Capstan)]
    if spools:
        limits += [0.6 / max(spools), max(3.0, 0.5 * len(spools)) / (2 * sum(spools))]
    return min(limits)


def _around(past: Sequence[Sequence[Wheel]], stand: Stand) -> float:
    """Return the radius outside all pulleys of a joint at which its stops are drawn [in]."""
    circles = [wheel for tendon in past for wheel in tendon]
    radii = [wheel.radius for wheel in circles if wheel.centre == stand.centre]
    pins = [dist(wheel.centre, stand.centre) for wheel in circles if not wheel.radius]
    return max([*radii, *(pin for pin in pins if pin < 0.63), 0.12]) + 0.13


def _draw_base(
    sheet: Sheet, placed: Sequence[Stand], past: Sequence[Sequence[Wheel]], x: float
) -> None:
    """Draw the wall that holds the first joints, and the bars to them."""
    from matplotlib.patches import Rectangle

    roots = [stand.centre for stand in placed if stand.parent is None]
    heights = [tendon[0].point(0.0)[1] for tendon in past] + [root[1] for root in roots]
    low = min(heights) - 0.16
    high = max(heights) + 0.16
    for root in roots:
        sheet.bar([(x, root[1]), root], FAINT, 8.0, order=0.8)
    look = {"facecolor": PALE, "edgecolor": SOFT, "hatch": "//////", "lw": 0.0, "zorder": 1.2}
    wall = Rectangle((x - 0.09, low), 0.09, high - low, **look)
    sheet.patch(wall, (x - 0.09, low), (x, high))
    sheet.line([(x, low), (x, high)], INK, 1.2, zorder=1.3)


def _draw_proximal(
    sheet: Sheet,
    rig: Rig,
    placed: Sequence[Stand],
    past: Sequence[Sequence[Wheel]],
    scale: float,
    base: float,
) -> None:
    """Draw the drives below one another, in the order in which their tendons reach the base, and
    all tendons.
    """
    heights = [tendon[0].point(0.0)[1] for tendon in past]
    wide, pitch = lane_room(rig)
    right = base - FAN
    left = right - wide - 0.1
    names = rig.joint_names
    texts = {drive.name: drive_lines(rig, drive) for drive in rig.drives}
    glyphs = left - glyph_width(rig, scale)
    margin = glyphs - 0.14 - max(line.width for lines in texts.values() for line in lines)
    rows = []
    for drive in rig.drives:
        tendons = sorted(
            (i for i, t in enumerate(rig.tendons) if t.drive == drive.name),
            key=lambda i: -heights[i],
        )
        if isinstance(drive, Capstan):
            first = rig.tendons[tendons[0]]
            joint = names.index(first.joints[0])
            way = placed[joint].turn * (
                1 if next(iter(first.arms().values())) * first.winding >= 0 else -1
            )
            # tendons that a positive angle winds up lie above where it turns counter-clockwise
            above = [i for i in tendons if rig.tendons[i].winding * way > 0]
            below = [i for i in tendons if i not in above]
            reach = max(scale * drive.radius.value, pitch / 2)
            lanes = {i: reach + pitch * (len(above) - 1 - k) for k, i in enumerate(above)}
            lanes |= {i: -reach - pitch * k for k, i in enumerate(below)}
            half = motor_half(drive, scale)
        else:
            lanes = {i: pitch * ((len(tendons) - 1) / 2 - k) for k, i in enumerate(tendons)}
            way = 0
            half = 0.28
        half = max(half, len(texts[drive.name]) * PITCH / 2)
        up = max(half, *(h + 0.2 for h in lanes.values()))
        down = max(half, *(pitch - 0.2 - h for h in lanes.values()))
        rows.append((float(np.mean([heights[i] for i in tendons])), drive, lanes, way, up, down))
    rows.sort(key=lambda row: -row[0])
    total = sum(up + down + 0.12 for *_, up, down in rows) - 0.12
    y = total / 2
    for _, drive, lanes, way, up, down in rows:
        centre = y - up
        y = centre - down - 0.12
        lines = texts[drive.name]
        sheet.block((margin, centre + (len(lines) - 1) * PITCH / 2), lines)
        levels = {i: centre + h for i, h in lanes.items()}
        if isinstance(drive, Capstan):
            at = (left - motor_half(drive, scale), centre)
            draw_capstan(sheet, drive, lines, at, scale, way)
            starts = {
                i: Wheel(at, scale * drive.radius.value, -1 if lanes[i] > 0 else 1) for i in lanes
            }
        else:
            begin = draw_slider(sheet, drive, lines, (left, centre), list(levels.values()), scale)
            starts = {i: Wheel((begin, level)) for i, level in levels.items()}
        for i, level in levels.items():
            ends = ((left + 0.1, level), (right, level))
            eye = (base - 0.045, heights[i])
            draw_tendon(sheet, rig, i, starts[i], ends, eye, past[i])


def _write_joints(
    sheet: Sheet,
    placed: Sequence[Stand],
    lines: Sequence[Sequence[DrawnLine]],
    around: Sequence[float],
    left: float,
) -> None:
    """Write the text on each joint above all joints, side by side, with a thin line down to the
    joint.
    """
    centres = [stand.centre for stand in placed]
    foot = max(centre[1] + a for centre, a in zip(centres, around)) + 0.36
    positions: dict[int, float] = {}
    free = left
    for j in sorted(range(len(placed)), key=lambda j: centres[j]):
        positions[j] = max(centres[j][0] - 0.1, free)
        free = positions[j] + max(line.width for line in lines[j]) + 0.16
    shift = float(np.mean([position - (centres[j][0] - 0.1) for j, position in positions.items()]))
    shift = min(shift, min(positions.values()) - left)
    for j, position in positions.items():
        x = position - shift
        top = foot + (len(lines[j]) - 0.5) * PITCH
        sheet.line([(x - 0.05, top), (x - 0.05, foot - 0.1), centres[j]], SOFT, 0.5, zorder=0.5)
        sheet.block((x, foot + (len(lines[j]) - 1) * PITCH), lines[j])


def _finish(sheet: Sheet, rig: Rig, arms: Floats, placed: Sequence[Stand], scale: float) -> None:
    """Add the rig's name, scale, gravity, and the moment arms where there are several joints or the
    arms change.
    """
    changing = changing_arms(rig)
    left, low = sheet.low
    right, high = sheet.high
    _draw_scale(sheet, (right, low - 0.4), scale)
    _draw_gravity(sheet, rig, (right - 1.45, low - 0.35))
    panel = (left + 0.45, low - 0.25 - PANEL[1])
    bottom = low
    if len(rig.joints) > 1:
        beside = right - left - table_width(rig) > 2.8
        end, bottom = draw_table(sheet, rig, arms, (left, low - (0.1 if beside else 0.6)))
        panel = (
            (end + 0.7, bottom - 0.1)
            if beside and end + 0.7 + PANEL[0] < right - 2.6
            else (panel[0], bottom - 1.7)
        )
    if changing:
        sheet.reserve((panel[0] + PANEL[0], panel[1] - 0.32))
        sheet.take(
            (panel[0] - 0.45, panel[1] - 0.32, panel[0] + PANEL[0], panel[1] + PANEL[1] + 0.3)
        )
        bottom = min(bottom, panel[1] - 0.3)
    notes = ["Joints, pulleys and spools to scale at zero angle; tendons shortened."]
    if len({joint.axis for joint in rig.joints}) > 1:
        notes.append("Each joint is seen along its own axis.")
    if any(stand.drawn_apart for stand in placed):
        notes.append("Joints at one place are drawn apart.")
    text = " ".join(notes)
    wide = width_of(text, SIZE)
    levels = (low - 0.36, bottom - 0.2, sheet.low[1] - 0.1)
    free = next(y for y in levels if sheet.is_free((left, y - 0.1, left + wide + 0.1, y + 0.1)))
    sheet.write((left, free), text, colour=SOFT)
    letters = int((sheet.high[0] - sheet.low[0]) / 0.083)
    title = textwrap.wrap(rig.name, max(letters, 20))[:3]
    for k, row in enumerate(reversed(title)):
        sheet.write((left, high + 0.22 + 0.17 * k), row, size=10.0, bold=True)
    sheet.cut()
    if changing:
        draw_curves(sheet.panel(panel, *PANEL), rig, changing)


def _draw_scale(sheet: Sheet, at: Point, scale: float) -> None:
    """Draw a scale bar of 1, 2 or 5 times a power of ten metres; `at` is its right end."""
    longest = 1.1 / scale
    power = 10.0 ** np.floor(log10(longest))
    size = next(factor for factor in (5, 2, 1) if factor * power <= longest) * power
    x, y = at
    sheet.line([(x - size * scale, y), (x, y)], INK, 2.0, solid_capstyle="butt")
    for end in (x - size * scale, x):
        sheet.line([(end, y - 0.04), (end, y + 0.04)], INK, 0.8)
    sheet.write((x - size * scale / 2, y + 0.1), label_of(float(size), "m"), ha="center")


def _draw_gravity(sheet: Sheet, rig: Rig, at: Point) -> None:
    """Draw the direction of free fall, where the rig has weight."""
    gravity = gravity_on_paper(rig)
    if gravity is None:
        return
    (right, up, near), size = gravity
    x, y = at
    text = f"g {label_of(size, 'm/s²')}"
    if abs(near) > 0.7:
        sheet.write((x, y), f"{text} {'⊙' if near > 0 else '⊗'}", ha="right")
        return
    sheet.arrow([(x - 0.2 * right, y - 0.2 * up), (x + 0.2 * right, y + 0.2 * up)], INK, 1.4)
    sheet.write((x - 0.12 - 0.2 * abs(right), y), text, ha="right")
