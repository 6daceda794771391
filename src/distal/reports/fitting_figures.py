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
    names = rig.joint_names
    force = next(iter(rig.sensors_of("force") or rig.sensors_of("tension")), None)
    truths = [
        np.full_like(result.angles, np.nan) if (true := true_angles(log, names)) is None else true
        for log, result in zip(logs, after)
    ]
    has_truth = any(np.isfinite(truth).any() for truth in truths)
    angles = [
        np.rad2deg(truth if has_truth else result.angles) for truth, result in zip(truths, after)
    ]
    against = {
        "angle θ [°]": angles,
        "speed [°/s]": [_smooth_speed(log.time, angle) for log, angle in zip(logs, angles)],
    }
    if force is not None:
        readings = [log.channels[force.name][:, None] for log in logs]
        against[f"{force.name} [{force.si}]"] = readings
    with figure(1, len(against), (7.2, 2.9), sharey=True) as (drawing, panels):
        for name, estimates, colour in (("before", before, 1), ("after", after, 0)):
            if has_truth:
                residuals = [np.rad2deg(e.angles - t) for e, t in zip(estimates, truths)]
            else:
                first = (e.innovations / np.sqrt(e.innovation_variances) for e in estimates)
                residuals = [scaled[:, :1] for scaled in first]
            for axes, (label, columns) in zip(panels, against.items()):
                both = [np.broadcast_arrays(x, y) for x, y in zip(columns, residuals)]
                x, y = (np.concatenate([np.ravel(part) for part in parts]) for parts in zip(*both))
                _draw_binned(axes, x, y, colour, name)
                axes.set_xlabel(label)
        panels[0].set_ylabel(
            "error [°]" if has_truth else f"innovation / its std, {after[0].measured[0]}"
        )
        for axes in panels:
            axes.axhline(0.0, color=BLACK, lw=0.6)
        legend_above(panels[0])
    return drawing


def _smooth_speed(time: Floats, angles: Floats) -> Floats:
    """Return the mean speeds of angles over a tenth of a second around each stamp, (k, n_joints);
    NaN where an angle is known nowhere.
    """
    speeds = np.full_like(angles, np.nan)
    for j, angle in enumerate(angles.T):
        finite = np.isfinite(angle)
        if finite.any():
            ends = (np.interp(time + t, time[finite], angle[finite]) for t in (-0.05, 0.05))
            speeds[:, j] = np.diff([*ends], axis=0) / 0.1
    return speeds


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
