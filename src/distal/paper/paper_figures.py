"""Figures of the 2008 paper's reproduction: a summary, and the paper's figures 2 to 5."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from distal.confidence import BAND
from distal.paper.claims import potentiometer_errors, rms
from distal.paper.series import PLANTS, SERIES_2, SeriesRun
from distal.results import BAND_ALPHA, BLACK, COLOURS, DASHES, SOFT, TRUTH, draw_estimate, figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SUMMARY = "summary"
"""Name of the figure that sums up the reproduction."""

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
    "Table 1 says. Top: the "
    "link's angle. Bottom: the error of each estimate, with its RMS over all seeds. All three "
    "know Table 1 and nothing "
    "else. On the left Table 1 is nearly right: the filter of 2008, which takes it as exact, wins "
    "there. Further right it "
    "is wrong, and adaptive, which allows for that, wins. The shaded band is where adaptive says "
    "that the angle is.",
    "figure-2": "Series 1: the link is moved by hand, 2 N on each tendon, k = 403 N/m. The angle "
    "from each "
    "potentiometer, tendons taken as inextensible, against the encoder.",
    "figure-3": "Series 2: 2 N against 6 N, k = 806 N/m. Inextensible estimate, simulation from "
    "the measured forces "
    "alone, and Kalman filters; below, the errors of all but the first with the 95 % band of "
    "adaptive. The link "
    "rests afterwards, up to 8 s.",
    "figure-4": "Series 2 at higher tension: 3 N against 9 N.",
    "figure-5": "Series 2 at the highest tension: 4 N against 12 N.",
}
"""Name of a figure → its caption."""

SHOWN = {"inextensible": 3, "ekf-2008": 1, "adaptive": 0}
"""Estimator in the summary → index of its colour and dash."""

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


def draw_summary(runs: Sequence[SeriesRun]) -> Figure:
    """Return the figure that sums up the reproduction: three estimates at rising tension on the
    plant with more friction.

    Curves are of the first seed, RMS errors of all seeds.
    """
    plant = PLANTS[1].name
    on_plant = [run for run in runs if run.plant == plant]
    shown = [first_run(runs, series, plant) for series in SERIES_2]
    end = end_of_motion(shown)
    with figure(2, 3, (7.2, 4.3), sharex=True, sharey="row", height_ratios=[1.5, 1]) as (
        drawing,
        axes,
    ):
        for column, run in enumerate(shown):
            top = axes[column]
            bottom = axes[3 + column]
            top.plot(run.log.time, np.rad2deg(run.log.truth["theta"]), label="truth", **TRUTH)
            for row, (name, index) in enumerate(SHOWN.items()):
                estimate = run.estimates[name]
                draw_estimate(top, estimate, index, band=False, label=NAMES.get(name, name))
                error = np.rad2deg(estimate.errors())
                bottom.plot(
                    run.log.time,
                    error,
                    color=COLOURS[index],
                    linestyle=DASHES[index],
                    linewidth=1.2,
                )
                pooled = rms(on_plant, run.series, name)
                top.text(
                    0.98,
                    0.27 - 0.1 * row,
                    f"{pooled:.1f}°",
                    color=COLOURS[index],
                    fontsize=8.5,
                    weight="bold",
                    transform=top.transAxes,
                    ha="right",
                )
            top.text(0.98, 0.37, "RMS error", fontsize=8, transform=top.transAxes, ha="right")
            band = np.rad2deg(BAND * run.estimates["adaptive"].theta_std)
            bottom.fill_between(
                run.log.time, -band, band, color=COLOURS[0], alpha=BAND_ALPHA, linewidth=0
            )
            bottom.axhline(0.0, color=BLACK, linewidth=0.6)
            bottom.set_xlim(0.7, end)
            bottom.set_xlabel("time [s]")
            top.set_title(run.log.source.removeprefix("Series 2: "), fontsize=9, loc="left")
        top.fill_between(
            [],
            [],
            [],
            color=COLOURS[0],
            alpha=BAND_ALPHA,
            linewidth=0,
            label="95 % band of adaptive",
        )
        axes[0].set_ylabel("link angle θ [°]")
        axes[3].set_ylabel("error [°]")
        drawing.legend(
            *axes[2].get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=8
        )
    return drawing


def draw_figure(name: str, runs: Sequence[SeriesRun]) -> Figure:
    """Return the figure `SUMMARY`, or one of `FIGURES`: the plant with the friction of Table 1
    beside that with more.
    """
    if name == SUMMARY:
        return draw_summary(runs)
    shown = [first_run(runs, FIGURES[name], plant.name) for plant in PLANTS]
    with figure(2, 2, (7.2, 5.2), sharex=True, sharey="row", height_ratios=[2, 1.2]) as (
        drawing,
        axes,
    ):
        for column, run in enumerate(shown):
            top = axes[column]
            bottom = axes[2 + column]
            readings = np.rad2deg(run.log.channels["encoder"])
            truth = np.rad2deg(run.log.truth["theta"])
            top.plot(
                run.log.time,
                readings,
                color=SOFT,
                linewidth=2.2,
                drawstyle="steps-post",
                label="encoder (1°)",
            )
            top.plot(run.log.time, truth, label="truth", **TRUTH)
            (_potentiometers if name == "figure-2" else _filters)(top, bottom, run)
            top.set_title(
                f"plant with {'the ' * run.plant.startswith('friction')}{run.plant}",
                fontsize=9,
                loc="left",
            )
            bottom.axhline(0.0, color=BLACK, linewidth=0.6)
            bottom.set_xlabel("time [s]")
        if name != "figure-2":
            axes[0].set_xlim(0.7, end_of_motion(shown))
        axes[0].set_ylabel("link angle θ [°]")
        axes[2].set_ylabel("error [°]")
        drawing.legend(
            *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8
        )
    return drawing


def _potentiometers(top: Axes, bottom: Axes, run: SeriesRun) -> None:
    truth = np.rad2deg(run.log.truth["theta"])
    for i, (side, error) in enumerate(zip(("left", "right"), potentiometer_errors(run))):
        degrees = np.rad2deg(error)
        label = f"from {side} potentiometer"
        top.plot(
            run.log.time,
            truth + degrees,
            color=COLOURS[i],
            linestyle=DASHES[i],
            linewidth=1.2,
            label=label,
        )
        bottom.plot(run.log.time, degrees, color=COLOURS[i], linestyle=DASHES[i], linewidth=1.2)


def _filters(top: Axes, bottom: Axes, run: SeriesRun) -> None:
    for name, i in {
        "ekf-2008": 1,
        "ekf": 2,
        "adaptive": 0,
        "simulation": 4,
        "inextensible": 3,
    }.items():
        estimate = run.estimates[name]
        draw_estimate(top, estimate, i, band=False, label=NAMES.get(name, name))
        if name != "inextensible":
            error = np.rad2deg(estimate.errors())
            bottom.plot(run.log.time, error, color=COLOURS[i], linestyle=DASHES[i], linewidth=1.1)
    band = np.rad2deg(BAND * run.estimates["adaptive"].theta_std)
    bottom.fill_between(run.log.time, -band, band, color=COLOURS[0], alpha=BAND_ALPHA, linewidth=0)
    top.fill_between(
        [], [], [], color=COLOURS[0], alpha=BAND_ALPHA, linewidth=0, label="95 % band of adaptive"
    )
