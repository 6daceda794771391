"""Figures of the 2008 paper's reproduction: a summary, and the paper's figures 2 to 5."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.paper_2008.claims import SIDES, potentiometer_errors, rms
from benchmarks.paper_2008.series import PLANTS, SERIES_2, SeriesRun
from distal.confidence import BAND, COVERED_TEXT
from distal.results import (
    BLACK,
    SOFT,
    TRUTH,
    band_colour,
    colour,
    curve_style,
    figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SUMMARY = "summary"
"""Name of the figure that sums up the reproduction."""

POSITIONED = "positioned"
"""Name of the figure of the closed loops."""

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
    SUMMARY: "The same motion at rising tension, on a plant with more friction than the paper's "
    "Table 1 says. Top: the link's angle. Bottom: the error of each estimate, with its RMS over "
    "all seeds. All three know Table 1 and nothing else. The shaded band is where adaptive says "
    "that the angle is.",
    "figure-2": "Series 1: the link is moved by hand, 2 N on each tendon, k = 403 N/m. The angle "
    "from each potentiometer, tendons taken as inextensible, against the encoder.",
    "figure-3": "Series 2: 2 N against 6 N, k = 806 N/m. Inextensible estimate, simulation from "
    "the measured forces alone, and Kalman filters; below, the errors of all but the first with "
    f"the {COVERED_TEXT} band of adaptive. The link rests afterwards, up to 8 s.",
    "figure-4": "Series 2 at higher tension: 3 N against 9 N.",
    "figure-5": "Series 2 at the highest tension: 4 N against 12 N.",
    POSITIONED: "Steps and ramps of 20°, the same controller with three feedbacks: an encoder of "
    "1° in the joint, the estimate of adaptive, and the displacements over the radii.",
}
"""Name of a figure → its caption."""

SHOWN = {"inextensible": 3, "ekf-2008": 1, "adaptive": 0}
"""Estimator in the summary → index of its colour and dash."""

FILTERS = {"ekf-2008": 1, "ekf": 2, "adaptive": 0, "simulation": 4, "inextensible": 3}
"""Estimator in the figures of Series 2 → index of its colour and dash."""

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
    """Return the figure `SUMMARY`, three estimates at rising tension on the plant with more
    friction, or one of `FIGURES`: the plant with the friction of Table 1 beside that with more.

    Curves are of the first seed, RMS errors of all seeds.
    """
    observed = PLANTS[1].name
    if name == SUMMARY:
        shown = [first_run(runs, series, observed) for series in SERIES_2]
        titles = [run.log.source.removeprefix("Series 2: ") for run in shown]
    else:
        shown = [first_run(runs, FIGURES[name], plant.name) for plant in PLANTS]
        titles = ["plant with the friction of Table 1", f"plant with {observed}"]
    n = len(shown)
    size = (7.2, 4.3 if name == SUMMARY else 5.2)
    with figure(2, n, size, sharex=True, sharey="row", height_ratios=[1.6, 1]) as (drawing, axes):
        for top, bottom, run, title in zip(axes[:n], axes[n:], shown, titles):
            if name != SUMMARY:
                readings = np.rad2deg(run.log.channels["encoder"])
                style = {"color": SOFT, "linewidth": 2.2, "drawstyle": "steps-post"}
                top.plot(run.log.time, readings, label="encoder (1°)", **style)
            top.plot(run.log.time, np.rad2deg(run.log.truth["theta"]), label="truth", **TRUTH)
            if name == "figure-2":
                _draw_potentiometers(top, bottom, run)
            elif name == SUMMARY:
                _draw_filters(top, bottom, run, SHOWN, errors=SHOWN)
                _write_errors(top, runs, run)
            else:
                _draw_filters(top, bottom, run, FILTERS, errors=set(FILTERS) - {"inextensible"})
            top.set_title(title, fontsize=9, loc="left")
            bottom.axhline(0.0, color=BLACK, linewidth=0.6)
            bottom.set_xlabel("time [s]")
        if name != "figure-2":
            axes[0].set_xlim(0.7, end_of_motion(shown))
        axes[0].set_ylabel("link angle θ [°]")
        axes[n].set_ylabel("error [°]")
        legend = axes[0].get_legend_handles_labels()
        drawing.legend(*legend, loc="outside lower center", ncols=n + 2, fontsize=8)
    return drawing


def _write_errors(top: Axes, runs: Sequence[SeriesRun], shown: SeriesRun) -> None:
    beside = {"transform": top.transAxes, "ha": "right"}
    top.text(0.98, 0.37, "RMS error", fontsize=8, **beside)
    for row, (name, index) in enumerate(SHOWN.items()):
        error_text = f"{rms(runs, shown.series, name, shown.plant):.1f}°"
        bold = {"color": colour(index), "fontsize": 8.5, "weight": "bold"}
        top.text(0.98, 0.27 - 0.1 * row, error_text, **bold, **beside)


def _draw_potentiometers(top: Axes, bottom: Axes, run: SeriesRun) -> None:
    truth = np.rad2deg(run.log.truth["theta"])
    for i, (side, error) in enumerate(zip(SIDES, np.rad2deg(potentiometer_errors(run)))):
        style = {"linewidth": 1.2, **curve_style(i)}
        top.plot(run.log.time, truth + error, label=f"from {side} potentiometer", **style)
        bottom.plot(run.log.time, error, **style)


def _draw_filters(
    top: Axes, bottom: Axes, run: SeriesRun, names: Mapping[str, int], errors: Container[str]
) -> None:
    """Draw estimates, the errors of some of them, and the band of adaptive about zero.

    Args:
        names: name of an estimate → index of its colour and dash.
        errors: names of the estimates whose errors are drawn.
    """
    for name, index in names.items():
        estimate = run.estimates[name]
        style = curve_style(index)
        theta = np.rad2deg(estimate.theta)
        top.plot(run.log.time, theta, linewidth=1.2, label=NAMES.get(name, name), **style)
        if name in errors:
            error = np.rad2deg(estimate.errors())
            bottom.plot(run.log.time, error, linewidth=1.1, **style)
    band = np.rad2deg(BAND * run.estimates["adaptive"].theta_std)
    style = {"color": band_colour(), "linewidth": 0}
    bottom.fill_between(run.log.time, -band, band, **style)
    top.fill_between([], [], [], label=f"{COVERED_TEXT} band of adaptive", **style)
