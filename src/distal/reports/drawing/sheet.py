"""A sheet of paper in inches: the size of a text is known before it is drawn, and the sheet is cut
to its content at the end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import cos, hypot, sin
from typing import TYPE_CHECKING

from distal.results import INK, SOFT, WHITE, figure, styled
from distal.results.style import plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

Point = tuple[float, float]
"""Position on the sheet, to the right and up [in]."""

Box = tuple[float, float, float, float]
"""Left, bottom, right, top [in]."""

SIZE = 7.0
"""Size of text [pt]. Source: layout."""

PITCH = 0.13
"""Distance from one line of text to the next [in]. Source: layout."""

BADGE = 0.072
"""Radius of a sensor's badge [in]. Source: layout."""

MARGIN = 0.14
"""Margin around all that is drawn [in]. Source: layout."""


@dataclass(frozen=True)
class DrawnLine:
    """A line of text beside a component; names are bold, and a sensor has a badge of one letter
    before its name.
    """

    text: str
    bold: bool = False
    badge: str = ""

    @property
    def width(self) -> float:
        """Width of the line with its badge [in]."""
        return width_of(self.text, SIZE, self.bold) + (3.0 * BADGE if self.badge else 0.0)


@lru_cache(maxsize=4096)
def width_of(text: str, size: float, bold: bool = False) -> float:
    """Return the width of a line of text [in].

    Args:
        size: size of the text [pt].
        bold: whether the text is bold.
    """
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    if not text.strip():
        return 0.0
    font = FontProperties(weight="bold" if bold else "normal")
    # a renderer rounds each letter to whole pixels, hence the 3 %
    return 1.03 * float(TextPath((0, 0), plain(text), size=size, prop=font).get_extents().x1) / 72.0


def on_circle(centre: Point, radius: float, angle: float) -> Point:
    """Return the point of a circle at an angle.

    Args:
        radius: radius of the circle [in].
        angle: angle from the right, counter-clockwise [rad].
    """
    return centre[0] + radius * cos(angle), centre[1] + radius * sin(angle)


def arc(centre: Point, radius: float, start: float, end: float) -> list[Point]:
    """Return points along an arc from the angle `start` to the angle `end`, both from the right
    [rad].

    Args:
        radius: radius of the arc [in].
    """
    count = 2 + int(abs(end - start) / 0.06)
    return [on_circle(centre, radius, start + (end - start) * k / count) for k in range(count + 1)]


class Sheet:
    """A figure on which things are drawn at positions in inches; y points up, and `cut` gives it
    its size.
    """

    def __init__(self) -> None:
        self.figure: Figure
        self.axes: Axes
        with figure() as (self.figure, (self.axes,)):
            self.figure.set_layout_engine("none")
            self.axes.set_axis_off()
            self.axes.grid(False)
        self.low = [0.0, 0.0]
        self.high = [0.0, 0.0]
        self._taken: list[Box] = []

    def reserve(self, *points: Point) -> None:
        """Extend the sheet so that the points are on it."""
        for k in (0, 1):
            self.low[k] = min(self.low[k], *(point[k] for point in points))
            self.high[k] = max(self.high[k], *(point[k] for point in points))

    def take(self, box: Box) -> None:
        """Mark a box as taken, so that no label is written there."""
        self._taken.append(box)

    def is_free(self, box: Box) -> bool:
        """Return whether no part of a box is taken."""
        return not any(
            box[0] < b[2] and b[0] < box[2] and box[1] < b[3] and b[1] < box[3] for b in self._taken
        )

    def write(
        self,
        at: Point,
        text: str,
        *,
        size: float = SIZE,
        bold: bool = False,
        colour: str = INK,
        ha: str = "left",
        clear: bool = False,
    ) -> None:
        """Write one line of text.

        Args:
            at: left end, middle or right end of the text, on its middle line [in].
            size: size of the text [pt].
            ha: which of these `at` is: "left", "center" or "right".
            clear: whether the letters have a white outline, for text in front of lines.
        """
        from matplotlib.patheffects import withStroke

        box = _box(at, text, size, bold, ha)
        self.take(box)
        self.reserve(box[:2], box[2:])
        weight = "bold" if bold else "normal"
        look = {
            "fontsize": size,
            "fontweight": weight,
            "color": colour,
            "ha": ha,
            "va": "center_baseline",
            "zorder": 9,
        }
        effects = [withStroke(linewidth=2.0, foreground=WHITE)] if clear else []
        self.axes.text(*at, plain(text), **look, path_effects=effects)

    def write_near(self, at: Point, away: Point, text: str) -> None:
        """Write a label beside a point.

        Args:
            away: unit vector along which the label is moved away from the point until it covers no
                other text.
        """
        ha = "left" if away[0] > 0.35 else "right" if away[0] < -0.35 else "center"
        position = at
        for step in range(40):
            position = (at[0] + 0.05 * step * away[0], at[1] + 0.05 * step * away[1])
            if self.is_free(_box(position, text, SIZE, False, ha)):
                break
        self.write(position, text, ha=ha, clear=True)

    def block(self, at: Point, lines: Sequence[DrawnLine]) -> None:
        """Write lines below one another; `at` is the left end of the first line, at its middle
        height.
        """
        for k, line in enumerate(lines):
            x = at[0]
            y = at[1] - k * PITCH
            if line.badge:
                self.badge((x + BADGE, y), line.badge)
                x += 3.0 * BADGE
            self.write((x, y), line.text, bold=line.bold)

    def badge(self, at: Point, letter: str) -> None:
        """Draw a sensor's badge: a small circle with the letter of the measured quantity."""
        self.disc(at, BADGE - 0.016, WHITE, order=8.0)
        self.write(at, letter, size=5.5, ha="center")

    def mark(self, lines: Sequence[DrawnLine], positions: Mapping[str, Point]) -> None:
        """Repeat the badges of lines on the drawn component.

        Args:
            positions: letter of a badge → where it is drawn.
        """
        for letter, at in positions.items():
            if any(line.badge == letter for line in lines):
                self.badge(at, letter)

    def line(
        self, points: Sequence[Point], colour: str = INK, width: float = 0.8, **look: object
    ) -> None:
        """Draw a line through points.

        Args:
            width: width of the line [pt].
            look: properties of matplotlib's `Line2D`.
        """
        self.reserve(*points)
        xs, ys = zip(*points)
        self.axes.plot(
            xs,
            ys,
            color=colour,
            lw=width,
            **{"solid_joinstyle": "round", "dash_capstyle": "butt", **look},
        )

    def bar(self, points: Sequence[Point], colour: str, width: float, order: float) -> None:
        """Draw a bar through points, with round ends and a thin edge.

        Args:
            width: width of the bar [pt].
            order: a bar of higher order lies in front.
        """
        self.line(points, SOFT, width + 1.2, solid_capstyle="round", zorder=order)
        self.line(points, colour, width, solid_capstyle="round", zorder=order + 0.05)

    def patch(self, shape: Patch, *corners: Point) -> None:
        """Add a shape of matplotlib, and extend the sheet to its corners."""
        self.axes.add_patch(shape)
        if corners:
            self.reserve(*corners)

    def disc(
        self,
        centre: Point,
        radius: float,
        colour: str,
        edge: str = INK,
        order: float = 2.0,
        **look: object,
    ) -> None:
        """Draw a circle.

        Args:
            radius: radius of the circle [in].
            order: a circle of higher order lies in front.
            look: properties of matplotlib's `Circle`.
        """
        from matplotlib.patches import Circle

        x, y = centre
        shape = Circle(
            centre,
            radius,
            **{"facecolor": colour, "edgecolor": edge, "lw": 0.7, "zorder": order, **look},
        )
        self.patch(shape, (x - radius, y - radius), (x + radius, y + radius))

    def box(self, low: Point, high: Point, colour: str, order: float) -> None:
        """Draw a rectangle by its left lower and right upper corners.

        Args:
            order: a rectangle of higher order lies in front.
        """
        from matplotlib.patches import Rectangle

        width = high[0] - low[0]
        height = high[1] - low[1]
        self.patch(
            Rectangle(low, width, height, facecolor=colour, edgecolor=INK, lw=0.8, zorder=order),
            low,
            high,
        )

    def arrow(self, points: Sequence[Point], colour: str = INK, width: float = 0.9) -> None:
        """Draw a line through points, with a head at the last one.

        Args:
            width: width of the line [pt].
        """
        from matplotlib.patches import Polygon

        self.line(points, colour, width, zorder=5.0)
        (x0, y0), (x, y) = points[-2:]
        long = hypot(x - x0, y - y0)
        along = ((x - x0) / long, (y - y0) / long)
        ends = [
            (
                x + 0.085 * a * along[0] + 0.03 * b * along[1],
                y + 0.085 * a * along[1] - 0.03 * b * along[0],
            )
            for a, b in ((0.35, 0.0), (-0.65, 1.0), (-0.65, -1.0))
        ]
        self.patch(Polygon(ends, facecolor=colour, edgecolor="none", zorder=5.0), *ends)

    def cut(self) -> None:
        """Give the figure the size of what is on it, with a margin."""
        low = [v - MARGIN for v in self.low]
        high = [v + MARGIN for v in self.high]
        self.figure.set_size_inches(high[0] - low[0], high[1] - low[1])
        self.axes.set_position((0.0, 0.0, 1.0, 1.0))
        self.axes.set_xlim(low[0], high[0])
        self.axes.set_ylim(low[1], high[1])

    def panel(self, corner: Point, width: float, height: float) -> Axes:
        """Return new axes on the sheet; this is called after `cut`.

        Args:
            corner: left lower corner of the axes [in].
            width: width of the axes [in].
            height: height of the axes [in].
        """
        x0, x1 = self.axes.get_xlim()
        y0, y1 = self.axes.get_ylim()
        w = x1 - x0
        h = y1 - y0
        with styled():
            return self.figure.add_axes(
                ((corner[0] - x0) / w, (corner[1] - y0) / h, width / w, height / h)
            )


def _box(at: Point, text: str, size: float, bold: bool, ha: str) -> Box:
    width = width_of(text, size, bold)
    left = at[0] - {"left": 0.0, "center": 0.5, "right": 1.0}[ha] * width
    half = 0.62 * size / 72.0
    return left, at[1] - half, left + width, at[1] + half
