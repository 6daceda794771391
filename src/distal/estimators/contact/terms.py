"""The terms of a contact's torque, for symbols and for arrays alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.estimators.discrepancy import columns as products
from distal.estimators.discrepancy import played
from distal.rig import Contact

Floats = NDArray[np.float64]


def columns(
    contact: Contact,
    scaled: Sequence[Any],
    slipping: Mapping[int, Any],
    one: Any,
    magnitude: Callable[[Any], Any] = np.abs,
) -> list[Any]:
    """Return the terms' values.

    Args:
        contact: which terms.
        scaled: scaled readings, m of them.
        slipping: index of a channel → which way it last moved, −1 to 1.
        one: the constant, of the kind of the others.
        magnitude: the function |·| for what they are.
    """
    values: dict[str, Any] = {}
    for i, name in enumerate(contact.channels):
        values[name], values[f"abs({name})"] = scaled[i], magnitude(scaled[i])
        if i in slipping:
            values[f"slip({name})"] = slipping[i]
    return products(contact.terms, values, one)


def slips(values: Floats, half: float) -> Floats:
    """Return which way readings last moved, (x − z)/w with z⁺ = min(max(z, x − w), x + w), (k,).

    Args:
        values: x, (k,).
        half: w.
    """
    return (values - played(values, half)) / half


def design(contact: Contact, readings: Floats) -> Floats:
    """Return the terms over a log, (k, n_terms).

    Args:
        contact: terms, scales and ranges.
        readings: of the channels, missing ones held, (k, m), whole, since slips remember.
    """
    scaled = (readings - np.asarray(contact.centre)) / np.asarray(contact.scale)
    slipping = {i: slips(scaled[:, i], contact.slip) for i in contact.slipping}
    return np.column_stack(columns(contact, list(scaled.T), slipping, np.ones(len(readings))))


def outside(contact: Contact, readings: Floats) -> Floats:
    """Return how far readings are outside the learned range, 0 within; 1 is half a range beyond its end, (k,).

    Args:
        contact: with the range.
        readings: (k, m).
    """
    low, high = np.asarray(contact.low), np.asarray(contact.high)
    half = np.maximum((high - low) / 2.0, 1e-12)
    far: Floats = np.maximum(0.0, np.max(np.maximum(low - readings, readings - high) / half, axis=1))
    return far
