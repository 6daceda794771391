"""Panels below the angle: innovations, measured forces, and the health of a stream."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from distal.arrays import Floats
from distal.logs import Log
from distal.results.style import (
    COLOURS,
    PALE,
    SOFT,
    Curves,
    colour,
    curve_style,
    from_start,
    legend_above,
    plain,
)
from distal.rig import Rig, Sensor

if TYPE_CHECKING:
    from matplotlib.axes import Axes


HEALTH_COLOURS = {"ok": COLOURS[2], "untested": COLOURS[5]}
"""Health word → its colour, for words that are no alarm; all other words are orange."""

WIDEST = 5.0
"""Least limit of the axis of innovations [standard deviations]. Source: layout."""


def draw_innovations(axes: Axes, result: Curves) -> None:
    """Draw a result's innovations in standard deviations, with lines at ±2, between which 95 %
    should be.
    """
    ratios = result.innovations / np.sqrt(result.innovation_variances)
    axes.axhspan(-2.0, 2.0, color=PALE, linewidth=0)
    for edge in (-2.0, 2.0):
        axes.axhline(edge, color=SOFT, linewidth=0.7, linestyle=(0, (4, 2)))
    for i, name in enumerate(result.measured):
        style = {"color": colour(i), "linewidth": 0.7, "alpha": 0.8}
        axes.plot(from_start(result.time), ratios[:, i], label=plain(name), **style)
    sizes = np.abs(ratios[np.isfinite(ratios)])
    limit = max(WIDEST, 1.2 * float(np.quantile(sizes, 0.98))) if len(sizes) else WIDEST
    axes.set_ylim(-limit, limit)
    axes.set_ylabel("innovation [σ]")
    _finish(axes, "" if len(sizes) else "nothing is compared")


def draw_forces(axes: Axes, log: Log, rig: Rig) -> None:
    """Draw the forces and motor torques at the drives and the tensions that a log has."""
    sensors = pulls_of(log, rig)
    for i, sensor in enumerate(sensors):
        force = log.channels[sensor.name]
        style = curve_style(i)
        axes.plot(from_start(log.time), force, linewidth=0.9, label=plain(sensor.name), **style)
    axes.set_ylabel(f"measured [{', '.join(sorted({sensor.si for sensor in sensors}))}]")
    _finish(axes, "" if sensors else "no force is measured")


def pulls_of(log: Log, rig: Rig) -> list[Sensor]:
    """Return the sensors of forces, motor torques and tensions whose readings a log has."""
    return [
        sensor
        for sensor in rig.sensors
        if sensor.measures in ("force", "tension") and sensor.name in log.channels
    ]


def _finish(axes: Axes, text: str) -> None:
    """Put the legend above a panel, and a text that says why it is empty into its middle."""
    legend_above(axes, most=6)
    middle = {"ha": "center", "va": "center", "transform": axes.transAxes}
    axes.text(0.5, 0.5, text, color=SOFT, **middle)


def in_order(words: Iterable[str]) -> list[str]:
    """Return the health words that occur, "ok" first, the others by the alphabet."""
    return sorted(set(words), key=lambda word: (word != "ok", word))


def draw_health(axes: Axes, time: Floats, health: Sequence[str]) -> None:
    """Draw as bars, in one row for each health word, when the word held.

    Args:
        time: time since the first sample [s], (k,).
        health: the health word of each sample, (k,).
    """
    words = in_order(health)
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
