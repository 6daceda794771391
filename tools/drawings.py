"""Drawings of the documentation: `python -m tools.drawings` writes frames, finger and finger-angles
to docs/figures.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from distal import estimate, load_rig, plot_estimates, simulate
from distal.reports import draw_rig
from distal.results import COLOURS, figure, save_figure

FOLDER = Path("docs/figures")
LENGTHS, ANGLES, NAMES = (45.0, 25.0, 20.0), np.deg2rad([20.0, 35.0, 25.0]), ("mcp", "pip", "dip")


def arrow(
    axes: Axes,
    start: np.ndarray,
    end: np.ndarray,
    colour: str,
    style: str = "->",
    width: float = 1.4,
) -> None:
    """Draw an arrow."""
    look = {"arrowstyle": style, "color": colour, "lw": width, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tuple(end), tuple(start), arrowprops=look, zorder=5)


def frame(axes: Axes, at: np.ndarray, angle: float, colour: str, size: float) -> None:
    """Draw a frame whose y points into the page."""
    across = {
        "x": np.array([np.cos(angle), -np.sin(angle)]),
        "z": np.array([np.sin(angle), np.cos(angle)]),
    }
    for name, direction in across.items():
        arrow(axes, at, at + size * direction, colour)
        axes.annotate(
            name,
            tuple(at + (size + 2.5) * direction),
            ha="center",
            va="center",
            fontsize=8,
            color=colour,
        )
    axes.plot(*at, "o", mfc="white", mec=colour, ms=9, zorder=6)
    axes.plot(*at, "x", color=colour, ms=5, zorder=7)


def frames() -> None:
    """Draw base, frames, angles, offset and gravity of a finger."""
    with figure(1, 1, (6.5, 3.6)) as (made, (axes,)):
        axes.plot([-14, 0], [0, 0], color="0.55", lw=9, solid_capstyle="butt")
        axes.annotate("base", (-7, 4.5), ha="center", fontsize=9, color="0.3")
        frame(axes, np.array([-24.0, 0.0]), 0.0, COLOURS[5], 9.0)
        at, turned = np.zeros(2), 0.0
        for k, (length, angle) in enumerate(zip(LENGTHS, ANGLES)):
            before, turned = turned, turned + angle
            along = np.array([np.cos(turned), -np.sin(turned)])
            end, colour = at + length * along, COLOURS[k]
            axes.plot(
                [at[0], end[0]],
                [at[1], end[1]],
                color="0.78",
                lw=8,
                solid_capstyle="round",
                zorder=1,
            )
            axes.plot(*(at + length / 2 * along), "+", color="0.2", ms=8, mew=1.6, zorder=4)
            straight = at + 18 * np.array([np.cos(before), -np.sin(before)])
            axes.plot(
                [at[0], straight[0]],
                [at[1], straight[1]],
                color="0.4",
                lw=0.8,
                ls=(0, (3, 2)),
                zorder=2,
            )
            sweep = np.linspace(before, turned, 30)
            axes.plot(
                at[0] + 15 * np.cos(sweep),
                at[1] - 15 * np.sin(sweep),
                color=colour,
                lw=1.2,
                zorder=3,
            )
            middle = (before + turned) / 2
            position = at + 18 * np.array([np.cos(middle), -np.sin(middle)])
            axes.annotate(
                f"θ {NAMES[k]} > 0", tuple(position), fontsize=8, color=colour, va="center"
            )
            frame(axes, at, turned, colour, 10.0)
            if k == 0:
                aside = np.array([-np.sin(turned), -np.cos(turned)])
                arrow(axes, end + 8 * aside, at + 8 * aside, "0.3", "<->", 0.9)
                middle_of = (at + end) / 2 + 12 * aside
                look = {
                    "rotation": -float(np.rad2deg(turned)),
                    "rotation_mode": "anchor",
                    "fontsize": 8,
                    "color": "0.3",
                }
                axes.annotate(
                    "offset of pip = [45, 0, 0] mm",
                    tuple(middle_of),
                    ha="center",
                    va="center",
                    **look,
                )
            at = end
        arrow(axes, np.array([-24.0, -20.0]), np.array([-24.0, -34.0]), "0.2", width=1.6)
        axes.annotate(
            "gravity = [0, 0, −9.81] m/s²", (-21, -28), fontsize=8, color="0.2", va="center"
        )
        said = "+ centre of a link\n⊗ y points into the page: a positive turn\nabout y takes x down"
        axes.annotate(said, (-28, -54), fontsize=8, color="0.3")
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_xlim(-32, 88)
        axes.set_ylim(-66, 18)
        save_figure(made, FOLDER / "frames.png")


def main() -> None:
    """Write all drawings."""
    frames()
    save_figure(draw_rig(load_rig("finger-n-plus-1")), FOLDER / "finger.png")
    rig = load_rig("finger-2n")
    log = simulate(rig, "finger")
    plot_estimates(
        [estimate(log, rig, name) for name in ("adaptive", "inextensible")],
        FOLDER / "finger-angles.png",
    )


if __name__ == "__main__":
    main()
