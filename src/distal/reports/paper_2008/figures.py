"""Figures 2 to 5 of the 2008 paper, simulated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from distal.confidence import BAND, COVERED_TEXT
from distal.reports.paper_2008.claims import SIDES, potentiometer_errors
from distal.reports.paper_2008.series import PLANTS, SeriesRun
from distal.results import (
    BLACK,
    SOFT,
    TRUTH,
    band_colour,
    curve_style,
    figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIGURES = {
    "figure-2": "series-1-soft",
    "figure-3": "series-2",
    "figure-4": "series-2-medium",
    "figure-5": "series-2-high",
}
"""Name of a figure → its scenario; the paper does not print the higher weights of its figures 4 and
5.
"""

CAPTIONS = {
    "figure-2": "Series 1: the link is moved by hand, 2 N on each tendon, k = 403 N/m. The angle "
    "from each potentiometer, tendons taken as inextensible, against the encoder.",
    "figure-3": "Series 2: 2 N against 6 N, k = 806 N/m. Inextensible estimate, simulation from "
    "the measured forces alone, and Kalman filters; below, the errors of all but the first with "
    f"the {COVERED_TEXT} band of adaptive. The link rests afterwards, up to 8 s.",
    "figure-4": "Series 2 at higher tension: 3 N against 9 N.",
    "figure-5": "Series 2 at the highest tension: 4 N against 12 N.",
}
"""Name of a figure → its caption."""

FILTERS = {"ekf-2008": 1, "ekf": 2, "adaptive": 0, "simulation": 4, "inextensible": 3}
"""Estimate in the figures of Series 2 → index of its colour and dash."""

NAMES = {"simulation": "simulation alone", "ekf-2008": "2008 filter", "ekf": "ekf, exact noise"}
"""Estimator → its label in figures, where that is not its own name."""

AFTER = 0.4
"""Time that the figures show after the link has come to rest [s]. Source: layout."""


def first_run(runs: Sequence[SeriesRun], series: str, plant: str) -> SeriesRun:
    """Return the run of a series on a plant with the first seed, which is the one in the
    figures.
    """
    return next(run for run in runs if run.series == series and run.plant == plant)


def end_of_motion(shown: Sequence[SeriesRun]) -> float:
    """Return the time at which the figures of some runs end [s]: `AFTER` the link has come to rest
    in all.
    """
    ends = []
    for run in shown:
        theta = run.log.truth["theta"]
        moving = np.flatnonzero(np.abs(theta - theta[-1]) > np.deg2rad(0.1))
        ends.append(float(run.log.time[moving[-1]]) if len(moving) else 0.0)
    return float(min(max(ends) + AFTER, shown[0].log.time[-1]))


def draw_figure(name: str, runs: Sequence[SeriesRun]) -> Figure:
    """Return one of `FIGURES`: the plant with the friction of Table 1 beside that with more.

    Curves are of the first seed.
    """
    shown = [first_run(runs, FIGURES[name], plant.name) for plant in PLANTS]
    n = len(shown)
    ratios = [1.6, 1]
    with figure(2, n, (7.2, 5.2), sharex=True, sharey="row", height_ratios=ratios) as drawn:
        drawing, axes = drawn
        for top, bottom, run in zip(axes[:n], axes[n:], shown):
            readings = np.rad2deg(run.log.channels["encoder"])
            style = {"color": SOFT, "linewidth": 2.2, "drawstyle": "steps-post"}
            top.plot(run.log.time, readings, label="encoder (1°)", **style)
            top.plot(run.log.time, np.rad2deg(run.log.truth["theta"]), label="truth", **TRUTH)
            if name == "figure-2":
                _draw_potentiometers(top, bottom, run)
            else:
                _draw_filters(top, bottom, run)
            top.set_title(f"plant with {run.plant}", fontsize=9, loc="left")
            bottom.axhline(0.0, color=BLACK, linewidth=0.6)
            bottom.set_xlabel("time [s]")
        if name != "figure-2":
            axes[0].set_xlim(0.7, end_of_motion(shown))
        axes[0].set_ylabel("link angle θ [°]")
        axes[n].set_ylabel("error [°]")
        legend = axes[0].get_legend_handles_labels()
        drawing.legend(*legend, loc="outside lower center", ncols=n + 2, fontsize=8)
    return drawing


def _draw_potentiometers(top: Axes, bottom: Axes, run: SeriesRun) -> None:
    truth = np.rad2deg(run.log.truth["theta"])
    for i, (side, error) in enumerate(zip(SIDES, np.rad2deg(potentiometer_errors(run)))):
        style = {"linewidth": 1.2, **curve_style(i)}
        top.plot(run.log.time, truth + error, label=f"from {side} potentiometer", **style)
        bottom.plot(run.log.time, error, **style)


def _draw_filters(top: Axes, bottom: Axes, run: SeriesRun) -> None:
    """Draw estimates, their errors but that of inextensible, and the band of adaptive about
    zero.
    """
    for name, index in FILTERS.items():
        estimate = run.estimates[name]
        style = curve_style(index)
        theta = np.rad2deg(estimate.theta)
        top.plot(run.log.time, theta, linewidth=1.2, label=NAMES.get(name, name), **style)
        if name != "inextensible":
            error = np.rad2deg(estimate.errors())
            bottom.plot(run.log.time, error, linewidth=1.1, **style)
    band = np.rad2deg(BAND * run.estimates["adaptive"].theta_std)
    style = {"color": band_colour(), "linewidth": 0}
    bottom.fill_between(run.log.time, -band, band, **style)
    top.fill_between([], [], [], label=f"{COVERED_TEXT} band of adaptive", **style)
