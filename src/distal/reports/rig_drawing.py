"""A drawing of a rig: its joints in a row, its tendons past them, and every moment arm."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.model import Mechanism
from distal.results import COLOURS, DASHES, figure, legend_above
from distal.rig import Rig

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

SPACING = 3.0
"""Distance of joints without an `offset`, in the largest moment arm."""

POINTS = 61
"""Angles at which an arm that changes is drawn."""


def draw_rig(rig: Rig) -> Figure:
    """Return a figure of a rig: joints and tendons at zero, moment arms as numbers, and as curves where they change.

    The joints stand in a row at their distances; a tendon passes a joint at its moment arm, below the row where it pulls to
    +θ (about y that is down).

    Args:
        rig: the description.
    """
    arms = moment_arms(rig)
    changing = _changing(rig)
    columns = 2 if changing else 1
    heights = [1.5 + 0.16 * len(rig.tendons), 0.8 + 0.3 * len(rig.tendons)]
    width = max(6.5, 1.6 * len(rig.joints) + 4.0)
    with figure(2, columns, (width, sum(heights) + 0.9), height_ratios=heights) as (made, axes):
        if changing:
            for axis in axes[:2]:
                axis.remove()
            whole = made.add_subplot(axes[0].get_gridspec()[0, :])
            _draw_row(whole, rig, arms)
            _draw_numbers(axes[2], rig, arms)
            _draw_curves(axes[3], rig, changing)
        else:
            _draw_row(axes[0], rig, arms)
            _draw_numbers(axes[1], rig, arms)
    return made


def moment_arms(rig: Rig, angles: Floats | None = None) -> Floats:
    """Return the moment arms −∂ℓ/∂θ, positive where a tendon pulls to +θ, (n_tendons, n_joints) [m].

    Args:
        rig: the description.
        angles: of the joints [rad], (n_joints,); default zero.
    """
    mechanism = Mechanism(rig)
    q, p = ca.SX.sym("q", mechanism.n_bodies), mechanism.parameters
    at = np.zeros(mechanism.n_bodies)
    at[: mechanism.n_joints] = 0.0 if angles is None else angles
    jacobian = ca.Function("arms", [q, p.symbols], [mechanism.length_jacobian(q)])(at, p.values)
    return -np.array(jacobian)[:, : mechanism.n_joints]


def _changing(rig: Rig) -> dict[tuple[int, int], tuple[Floats, Floats]]:
    """Return (tendon, joint) → angles [rad] and arms [m], of those that change with the joint's own angle."""
    mechanism = Mechanism(rig)
    q, p = ca.SX.sym("q", mechanism.n_bodies), mechanism.parameters
    look = ca.Function("arms", [q, p.symbols], [mechanism.length_jacobian(q)])
    found = {}
    for j, joint in enumerate(rig.joints):
        low, high = joint.stops or (-np.pi / 3, np.pi / 3)
        angles = np.linspace(low, high, POINTS)
        rows = []
        for angle in angles:
            at = np.array([*(each.initial.value for each in rig.joints), *np.zeros(mechanism.n_drives)])
            at[j] = angle
            rows.append(-np.array(look(at, p.values))[:, j])
        arms = np.array(rows)
        for i in range(len(rig.tendons)):
            if np.ptp(arms[:, i]) > 1e-3 * np.abs(arms).max(initial=1e-12):
                found[i, j] = (angles, arms[:, i])
    return found


def _places(rig: Rig, largest: float) -> Floats:
    """Return where the joints stand in a row [m], then where the last link ends."""
    places = [0.0]
    for joint in rig.joints[1:]:
        distance = float(np.linalg.norm(joint.offset))
        places.append(places[-1] + (distance or SPACING * largest))
    link = rig.joints[-1].link
    reach = 2.0 * float(np.linalg.norm(link.centre)) if link is not None else 0.0
    return np.array([*places, places[-1] + (reach or SPACING * largest)])


def _draw_row(axes: Axes, rig: Rig, arms: Floats) -> None:
    largest = float(np.abs(arms).max())
    at = 1e3 * _places(rig, largest)
    unit = 1e3 * largest
    begin = -max(3.0 * unit, 0.35 * (at[-1] - at[0]))
    axes.plot([begin * 0.25, at[-1]], [0.0, 0.0], color="0.75", lw=7, solid_capstyle="round", zorder=1)
    for j, joint in enumerate(rig.joints):
        radius = 1e3 * float(np.abs(arms[:, j]).max())
        axes.add_patch(_circle((at[j], 0.0), radius))
        axes.plot([at[j]], [0.0], "o", color="0.2", ms=4, zorder=4)
        follows = "" if joint.coupled is None else f"\n= {joint.coupled.ratio:g} · {joint.coupled.joint}"
        name = f"{joint.name}{_axis(joint.axis) if rig.is_chain else ''}{follows}"
        axes.annotate(name, (at[j], 1.25 * unit), ha="center", va="bottom", fontsize=8)
    names = [joint.name for joint in rig.joints]
    # from top to bottom as they meet their first joint
    order = sorted(range(len(rig.tendons)), key=lambda i: float(arms[i, names.index(rig.tendons[i].joints[0])]))
    for i, tendon in enumerate(rig.tendons):
        crossed = sorted(names.index(name) for name in tendon.joints)
        xs, ys = [begin], [_lane(order.index(i), len(order), unit)]
        for j in crossed:
            xs.append(at[j])
            ys.append(-1e3 * arms[i, j])
        last = at[crossed[-1]]
        xs.append(last + 0.55 * (at[crossed[-1] + 1] - last))
        ys.append(ys[-1] * 0.8)
        colour, dash = COLOURS[i % len(COLOURS)], DASHES[i % len(DASHES)]
        axes.plot(xs, ys, color=colour, ls=dash, lw=1.4, zorder=3)
        axes.plot(xs[-1:], ys[-1:], "s", color=colour, ms=4, zorder=4)
        said = tendon.name if tendon.drive == tendon.name else f"{tendon.name} ({tendon.drive})"
        axes.annotate(
            said,
            (begin, ys[0]),
            xytext=(-4, 0),
            textcoords="offset points",
            ha="right",
            va="center",
            color=colour,
            fontsize=8,
        )
    axes.set_aspect("equal")
    axes.margins(0.12, 0.1)
    axes.set_ylim(-1.4 * unit, 2.0 * unit)
    axes.grid(False)
    axes.set_xlabel("[mm]; tendons below the row pull to +θ")
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.set_title(rig.name, loc="left", fontsize=10)


def _lane(index: int, count: int, unit: float) -> float:
    """Return the height at which a tendon's name stands [mm]."""
    return unit * 1.6 * (0.5 - (index + 0.5) / count) * 1.4


def _circle(centre: tuple[float, float], radius: float) -> Any:
    from matplotlib.patches import Circle

    return Circle(centre, radius, facecolor="0.93", edgecolor="0.5", lw=0.8, zorder=2)


def _axis(axis: tuple[float, float, float]) -> str:
    """Return the name of a joint's axis, in brackets."""
    for k, name in enumerate("xyz"):
        if abs(abs(axis[k]) - 1.0) < 1e-9:
            return f" ({'-' if axis[k] < 0 else ''}{name})"
    return " (" + ", ".join(f"{part:.2g}" for part in axis) + ")"


def _draw_numbers(axes: Axes, rig: Rig, arms: Floats) -> None:
    values = 1e3 * arms
    most = float(np.abs(values).max())
    axes.imshow(values, cmap="PuOr_r", vmin=-1.6 * most, vmax=1.6 * most, aspect="auto")
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            text = f"{values[i, j]:+.3g}" if rig.joints[j].name in rig.tendons[i].joints else "–"
            axes.annotate(text, (j, i), ha="center", va="center", fontsize=9)
    axes.set_xticks(range(len(rig.joints)), [joint.name for joint in rig.joints])
    axes.set_yticks(range(len(rig.tendons)), [tendon.name for tendon in rig.tendons])
    axes.tick_params(length=0)
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.set_title("moment arms at zero [mm], + pulls to +θ", loc="left", fontsize=9)


def _draw_curves(axes: Axes, rig: Rig, changing: dict[tuple[int, int], tuple[Floats, Floats]]) -> None:
    for k, ((i, j), (angles, arms)) in enumerate(changing.items()):
        label = rig.tendons[i].name if len(rig.joints) == 1 else f"{rig.tendons[i].name} at {rig.joints[j].name}"
        style = {"color": COLOURS[k % len(COLOURS)], "ls": DASHES[k % len(DASHES)]}
        axes.plot(np.rad2deg(angles), 1e3 * arms, label=label, lw=1.3, **style)
    axes.set_xlabel("angle of the joint [°]")
    axes.set_ylabel("moment arm [mm]")
    legend_above(axes)
