"""Figures of a fit: each log before and after the fit, and the remaining errors against angle,
speed and load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.arrays import Floats
from distal.logs import Log, shown, true_angles
from distal.results import (
    BAND_ALPHA,
    BLACK,
    PANELS,
    Estimate,
    colour,
    curve_style,
    figure,
    legend_above,
    plot_estimates,
)
from distal.rig import Rig
from distal.run import log_health

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


POINTS = 1200
"""Number of points that are drawn along a log, about; up to twice as many may be. Source:
layout.
"""

BINS = 16
"""Number of bins of the residuals. Source: layout."""

FEWEST = 10
"""Least number of samples in a bin that is drawn: one for each tenth. Source: layout."""


def draw_traces(log: Log, before: Estimate, after: Estimate, rig: Rig) -> Figure:
    """Return a figure over one log: truth, estimates before and after the fit, their errors,
    innovations, forces and health.
    """
    # fewer points keep a page with a dozen logs small; a printed line shows no more
    rows = slice(None, None, max(1, len(log) // POINTS))
    words = log_health(log, rig)
    estimates = [_thinned(after, rows, "after"), _thinned(before, rows, "before")]
    title = shown(
        Path(log.source).name
    )  # any name of a file can be drawn: what is not printable is escaped
    return plot_estimates(
        estimates, title=title, panels=PANELS, log=log.select(rows), rig=rig, health=words[rows]
    )


def _thinned(estimate: Estimate, rows: slice, name: str) -> Estimate:
    """Return an estimate with some of its rows only, under another name."""
    columns = ("time", "means", "variances", "innovations", "innovation_variances")
    truths = None if estimate.truths is None else estimate.truths[rows]
    return replace(
        estimate,
        estimator=name,
        truths=truths,
        **{key: getattr(estimate, key)[rows] for key in columns},
    )


def draw_residuals(
    logs: Sequence[Log], before: Sequence[Estimate], after: Sequence[Estimate], rig: Rig
) -> Figure:
    """Return a figure of the errors against angle, speed and load, before and after the fit.

    Curves show the median, bands the middle 80 %. A curve that is not flat shows physics that the
    rig lacks. Where no log has a truth, the innovations of the first compared sensor are drawn
    instead of the errors.
    """
    force = next(iter(rig.sensors_of("force") or rig.sensors_of("tension")), None)
    truths = [true_angles(log, rig.joint_names) for log in logs]
    pairs = [(i, j) for i in range(len(logs)) for j in range(len(rig.joints))]
    with_truth = [
        (i, j)
        for i, j in pairs
        if (true := truths[i]) is not None and np.isfinite(true[:, j]).any()
    ]
    chosen = with_truth or pairs
    angles = [
        np.rad2deg((after[i].angles if (true := truths[i]) is None else true)[:, j])
        for i, j in chosen
    ]
    speeds = [_smooth_speed(logs[i].time, angle) for (i, _), angle in zip(chosen, angles)]
    against = {"angle θ [°]": angles, "speed [°/s]": speeds}
    if force is not None:
        readings = [logs[i].channels[force.name] for i, _ in chosen]
        against[f"{force.name} [{force.si}]"] = readings
    with figure(1, len(against), (7.2, 2.9), sharey=True) as (drawing, panels):
        for name, estimates, colour in (("before", before, 1), ("after", after, 0)):
            residuals = [
                _residuals(truths[i] if with_truth else None, estimates[i], j) for i, j in chosen
            ]
            for axes, (label, columns) in zip(panels, against.items()):
                _draw_binned(axes, np.concatenate(columns), np.concatenate(residuals), colour, name)
                axes.set_xlabel(label)
        panels[0].set_ylabel(
            "error [°]" if with_truth else f"innovation / its std, {after[0].measured[0]}"
        )
        for axes in panels:
            axes.axhline(0.0, color=BLACK, lw=0.6)
        legend_above(panels[0])
    return drawing


def _residuals(truth: Floats | None, estimate: Estimate, joint: int) -> Floats:
    if truth is not None:
        return np.rad2deg(estimate.angles[:, joint] - truth[:, joint])
    return estimate.innovations[:, 0] / np.sqrt(estimate.innovation_variances[:, 0])


def _smooth_speed(time: Floats, angle: Floats) -> Floats:
    """Return the mean speed of an angle over a tenth of a second around each stamp, (k,); NaN where
    the angle is known nowhere.
    """
    finite = np.isfinite(angle)
    if not finite.any():
        return np.full_like(angle, np.nan)
    before, after = (np.interp(time + t, time[finite], angle[finite]) for t in (-0.05, 0.05))
    speed: Floats = (after - before) / 0.1
    return speed


def _draw_binned(axes: Axes, x: Floats, y: Floats, index: int, name: str) -> None:
    """Draw the quantiles of y in bins of x, which reach over all but a hundredth of its samples."""
    finite = np.isfinite(x) & np.isfinite(y)
    x = x[finite]
    y = y[finite]
    if not len(x):
        return
    low, high = np.quantile(x, [0.005, 0.995])
    edges = np.linspace(low, high, BINS + 1)
    number = np.digitize(x, edges[1:-1])
    bins = [k for k in range(BINS) if np.count_nonzero(number == k) >= FEWEST]
    centres = (edges[1:] + edges[:-1])[bins] / 2.0
    quantiles = [np.quantile(y[number == k], [0.1, 0.5, 0.9]) for k in bins]
    lower, median, upper = np.reshape(quantiles, (-1, 3)).T
    axes.fill_between(centres, lower, upper, color=colour(index), alpha=BAND_ALPHA, lw=0)
    style = curve_style(index)
    axes.plot(centres, median, lw=1.4, marker="o", ms=2.5, label=name, **style)
