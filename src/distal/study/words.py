"""Words for what varies in a study: a column, a value, the parts of a range."""

from __future__ import annotations

from itertools import pairwise
from math import degrees

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools
from distal.rig import in_words
from distal.rounded import rounded
from distal.study.description import Plan
from distal.study.design_space import ESTIMATOR, FEEDBACK, Axis, Value
from distal.study.runs import BUILT

BINS = 4
"""Number of parts into which a range is split [1]. Source: judgement."""

PREFIXES = ((1e3, 1e3, "k"), (0.1, 1.0, ""), (1e-4, 1e-3, "m"), (0.0, 1e-6, "µ"))
"""Prefixes of units, largest first: the smallest size that is written with it, its factor, its
letter.
"""


def words_of(plan: Plan, name: str) -> str:
    """Return in words what a column of the rows holds."""
    path = name.removeprefix(BUILT)
    if path in (ESTIMATOR, FEEDBACK):
        return path
    if path.startswith("sensors.") and path.count(".") == 1:
        words = f"sensor {path.partition('.')[2]}"
    else:
        words = (
            f"common error of {path}" if path in plan.rig.sharing() else in_words(plan.rig, path)
        )
    return f"{words}, as built" if name.startswith(BUILT) else words


def quantity(value: float, unit: str) -> str:
    """Return a value in its SI `unit` as text, with a prefix such as k or m; an angle in
    degrees.
    """
    if unit == "rad":
        return f"{rounded(degrees(value), 3)}°"
    if value == 0.0 or not unit.startswith(tuple("mNsHV")):  # kg has its prefix already
        return f"{value:.3g} {unit}".strip()
    size, prefix = next((size, prefix) for least, size, prefix in PREFIXES if abs(value) >= least)
    return f"{value / size:.3g} {prefix}{unit}"


def parts_of(plan: Plan, axis: Axis, values: NDArray[np.generic]) -> list[tuple[str, Bools]]:
    """Return the parts of an axis: words for each, and which rigs are in it, (n,).

    Args:
        values: what each rig has on this axis, (n,).
    """
    name = words_of(plan, axis.path)
    if axis.choices:
        return [
            (setting_in_words(name, choice, axis.unit), values == choice) for choice in axis.choices
        ]
    edges = [float(axis.at(k / BINS)) for k in range(BINS + 1)]
    numeric = values.astype(np.float64)
    return [
        (
            f"{name} {quantity(low, axis.unit)} to {quantity(high, axis.unit)}",
            (numeric >= low) & ((numeric < high) | (k == BINS)),
        )
        for k, (low, high) in enumerate(pairwise(edges), 1)
    ]


def setting_in_words(name: str, setting: Value, unit: str) -> str:
    """Return in words which `setting` a design has for what is called `name`."""
    if isinstance(setting, bool):
        return f"{'with' if setting else 'without'} {name}"
    return f"{name} {setting}" if isinstance(setting, str) else f"{name} {quantity(setting, unit)}"
