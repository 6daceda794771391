"""The terms of a discrepancy, for symbols and for arrays alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.rig import Discrepancy, factors

Floats = NDArray[np.float64]

MARGIN = 0.5
"""Terms go on beyond the range they were learned in, by this share of half of it; further out they stay as they are."""


def limits(discrepancy: Discrepancy) -> tuple[Floats, Floats]:
    """Return between which values the terms follow each reading and angle [SI], (m + n_joints,) each.

    Args:
        discrepancy: with its range.
    """
    low, high = np.asarray(discrepancy.low), np.asarray(discrepancy.high)
    half = np.maximum((high - low) / 2.0, 1e-12)
    return low - MARGIN * half, high + MARGIN * half


def variables(
    channels: Sequence[str],
    joints: Sequence[str],
    scaled: Sequence[Any],
    plays: Mapping[int, Any],
    magnitude: Callable[[Any], Any] = np.abs,
) -> dict[str, Any]:
    """Return name → value of what terms are products of.

    Args:
        channels: names of the sensors, m of them.
        joints: names of the joints.
        scaled: scaled readings, then scaled angles by the filter; numbers, symbols or arrays, m + n_joints of them.
        plays: index of a channel → its reading after a play.
        magnitude: the function |·| for what they are.
    """
    m = len(channels)
    values: dict[str, Any] = {f"angle({joint})": scaled[m + j] for j, joint in enumerate(joints)}
    for i, name in enumerate(channels):
        values[name], values[f"abs({name})"] = scaled[i], magnitude(scaled[i])
        if i in plays:
            values[f"play({name})"] = plays[i]
    return values


def columns(terms: Sequence[str], values: Mapping[str, Any], one: Any) -> list[Any]:
    """Return the terms' values.

    Args:
        terms: to build.
        values: from `variables`.
        one: the constant, of the kind of the others.
    """
    built = []
    for term in terms:
        product = one
        for factor in factors(term):
            product = product * values[factor]
        built.append(product)
    return built


def played(values: Floats, half: float) -> Floats:
    """Return readings after a play of a half-width: z⁺ = min(max(z, x − w), x + w), (Visintin, 1994).

    Args:
        values: x, (k,).
        half: w.
    """
    play, after = float(values[0]), np.empty(len(values))
    for k, value in enumerate(values.tolist()):
        play = min(max(play, value - half), value + half)
        after[k] = play
    return after
