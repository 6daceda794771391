"""Panels below the angle: innovations, measured forces, and the health of a stream."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from distal.arrays import Floats
from distal.logs import Log
from distal.results.curves import Curves
from distal.results.style import COLOURS, PALE, SOFT, curve_style, legend_above, plain
from distal.rig import Rig

if TYPE_CHECKING:
    from matplotlib.axes import Axes


HEALTH_COLOURS = {"ok": COLOURS[2], "untested": COLOURS[5]}
"""Health word → its colour, for words that are no alarm; all other words are orange."""

WIDEST = 5.0
"""Least limit of the axis of innovations [standard deviations]. Source: layout."""


def draw_innovations(axes: Axes, time: Floats, result: Curves) -> None:
    """Draw a result's innovations in standard deviations, with lines at ±2, between which 95 %
    should be.

    Args:
        time: time since the first sample [s], (k,).
    """
    ratios = result.innovations / np.sqrt(result.innovation_variances)
    axes.axhspan(-2.0, 2.0, color=PALE, linewidth=0)
    for edge in (-2.0, 2.0):
        axes.axhline(edge, color=SOFT, linewidth=0.7, linestyle=(0, (4, 2)))
    for i, name in enumerate(result.measured):
        axes.plot(
            time,
            ratios[:, i],
            color=COLOURS[i % len(COLOURS)],
            linewidth=0.7,
            alpha=0.8,
            label=plain(name),
        )
    sizes = np.abs(ratios[np.isfinite(ratios)])
    limit = max(WIDEST, 1.2 * float(np.quantile(sizes, 0.98))) if len(sizes) else WIDEST
    axes.set_ylim(-limit, limit)
    axes.set_ylabel("innovation [σ]")
    legend_above(axes, most=6)
    if not len(sizes):
        axes.text(
            0.5,
            0.5,
            "nothing is compared",
            transform=axes.transAxes,
            ha="center",
            va="center",
            color=SOFT,
        )


def draw_forces(axes: Axes, log: Log, rig: Rig) -> None:
    """Draw the forces and motor torques at the drives and the tensions that a log has."""
    sensors = [
        s for s in rig.sensors if s.measures in ("force", "tension") and s.name in log.channels
    ]
    for i, sensor in enumerate(sensors):
        label = plain(sensor.name)
        force = log.channels[sensor.name]
        axes.plot(log.time - log.time[0], force, linewidth=0.9, label=label, **curve_style(i))
    units = sorted({sensor.si for sensor in sensors})
    axes.set_ylabel(f"measured [{', '.join(units)}]")
    legend_above(axes, most=6)
    if not sensors:
        axes.text(
            0.5,
            0.5,
            "no force is measured",
            transform=axes.transAxes,
            ha="center",
            va="center",
            color=SOFT,
        )


def draw_health(axes: Axes, time: Floats, health: Sequence[str]) -> None:
    """Draw as bars, in one row for each health word, when the word held.

    Args:
        time: time since the first sample [s], (k,).
        health: the health word of each sample, (k,).
    """
    words = sorted(set(health), key=lambda word: (word != "ok", word))
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    for row, word in enumerate(words):
        edges = np.flatnonzero(np.diff(np.array(health) == word, prepend=False, append=False))
        spans = [(time[a], time[b - 1] - time[a] + step) for a, b in zip(edges[::2], edges[1::2])]
        axes.broken_barh(
            spans, (row - 0.35, 0.7), color=HEALTH_COLOURS.get(word, COLOURS[1]), linewidth=0
        )
    axes.set_yticks(range(len(words)), words, fontsize=7)
    axes.set_ylim(len(words) - 0.4, -0.6)
    axes.set_ylabel("health")
