"""A schematic of a rig: which drive pulls which tendon, and which joints it turns which way.

It is a table: joints stand above, drives at the left, and the line of each tendon passes the joints
that it turns. A column is as wide as its widest text and a row as high as its lines, so that
nothing can overlap.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import degrees
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np

from distal.reports.page import svg_of
from distal.results import FAINT, INK, PALE, SOFT, curve_style, figure
from distal.results.plots import plain
from distal.rig import (
    Capstan,
    Joint,
    Rig,
    Slider,
    Tendon,
    independent_parts,
    measurand_of,
    number,
    part_at,
    position_unit,
)
from distal.units import plain_number, quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FONT = 7.0
"""Size of the letters [pt]. Source: layout."""

TITLE = 10.0
"""Size of the title's letters [pt]. Source: layout."""

LETTERS = 80
"""Number of letters in a line of the title and of the notes. Source: layout."""

LINE = 0.0185
"""Distance between lines of text, over the size of their letters [in/pt]. Source: layout."""

GAP = 0.16
"""Distance between the parts of a drawing [in]. Source: layout."""

TEXT_ROUNDING = 1.06
"""Largest width of a text as drawn over its true width; letters are moved to whole pixels. Source:
layout.
"""

ENLARGED = 1.4
"""Largest size on a page over the size in print. Source: layout."""

NOTE = (
    "Drives pull their tendons to the left. A tendon turns a joint to +θ where it has ↺, to −θ "
    "where it has ↻, with the moment arm below (at zero angle). ◉ marks a sensor. Not to scale."
)
"""How a drawing is read."""

SIZES = (
    "radius",
    "stiffness",
    "pretension",
    "slack",
    "path.friction",
    "path.wrap",
    "coupled.ratio",
    "coupled.offset",
    "spring.stiffness",
    "spring.rest_angle",
    "extension_spring.stiffness",
    "extension_spring.free_length",
    "extension_spring.radius",
    "extension_spring.distance",
    "extension_spring.line_angle",
    "friction.constant",
    "friction.load",
    "friction.coefficient",
    "friction.radius",
    "backlash.width",
    "link.mass",
    "gravity.mass",
    "gravity.distance",
    "gravity.hanging_angle",
)
"""Keys of a drive, tendon or joint whose numbers are drawn, where it has them and they are not
zero.
"""


def draw_rig(rig: Rig) -> Figure:
    """Return a schematic of a rig: its drives, tendons and joints with their sizes and sensors.

    Joints that do not move one another are drawn apart.
    """
    title, notes = (wrap(text, LETTERS) for text in (rig.name, _gravity(rig) + NOTE))
    right = max(_width(title, TITLE), _width(notes))
    low = -_height(title, TITLE) - GAP
    with figure() as (drawing, (axes,)):
        _write(axes, 0.0, 0.0, title, len(title), TITLE)
        for part in independent_parts(rig):
            end, low = _draw_part(axes, part.rig, low)
            right = max(right, end)
        _write(axes, 0.0, low, notes, 0)
        low -= _height(notes) + GAP
        drawing.set_layout_engine("none")
        drawing.set_size_inches(right + 2.0 * GAP, GAP - low)
        axes.set_axis_off()
        axes.set_position((0.0, 0.0, 1.0, 1.0))
        axes.set_xlim(-GAP, right + GAP)
        axes.set_ylim(low, GAP)
    joints, tendons = map(", ".join, (rig.joint_names, rig.tendon_names))
    drives = ", ".join(f"{drive.name} ({drive.kind})" for drive in rig.drives)
    drawing.set_label(
        f"Drawing of the rig {rig.name}: joints {joints}; drives {drives}; tendons {tendons}"
    )
    return drawing


def rig_svg(rig: Rig) -> str:
    """Return the drawing of a rig as an SVG element with a description in words."""
    drawing = draw_rig(rig)
    width = ENLARGED * drawing.get_figwidth()
    svg = svg_of(drawing, drawing.get_label())
    return svg.replace("<svg ", f"<svg style='max-width: {width:.1f}in' ", 1)


def _draw_part(axes: Axes, rig: Rig, top: float) -> tuple[float, float]:
    """Draw a part of a rig below a height [in], and return its right and lower end [in].

    It is a table with a column for drives, for tendons and for each joint, and with a row for the
    joints and for each tendon.
    """
    cells = {(0, 2 + j): _texts_of(rig, "joints", joint) for j, joint in enumerate(rig.joints)}
    tendons = [tendon for drive in rig.drive_names for tendon in rig.tendons_of(drive)]
    for row, tendon in enumerate(tendons, 1):
        if tendon is rig.tendons_of(tendon.drive)[0]:
            cells[row, 0] = _texts_of(rig, "drives", rig.drive(tendon.drive))
        cells[row, 1] = _texts_of(rig, "tendons", tendon)
        for name, arm in tendon.arms().items():
            j = rig.joint_names.index(name)
            turn = "↻" if arm < 0.0 else "↺" if arm > 0.0 else "○"
            cells[row, 2 + j] = turn, *_arm_texts(tendon, rig.joints[j])
    widths, heights = np.zeros(2 + len(rig.joints)), np.zeros(1 + len(tendons))
    for (row, column), lines in cells.items():
        widths[column] = max(widths[column], _width(lines) + 2.0 * GAP)
        heights[row] = max(heights[row], _height(lines) + GAP)
    x, y = GAP / 2 + np.cumsum([0.0, *widths]), top - np.cumsum([0.0, *heights])
    for (row, column), lines in cells.items():
        if row == 0 or column == 0:
            ends = x[column] - GAP / 2, x[column + 1] - 1.5 * GAP
            look = {"facecolor": PALE, "edgecolor": SOFT, "lw": 0.6, "zorder": 2}
            last = row + len(rig.tendons_of(tendons[row - 1].drive)) if row else 1
            axes.fill_between(ends, y[last] + GAP, y[row], **look)
        _write(axes, x[column], y[row] - GAP / 4, lines)
    for left in x[2:-1] - GAP / 2:
        axes.plot(
            (left, left), (y[0], y[-1] + GAP), color=FAINT, lw=3.0, solid_capstyle="butt", zorder=1
        )
    for row in range(1, len(y) - 1):
        turned = [x[column] - GAP / 2 for at, column in cells if at == row and column > 1]
        level = y[row] - 3 / 8 * GAP - LINE * FONT
        along = x[1] - 1.5 * GAP, *sorted(turned)
        look = {"marker": "o", "ms": 4.0, "markevery": slice(1, None), "lw": 1.6, "zorder": 4}
        axes.plot(along, [level] * len(along), **look, **curve_style(row - 1))
    return x[-1] - GAP, y[-1]


def _width(lines: Sequence[str], size: float = FONT) -> float:
    """Return the width of the widest line, were all bold [in]."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    bold = FontProperties(size=size, weight="bold")
    extents = (text_to_path.get_text_width_height_descent(line, bold, False) for line in lines)
    return TEXT_ROUNDING * float(max(width for width, _, _ in extents)) / 72.0


def _height(lines: Sequence[str], size: float = FONT) -> float:
    """Return the height of lines with the gaps that `_write` needs [in]."""
    return LINE * size * len(lines) + 0.75 * GAP


def _write(
    axes: Axes, left: float, top: float, lines: Sequence[str], bold: int = 1, size: float = FONT
) -> None:
    """Write lines below a height [in], the first ones bold and the others after a gap."""
    for k, line in enumerate(lines):
        y = top - LINE * size * (k + 0.5) - (GAP / 4 if k >= bold else 0.0)
        look = {"size": size, "weight": "bold" if k < bold else "normal", "color": INK}
        axes.text(left, y, plain(line), va="center_baseline", zorder=5, **look)


def _gravity(rig: Rig) -> str:
    """Return a sentence on gravity, empty where the rig has no links."""
    if not any(joint.link for joint in rig.joints):
        return ""
    turned = _vector(map(degrees, rig.base.orientation))
    base = f", base turned by {turned}°" if any(rig.base.orientation) else ""
    return f"Gravity {_vector(rig.base.gravity)} m/s²{base}. "


def _vector(components: Iterable[float]) -> str:
    """Return the text of a vector, such as "[45, 0, 0]"."""
    return f"[{', '.join(map(plain_number, components))}]"


def _texts_of(rig: Rig, kind: str, part: Joint | Slider | Capstan | Tendon) -> tuple[str, ...]:
    """Return the lines on a joint, drive or tendon: its name, sizes, stops and sensors.

    Args:
        kind: list of the rig that holds the part: joints, drives or tendons.
    """
    texts = [part.name]
    unit = "rad"
    if isinstance(part, Joint):
        texts += _position(rig, part)
    elif isinstance(part, Tendon):
        drive = rig.drive(part.drive)
        sign = "−" if drive.kind == "capstan" and part.winding < 0 else "+"
        texts.append(f"pulled in by {sign}{'φ' if drive.kind == 'capstan' else 'x'}")
    else:
        texts.append(part.kind)
        unit = position_unit(part)
    for key in SIZES:
        if part_at(part, key) is not None:
            size = number(rig, f"{kind}.{part.name}.{key}")
            words = key.replace(".", " ").replace("_", " ")
            if size.value != 0.0:
                texts.append(f"{words} {quantity(size.value, size.quantity.si)}")
    stops = getattr(part, "stops", None)
    if stops is not None:
        texts.append(f"stops {' … '.join(quantity(stop, unit) for stop in stops)}")
    for sensor in rig.sensors:
        if measurand_of(sensor).of == kind and sensor.of == part.name:
            gear = getattr(sensor, "gear", 1.0)
            before = "" if gear == 1.0 else f", gear {plain_number(gear)}"
            texts.append(f"◉ {sensor.name}: {sensor.measures}{before}")
    return tuple(texts)


def _position(rig: Rig, joint: Joint) -> list[str]:
    """Return on which link a joint sits, its axis there, and which joint it follows."""
    parent = rig.parent_of(rig.joint_names.index(joint.name))
    below = "base" if parent is None else rig.joints[parent].name
    parts = (f"{part:+.2g}{name}" for name, part in zip("xyz", joint.axis) if abs(part) > 0.005)
    axis = " ".join(parts).replace("+1", "+").replace("-1", "−").replace("-", "−")
    texts = [f"on {below}, axis {axis.removeprefix('+')}"]
    if any(joint.offset):
        texts.append(f"at {_vector(1e3 * part for part in joint.offset)} mm")
    if joint.coupled is not None:
        texts.append(f"coupled to {joint.coupled.joint}")
    return texts


def _arm_texts(tendon: Tendon, joint: Joint) -> tuple[str, ...]:
    """Return the lines on a tendon's moment arm at a joint: at zero, at the ends of the joint's
    travel where it differs there, and how they meet unless by a pulley.
    """

    def signed(angle: float) -> str:
        arm = tendon.arms({joint.name: angle})[joint.name]
        return f"{'+' if arm > 0.0 else ''}{quantity(arm, 'm')}"

    at_zero = signed(0.0)
    changed = [angle for angle in joint.travel if signed(angle) != at_zero]
    ends = [f"{signed(angle)} at {quantity(angle, 'rad')}" for angle in changed]
    kinds = {meeting.shape.kind for meeting in tendon.meetings if joint.name in meeting.joints}
    return at_zero, *ends, *sorted(kinds - {"pulley"})
