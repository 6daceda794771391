"""Self-diagnosis: do the innovations look as the filter expects, and if not, which sensor disagrees."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distal.results.estimate import Estimate

Floats = NDArray[np.float64]

LARGE = 1.7
"""Mean squared normalised innovation of a channel from which on it is larger than expected."""

WINDOW = 1.0
"""Length of the windows in which a channel is looked at [s]."""

SELDOM = 0.5
"""Share of a channel's samples that are compared, below which that is said."""

MOST = 0.5
"""Share of the windows since then in which a channel that disagrees is larger than expected."""

WHITE = 0.5
"""Correlation of neighbouring innovations from which on they are not white."""


@dataclass(frozen=True)
class Diagnosis:
    """What the innovations say of the rig and the sensors.

    Args:
        channels: names of the channels with an innovation.
        ratios: mean of ν²/S per channel; 1 is expected, less where a force tells little.
        correlations: of neighbouring normalised innovations, per channel.
        since: per channel, the time from which on it disagrees to the end [s], or NaN.
        text: one plain line.
    """

    channels: tuple[str, ...]
    ratios: tuple[float, ...]
    correlations: tuple[float, ...]
    since: tuple[float, ...]
    text: str

    @property
    def consistent(self) -> bool:
        """Whether nothing disagrees."""
        return self.text.startswith("consistent") and "friction" not in self.text


def diagnose(estimate: Estimate) -> Diagnosis:
    """Return what the innovations of an estimate say.

    Args:
        estimate: over a log.
    """
    names = estimate.measured
    if not names:
        return Diagnosis(
            (),
            (),
            (),
            (),
            "not checked: no sensor is compared (this estimator has no innovations, or the rig no force sensor)",
        )
    scaled = estimate.innovations / np.sqrt(estimate.innovation_variances)
    # the first moments still settle what the prior left open
    settled = estimate.time >= estimate.time[0] + min(0.5, 0.1 * float(np.ptp(estimate.time)))
    ratios = tuple(_mean(scaled[settled, i] ** 2) for i in range(len(names)))
    correlations = tuple(_neighbours(scaled[settled, i]) for i in range(len(names)))
    since = tuple(_since(estimate.time, scaled[:, i]) for i in range(len(names)))
    text = _text(names, ratios, correlations, since) + _undeclared(estimate) + _hardly_compared(names, scaled)
    return Diagnosis(names, ratios, correlations, since, text)


def _undeclared(estimate: Estimate) -> str:
    """Return what to add where the filter found friction at a drive that the rig does not declare."""
    found = []
    for i, name in enumerate(estimate.state_names):
        value, std = estimate.means[-1, i], np.sqrt(estimate.variances[-1, i])
        prior = np.sqrt(estimate.variances[0, i])
        if name.startswith("friction_") and value > 0.25 * prior and value > 3.0 * std:
            found.append(f"{value:.2g} at '{name.removeprefix('friction_')}'")
    if not found:
        return ""
    return f"; but friction that the rig does not have [SI]: {', '.join(found)} (set drives.*.friction, or a hand acts)"


def _hardly_compared(names: tuple[str, ...], scaled: Floats) -> str:
    """Return what to add where little of a channel could be compared: then little can disagree."""
    shares = np.mean(np.isfinite(scaled), axis=0)
    few = [f"{100 * share:.0f} % of {name}" for name, share in zip(names, shares) if share < SELDOM]
    if not few:
        return ""
    return f"; but only {', '.join(few)} could be compared (missing, or the slider at a stop)"


def _text(
    names: tuple[str, ...], ratios: tuple[float, ...], correlations: tuple[float, ...], since: tuple[float, ...]
) -> str:
    large = [i for i, ratio in enumerate(ratios) if ratio > LARGE]
    drifting = [names[i] for i, value in enumerate(correlations) if value > WHITE and ratios[i] > 0.5]
    if drifting and len(drifting) == len(names) and not large:
        return (
            f"innovations of {', '.join(drifting)} drift: something acts that the rig does not have "
            "(a hand: external_torque; friction at a drive)"
        )
    late = [i for i, start in enumerate(since) if np.isfinite(start)]
    if len(late) == 1 and (
        len(large) <= 1 or ratios[late[0]] > 4 * max(r for i, r in enumerate(ratios) if i != late[0])
    ):
        i = late[0]
        return f"sensor {names[i]} disagrees from {since[i]:.1f} s on: its innovations are too large to the end"
    if len(large) == 1 and len(names) > 1:
        i = large[0]
        return f"sensor {names[i]} disagrees: innovations {np.sqrt(ratios[i]):.1f}× larger than expected"
    if large:
        factor = np.sqrt(np.mean([ratios[i] for i in large]))
        return f"innovations {factor:.1f}× larger than expected: the rig's stiffness, friction or geometry is off"
    return "consistent: the innovations are no larger than expected"


def _mean(values: Floats) -> float:
    there = values[np.isfinite(values)]
    return float(np.mean(there)) if len(there) else float("nan")


def _neighbours(values: Floats) -> float:
    there = values[np.isfinite(values)]
    if len(there) < 20 or float(np.std(there)) == 0.0:
        return 0.0
    return float(np.clip(np.mean(there[1:] * there[:-1]) / np.mean(there**2), -1, 1))


def _since(time: Floats, scaled: Floats) -> float:
    """Return from when on a channel is large to the end: in the last window, and in most of all since then."""
    edges = np.arange(time[0], time[-1] + WINDOW, WINDOW)
    starts, large = [], []
    for start, end in itertools.pairwise(edges):
        inside = scaled[(time >= start) & (time < end)]
        inside = inside[np.isfinite(inside)]
        if len(inside) >= 5:
            starts.append(float(start))
            large.append(bool(np.median(np.abs(inside)) > 1.35))  # twice the median of a normal distribution
    if not large or not large[-1]:
        return float("nan")
    first = next(start for k, start in enumerate(starts) if large[k] and np.mean(large[k:]) >= MOST)
    if first == time[0]:
        return float("nan")
    inside = np.flatnonzero((time >= first - WINDOW) & (np.abs(scaled) > 3.0))
    return float(time[inside[0]]) if len(inside) else first
