"""A schematic of a rig: which drive pulls which tendon, and which joints it turns which way."""

from __future__ import annotations

from math import degrees
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np

from distal.reports.drawing_panel import LAYOUT, Panel, Texts
from distal.reports.page import svg_of
from distal.reports.rig_texts import vector
from distal.results import figure
from distal.rig import Rig

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
        turned = [index(name) for t in rig.tendons if t.drive == drive for name in t.joints]
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
