"""Moment arms in a drawing: as a table, and as curves where they change with the angle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.model import Mechanism
from distal.reports.drawing.labels import rounded_label
from distal.reports.drawing.sheet import PITCH, DrawnLine, Point, Sheet
from distal.results import COLOURS, DASHES, INK, SOFT, legend_above, styled
from distal.rig import Rig

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Changing = dict[tuple[int, int], tuple[Floats, Floats]]
"""(tendon, joint) → angles [rad] and moment arms [m], (POINTS,) each."""

POINTS = 61
"""Number of angles at which a moment arm that changes is drawn. Source: layout."""

MOST_CURVES = 12
"""Curves of moment arms in one picture at most; more cannot be told apart. Source: layout."""


def changing_arms(rig: Rig) -> Changing:
    """Return (tendon, joint) → angles [rad] and moment arms [m], for the arms that change with the
    joint's own angle.
    """
    mechanism = Mechanism(rig)
    changing = Changing()
    q = ca.SX.sym("q", mechanism.n_bodies)
    p = mechanism.parameters
    jacobian = ca.Function("arms", [q, p.symbols], [mechanism.length_jacobian(q)])
    start = np.array(
        [*(joint.initial.value for joint in rig.joints), *np.zeros(mechanism.n_drives)]
    )
    for j, joint in enumerate(rig.joints):
        angles = np.linspace(*(joint.stops or (-np.pi / 3, np.pi / 3)), POINTS)
        postures = (np.where(np.arange(len(start)) == j, angle, start) for angle in angles)
        arms = -np.array([np.array(jacobian(posture, p.values))[:, j] for posture in postures])
        for i in range(len(rig.tendons)):
            if np.ptp(arms[:, i]) > 1e-3 * np.abs(arms).max(initial=1e-12):
                changing[i, j] = (angles, arms[:, i])
    return changing


def table_width(rig: Rig) -> float:
    """Return the width of the table of moment arms [in]."""
    first, widths = _columns(rig)
    return first + sum(widths)


def _columns(rig: Rig) -> tuple[float, list[float]]:
    first = max(DrawnLine(tendon.name, True).width for tendon in rig.tendons) + 0.45
    return first, [max(DrawnLine(joint.name, True).width, 0.45) + 0.16 for joint in rig.joints]


def draw_table(sheet: Sheet, rig: Rig, arms: Floats, at: Point) -> Point:
    """Write moment arms as a table below and to the right of the corner `at`; return the opposite
    corner.

    Args:
        arms: moment arms at zero angle [m], (n_tendons, n_joints).
        at: left upper corner [in].
    """
    first, widths = _columns(rig)
    sheet.write((at[0], at[1] - 0.08), "Moment arms at zero [mm]; + pulls to +θ", bold=True)
    top = at[1] - 0.3
    right = at[0] + first + sum(widths)
    ends = [at[0] + first + sum(widths[: j + 1]) for j in range(len(widths))]
    for joint, end in zip(rig.joints, ends):
        sheet.write((end - 0.06, top), joint.name, bold=True, ha="right")
    y = top - 0.6 * PITCH
    sheet.line([(at[0], y), (right, y)], INK, 0.8)
    for i, row in enumerate(arms):
        y = top - 1.4 * (i + 1) * PITCH
        colour = COLOURS[i % len(COLOURS)]
        sheet.line([(at[0], y), (at[0] + 0.28, y)], colour, 1.4, ls=DASHES[i % len(DASHES)])
        sheet.write((at[0] + 0.36, y), rig.tendons[i].name, bold=True)
        for joint, end, arm in zip(rig.joints, ends, row):
            crossed = joint.name in rig.tendons[i].joints
            text = rounded_label(1e3 * arm) if crossed else "–"
            sheet.write((end - 0.06, y), f"+{text}" if crossed and arm > 0 else text, ha="right")
    y -= 0.8 * PITCH
    sheet.line([(at[0], y), (right, y)], SOFT, 0.5)
    return right, y


def draw_curves(axes: Axes, rig: Rig, changing: Changing) -> None:
    """Draw the moment arms of `changing_arms` over the joint's own angle."""
    for (i, j), (angles, arms) in list(changing.items())[:MOST_CURVES]:
        label = (
            rig.tendons[i].name
            if len(rig.joints) == 1
            else f"{rig.tendons[i].name} at {rig.joints[j].name}"
        )
        style = {"color": COLOURS[i % len(COLOURS)], "ls": DASHES[(i + j) % len(DASHES)]}
        axes.plot(np.rad2deg(angles), 1e3 * arms, label=label, lw=1.3, **style)
    axes.set_xlabel("angle of the joint [°]", fontsize=7)
    axes.set_ylabel("moment arm [mm]", fontsize=7)
    axes.tick_params(labelsize=7)
    with styled():
        legend_above(axes, most=2)
