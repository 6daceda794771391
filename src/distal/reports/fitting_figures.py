"""Figures of a fit: before and after along each log, and what is left against angle, speed and load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.arrays import Bools, Floats
from distal.logs import Log, shown, true_angles
from distal.results import BAND_ALPHA, BLACK, COLOURS, DASHES, PANELS, Estimate, figure, legend_above, plot_estimates
from distal.rig import Rig
from distal.run import log_health

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


POINTS = 1200
"""So many points are drawn along a log."""

BINS = 16
"""Bins of the residuals."""

FEWEST = 12
"""A bin with fewer samples is not drawn."""


def draw_traces(log: Log, before: Estimate, after: Estimate, rig: Rig) -> Figure:
    """Return truth, estimate after and before the fit, their errors, and what the filter compared, over one log.

    Args:
        before: estimate with the rig as it came.
        after: with the fitted one.
    """
    # a page with a dozen logs stays small: no more points than a printed line can show
    some, words = slice(None, None, max(1, len(log) // POINTS)), log_health(log, rig)
    one, other = (replace(_some(each, some), estimator=name) for each, name in ((after, "after"), (before, "before")))
    title = shown(Path(log.source).name)  # any name of a file can be drawn: what is not printable is escaped
    return plot_estimates([one, other], title=title, panels=PANELS, log=log.select(some), rig=rig, health=words[some])


def _some(result: Estimate, rows: slice) -> Estimate:
    return replace(
        result,
        time=result.time[rows],
        means=result.means[rows],
        variances=result.variances[rows],
        innovations=result.innovations[rows],
        innovation_variances=result.innovation_variances[rows],
        truths=None if result.truths is None else result.truths[rows],
    )


def draw_residuals(logs: Sequence[Log], before: Sequence[Estimate], after: Sequence[Estimate], rig: Rig) -> Figure:
    """Return the errors against angle, speed and load: median and the middle 80 %, before and after the fit.

    A curve that is not flat is physics that the rig does not have. Where no log has a truth, the innovations of the first
    compared sensor stand for the errors.

    Args:
        logs: with or without truth.
        before: estimates with the rig as it came.
        after: with the fitted one.
    """
    force = next(iter(rig.sensors_of("force") or rig.sensors_of("tension")), None)
    joints = range(len(rig.joints))
    truths = [true_angles(log, [joint.name for joint in rig.joints]) for log in logs]
    none = np.zeros(len(joints), dtype=np.bool_)
    there: list[Bools] = [none if t is None else np.any(np.isfinite(t), axis=0) for t in truths]
    known = [(i, j) for i, own in enumerate(there) for j in joints if own[j]]
    chosen = known or [(i, j) for i in range(len(logs)) for j in joints]
    against: list[tuple[str, list[Floats]]] = [("angle θ [°]", []), ("speed [°/s]", [])]
    if force is not None:
        against.append((f"{force.name} [{force.si}]", []))
    for i, j in chosen:
        true = truths[i]
        angle = np.rad2deg((after[i].angles if true is None else true)[:, j])
        against[0][1].append(angle)
        against[1][1].append(smooth_speed(logs[i].time, angle))
        if force is not None:
            against[2][1].append(logs[i].channels[force.name])
    with figure(1, len(against), (7.2, 2.9), sharey=True) as (made, axes):
        for name, group, i in (("before", before, 1), ("after", after, 0)):
            left = [_left(truths[k] if known else None, group[k], j) for k, j in chosen]
            for place, (label, values) in zip(axes, against):
                _binned(place, np.concatenate(values), np.concatenate(left), i, name)
                place.set_xlabel(label)
        axes[0].set_ylabel("error [°]" if known else f"innovation / its std, {after[0].measured[0]}")
        for place in axes:
            place.axhline(0.0, color=BLACK, lw=0.6)
        legend_above(axes[0])
    return made


def _left(truth: Floats | None, result: Estimate, joint: int) -> Floats:
    if truth is not None:
        left: Floats = np.rad2deg(result.angles[:, joint] - truth[:, joint])
        return left
    ratio: Floats = result.innovations[:, 0] / np.sqrt(result.innovation_variances[:, 0])
    return ratio


def smooth_speed(time: Floats, angle: Floats) -> Floats:
    """Return the slope of an angle over a tenth of a second, (k,).

    Args:
        time: stamps [s], (k,).
        angle: (k,).
    """
    there = np.isfinite(angle)
    filled = np.interp(time, time[there], angle[there]) if there.any() else np.zeros_like(time)
    half = 0.05
    speed: Floats = (np.interp(time + half, time, filled) - np.interp(time - half, time, filled)) / (2 * half)
    return speed


def _binned(axes: Axes, x: Floats, y: Floats, index: int, name: str) -> None:
    there = np.isfinite(x) & np.isfinite(y)
    x, y = x[there], y[there]
    if len(x) < FEWEST:
        return
    low, high = np.quantile(x, [0.005, 0.995])
    edges = np.linspace(low, high, BINS + 1) if high > low else np.array([low - 0.5, low + 0.5])
    number = np.clip(np.digitize(x, edges) - 1, 0, len(edges) - 2)
    centres, middle = [], []
    for k in range(len(edges) - 1):
        inside = y[number == k]
        if len(inside) >= FEWEST:
            centres.append((edges[k] + edges[k + 1]) / 2)
            middle.append(np.quantile(inside, [0.1, 0.5, 0.9]))
    if not centres:
        return
    table = np.array(middle)
    axes.fill_between(centres, table[:, 0], table[:, 2], color=COLOURS[index], alpha=BAND_ALPHA, lw=0)
    axes.plot(centres, table[:, 1], color=COLOURS[index], ls=DASHES[index], lw=1.4, marker="o", ms=2.5, label=name)
