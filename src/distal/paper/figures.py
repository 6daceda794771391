"""Figures 2 to 5 of the 2008 paper, on simulated rigs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from distal.analysis import PLANTS, Run
from distal.results import BAND, COLOURS, DASHES, draw_estimate, figure
from distal.rig import tendon_angle_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIGURES = {
    "figure-2": "series-1-soft",
    "figure-3": "series-2",
    "figure-4": "series-2-medium",
    "figure-5": "series-2-high",
}
"""Figure → scenario; the paper's figures 4 and 5 are at higher weights that it does not print."""

CAPTIONS = {
    "figure-2": "Series 1: the link is moved by hand, 2 N on each tendon, k = 403 N/m. The angle from each potentiometer, "
    "tendons taken as inextensible, against the encoder.",
    "figure-3": "Series 2: 2 N against 6 N, k = 806 N/m. Inextensible estimate, free simulation and Kalman filters; "
    "below, the errors of all but the first with the 95 % band of adaptive.",
    "figure-4": "Series 2 at higher tension: 3 N against 9 N.",
    "figure-5": "Series 2 at the highest tension: 4 N against 12 N.",
}


def draw_figure(name: str, runs: Sequence[Run]) -> Figure:
    """Return one of the paper's figures, the plant "as printed" beside the one "as observed".

    Args:
        name: key of `FIGURES`.
        runs: of `all_runs`; the first seed is drawn.
    """
    shown = [next(run for run in runs if run.series == FIGURES[name] and run.plant == plant) for plant in PLANTS]
    with figure(2, 2, (7.2, 5.2), sharex=True, sharey="row", height_ratios=[2, 1.2]) as (made, axes):
        for column, run in enumerate(shown):
            top, bottom = axes[column], axes[2 + column]
            if name == "figure-2":
                _potentiometers(top, bottom, run)
            else:
                _filters(top, bottom, run)
            top.set_title(f"plant {run.plant}", fontsize=9, loc="left")
            bottom.axhline(0.0, color="black", linewidth=0.6)
            bottom.set_xlabel("time [s]")
        axes[0].set_ylabel("link angle θ [°]")
        axes[2].set_ylabel("error [°]")
        handles, labels = axes[0].get_legend_handles_labels()
        made.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8)
    return made


def _encoder(axes: Axes, run: Run) -> None:
    degrees = np.rad2deg(run.log.channels["encoder"])
    axes.plot(run.log.time, degrees, color="0.55", linewidth=2.2, drawstyle="steps-post", label="encoder (1°)")
    axes.plot(run.log.time, np.rad2deg(run.log.truth["theta"]), color="black", linewidth=1.0, label="truth")


def _potentiometers(top: Axes, bottom: Axes, run: Run) -> None:
    _encoder(top, run)
    result = run.estimates["inextensible"]
    for i, side in enumerate(("left", "right")):
        theta = np.rad2deg(result.state(tendon_angle_name(side)))
        style: dict[str, Any] = {"color": COLOURS[i], "linestyle": DASHES[i], "linewidth": 1.2}
        top.plot(run.log.time, theta, label=f"from {side} potentiometer", **style)
        bottom.plot(run.log.time, theta - np.rad2deg(run.log.truth["theta"]), **style)


def _filters(top: Axes, bottom: Axes, run: Run) -> None:
    _encoder(top, run)
    for i, name in enumerate(("ekf-2008", "adaptive", "simulation", "inextensible")):
        result = run.estimates[name]
        label = {"simulation": "free simulation"}.get(name, name)
        draw_estimate(top, result, i, band=False, label=label)
        if name != "inextensible":
            error = np.rad2deg(result.errors())
            bottom.plot(run.log.time, error, color=COLOURS[i], linestyle=DASHES[i], linewidth=1.1)
    band = np.rad2deg(BAND * run.estimates["adaptive"].theta_std)
    bottom.fill_between(run.log.time, -band, band, color=COLOURS[1], alpha=0.25, linewidth=0)
    top.fill_between([], [], [], color=COLOURS[1], alpha=0.25, linewidth=0, label="95 % band of adaptive")
