"""A schematic of a rig: which drive pulls which tendon, and which joints it turns which way.

Its panels have joints above, drives at the left, and a line for each tendon that passes the joints
which it turns. Each part has a cell of a grid that is as large as its text, so that nothing can
overlap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import degrees
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np

from distal.reports.page import svg_of
from distal.reports.rig_texts import arm_texts, texts_of, vector
from distal.results import COLOURS, DASHES, FAINT, INK, PALE, SOFT, WHITE, figure
from distal.results.style import plain
from distal.rig import Rig

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Point = tuple[float, float]
"""Position to the right and up [in]."""


@dataclass(frozen=True)
class Layout:
    """Sizes of a drawing.

    Args:
        font: size of text [pt].
        title: size of the title [pt].
        letters: letters in a line of the title and of the notes.
        line: distance between lines of text, over their size [in/pt].
        gap: distance between cells [in].
        circle: radius of the circle where a tendon turns a joint [in].
        across: width of a row of several panels at most [in].
        rounding: largest width of a text as drawn over its true width; letters are moved to whole
            pixels.
        enlarged: largest size on a page over the size in print.
    """

    font: float = 7.0
    title: float = 10.0
    letters: int = 80
    line: float = 0.0185
    gap: float = 0.16
    circle: float = 0.11
    across: float = 10.0
    rounding: float = 1.06
    enlarged: float = 1.4


LAYOUT = Layout()
"""Sizes of all drawings. Source: layout."""


@dataclass(frozen=True)
class Texts:
    """Lines of text below one another.

    Args:
        lines: the lines.
        bold: how many of the first lines are bold.
        size: size of the letters [pt].
    """

    lines: Sequence[str]
    bold: int = 0
    size: float = LAYOUT.font

    def _weight(self, index: int) -> str:
        return "bold" if index < self.bold else "normal"

    @cached_property
    def width(self) -> float:
        """Width of the widest line [in]."""
        from matplotlib.font_manager import FontProperties
        from matplotlib.textpath import text_to_path

        widths = []
        for k, line in enumerate(self.lines):
            font = FontProperties(size=self.size, weight=self._weight(k))
            widths.append(text_to_path.get_text_width_height_descent(line, font, ismath=False)[0])
        return LAYOUT.rounding * float(max(widths)) / 72.0

    @property
    def height(self) -> float:
        """Height of all lines [in]."""
        return LAYOUT.line * self.size * len(self.lines)

    def draw(self, axes: Axes, left: float, top: float) -> None:
        """Write the lines.

        Args:
            left: left end of the lines [in].
            top: upper end of the first line [in].
        """
        for k, line in enumerate(self.lines):
            axes.text(
                left,
                top - LAYOUT.line * self.size * (k + 0.5),
                plain(line),
                fontsize=self.size,
                fontweight=self._weight(k),
                color=INK,
                va="center_baseline",
                zorder=5,
            )


@dataclass(frozen=True)
class Row:
    """The row of a tendon, with its line in the middle.

    Args:
        tendon: index of the tendon.
        name: its name, above the line.
        sizes: its other texts, below the line.
        arms: index of each joint that it turns → moment arm at θ = 0 [m], and the texts on it,
            which are below the line where the arm is positive.
    """

    tendon: int
    name: Texts
    sizes: Texts
    arms: dict[int, tuple[float, Texts]]

    def height(self, side: int) -> float:
        """Return the height of the row above its line (`side` 1) or below it (−1) [in]."""
        texts = [self.name if side > 0 else self.sizes]
        texts += [text for arm, text in self.arms.values() if (arm < 0.0) == (side > 0)]
        return max(2.0 * LAYOUT.circle, *(text.height for text in texts)) + LAYOUT.gap / 2

    def draw(self, axes: Axes, start: Point, lefts: dict[int, float]) -> None:
        """Draw the tendon.

        Args:
            start: where its line leaves the drive [in].
            lefts: left end of the cell of each joint [in].
        """
        x, y = start
        radius = LAYOUT.circle
        colour = COLOURS[self.tendon % len(COLOURS)]
        dash = DASHES[self.tendon % len(DASHES)]
        end = lefts[max(self.arms)] + radius
        axes.plot((x, end), (y, y), color=colour, lw=1.6, ls=dash, zorder=4)
        axes.plot(end, y, "o", color=colour, ms=4.0, zorder=4)
        self.name.draw(axes, x + LAYOUT.gap, y + self.name.height + LAYOUT.gap / 4)
        self.sizes.draw(axes, x + LAYOUT.gap, y - LAYOUT.gap / 4)
        for j, (arm, text) in self.arms.items():
            centre = lefts[j] + radius
            side = 1 if arm < 0.0 else -1
            turn = "↻" if arm < 0.0 else "↺" if arm > 0.0 else ""
            middle = y + side * radius
            size = 144.0 * radius
            axes.plot(centre, middle, "o", ms=size, mfc=WHITE, mec=INK, mew=0.8, zorder=3)
            axes.text(
                centre, middle, turn, fontsize=9, color=INK, ha="center", va="center", zorder=5
            )
            half = text.height / 2
            top = y + side * max(radius, half + LAYOUT.gap / 4) + half
            text.draw(axes, centre + 1.5 * radius, top)


class Panel:
    """Joints that tendons and couplings connect, with their tendons and drives.

    Args:
        rig: the whole rig.
        joints: indices of the joints.
    """

    def __init__(self, rig: Rig, joints: Sequence[int]) -> None:
        space = 2.0 * LAYOUT.gap
        self.joints = {j: Texts(texts_of(rig, "joints", j), 1) for j in joints}
        self.rows: dict[int, list[Row]] = {}
        widths = [0.0]
        beside = dict.fromkeys(joints, 0.0)
        for i, tendon in enumerate(rig.tendons):
            turned = [rig.joint_names.index(name) for name in tendon.joints]
            if turned[0] not in joints:
                continue
            name, *sizes = texts_of(rig, "tendons", i)
            arms = {}
            for j in turned:
                text = Texts(arm_texts(tendon, rig.joints[j]))
                arms[j] = (tendon.arms()[rig.joints[j].name], text)
                beside[j] = max(beside[j], text.width + 2.5 * LAYOUT.circle)
            row = Row(i, Texts([name], 1), Texts(sizes), arms)
            self.rows.setdefault(rig.drive_names.index(tendon.drive), []).append(row)
            widths += [row.name.width, row.sizes.width]
        self.drives = {d: Texts(texts_of(rig, "drives", d), 1) for d in self.rows}
        self.first = max(text.width for text in self.drives.values()) + LAYOUT.gap
        x = self.first + max(widths) + space
        self.lefts: dict[int, float] = {}
        for j, text in self.joints.items():
            self.lefts[j] = x
            x += max(text.width, beside[j]) + space
        self.width = x - LAYOUT.gap
        self.top = max(text.height for text in self.joints.values()) + space
        self.height = self.top + sum(self._height(d) + LAYOUT.gap for d in self.rows)

    def _height(self, drive: int) -> float:
        rows = sum(row.height(1) + row.height(-1) for row in self.rows[drive])
        return max(rows, self.drives[drive].height + LAYOUT.gap)

    def draw(self, axes: Axes, left: float, top: float) -> None:
        """Draw the panel.

        Args:
            left: left end of the panel [in].
            top: upper end of the panel [in].
        """
        lefts = {j: left + x for j, x in self.lefts.items()}
        for j, text in self.joints.items():
            height = text.height + LAYOUT.gap
            _box(axes, (lefts[j] - LAYOUT.gap / 2, top), (text.width + LAYOUT.gap, height))
            text.draw(axes, lefts[j], top - LAYOUT.gap / 2)
            stem = lefts[j] + LAYOUT.circle
            ends = (top - height, top - self.height + LAYOUT.gap)
            axes.plot((stem, stem), ends, color=FAINT, lw=4.0, zorder=1)
        y = top - self.top
        for drive, rows in self.rows.items():
            height = self._height(drive)
            _box(axes, (left, y), (self.first, height))
            text = self.drives[drive]
            text.draw(axes, left + LAYOUT.gap / 2, y - (height - text.height) / 2)
            spare = height - sum(row.height(1) + row.height(-1) for row in rows)
            level = y
            for row in rows:
                level -= spare / len(rows) / 2 + row.height(1)
                row.draw(axes, (left + self.first, level), lefts)
                level -= spare / len(rows) / 2 + row.height(-1)
            y -= height + LAYOUT.gap


def _box(axes: Axes, corner: Point, size: Point) -> None:
    """Draw a box by its left upper corner, its width and its height."""
    x, y = corner
    ends = (x, x + size[0])
    axes.fill_between(ends, y - size[1], y, facecolor=PALE, edgecolor=SOFT, lw=0.6, zorder=2)


NOTE = (
    "Drives pull their tendons to the left. A tendon that passes above a circle turns that joint "
    "to +θ, one below it to −θ, with the moment arm that stands beside the circle (at zero angle). "
    "◉ marks a sensor. Not to scale."
)
"""How a drawing is read."""


def draw_rig(rig: Rig) -> Figure:
    """Return a schematic of a rig: its drives, tendons and joints with their sizes and sensors.

    Joints that no tendon, drive or coupling connects are drawn apart.
    """
    space = 2.0 * LAYOUT.gap
    title = Texts(wrap(rig.name, LAYOUT.letters), LAYOUT.letters, LAYOUT.title)
    notes = Texts(wrap(_gravity(rig) + NOTE, LAYOUT.letters))
    right = max(title.width, notes.width)
    x = 0.0
    top = bottom = -title.height - LAYOUT.gap
    with figure() as (drawing, (axes,)):
        for panel in (Panel(rig, joints) for joints in _connected(rig)):
            if x > 0.0 and x + panel.width > LAYOUT.across:
                x = 0.0
                top = bottom
            panel.draw(axes, x, top)
            right = max(right, x + panel.width)
            bottom = min(bottom, top - panel.height - LAYOUT.gap)
            x += panel.width + space
        title.draw(axes, 0.0, 0.0)
        notes.draw(axes, 0.0, bottom)
        low = bottom - notes.height - LAYOUT.gap
        drawing.set_layout_engine("none")
        drawing.set_size_inches(right + space, LAYOUT.gap - low)
        axes.set_axis_off()
        axes.set_position((0.0, 0.0, 1.0, 1.0))
        axes.set_xlim(-LAYOUT.gap, right + LAYOUT.gap)
        axes.set_ylim(low, LAYOUT.gap)
    drawing.set_label(_described(rig))
    return drawing


def rig_svg(rig: Rig) -> str:
    """Return the drawing of a rig as an SVG element with a description in words."""
    drawing = draw_rig(rig)
    width = LAYOUT.enlarged * drawing.get_figwidth()
    svg = svg_of(drawing, drawing.get_label())
    return svg.replace("<svg ", f"<svg style='max-width: {width:.1f}in' ", 1)


def _described(rig: Rig) -> str:
    joints, tendons = (
        ", ".join(part.name for part in parts) for parts in (rig.joints, rig.tendons)
    )
    drives = ", ".join(f"{drive.name} ({drive.kind})" for drive in rig.drives)
    return f"Drawing of the rig {rig.name}: joints {joints}; drives {drives}; tendons {tendons}"


def _connected(rig: Rig) -> list[list[int]]:
    """Return groups of the indices of joints that drives and couplings connect, in the rig's
    order.
    """
    from scipy.sparse.csgraph import connected_components

    index = rig.joint_names.index
    together = np.eye(len(rig.joints))
    for drive in rig.drive_names:
        turned = [index(name) for tendon in rig.tendons_of(drive) for name in tendon.joints]
        together[np.ix_(turned, turned)] = 1.0
    for j, joint in enumerate(rig.joints):
        if joint.coupled:
            together[j, index(joint.coupled.joint)] = 1.0
    count, group = connected_components(together, directed=False)
    return [np.flatnonzero(group == k).tolist() for k in range(count)]


def _gravity(rig: Rig) -> str:
    """Return a sentence on gravity, empty where the rig has no links."""
    if not any(joint.link for joint in rig.joints):
        return ""
    turned = vector(map(degrees, rig.base.orientation))
    base = f", base turned by {turned}°" if any(rig.base.orientation) else ""
    return f"Gravity {vector(rig.base.gravity)} m/s²{base}. "
