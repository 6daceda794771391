"""A filter whose torque from outside is what logs taught of it; its own state goes on with its own."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.estimators.contact.terms import columns
from distal.rig import Contact

Floats = NDArray[np.float64]


def memory_size(contact: Contact) -> int:
    """Return how many numbers are remembered: what was put in place of torques and variances, readings, places of plays.

    Args:
        contact: as learned.
    """
    return 2 * len(contact.joints) + len(contact.channels) + len(contact.slipping)


def numbers_of(contact: Contact) -> Floats:
    """Return the parameters of a contact's map in `touched_function`, (n,).

    Args:
        contact: as learned.
    """
    common = [np.asarray(getattr(contact, name)) for name in ("centre", "scale", "low", "high")]
    common += [np.array([contact.slip, contact.band]), np.asarray(contact.spread)]
    for joint in contact.joints:
        common += [np.asarray(joint.coefficients), np.asarray(joint.covariance).ravel(), np.array([joint.std])]
    return np.concatenate(common)


def first_memory(contact: Contact, values: ca.SX, mask: ca.SX) -> ca.SX:
    """Return what is remembered before the first sample: nothing in place of anything, readings as in that sample.

    Args:
        contact: as learned.
        values: of the channels, those of the contact first.
        mask: 1 where there is a value.
    """
    held = [ca.if_else(mask[i] > 0, values[i], contact.centre[i]) for i in range(len(contact.channels))]
    places = [(held[i] - contact.centre[i]) / contact.scale[i] for i in contact.slipping]
    return ca.vertcat(ca.SX.zeros(2 * len(contact.joints)), *held, *places)


def touched_function(
    inner: ca.Function, size: int, width: int, places: Sequence[int | None], torques: Sequence[int], contact: Contact
) -> ca.Function:
    """Return (carry, x, p) → (carry⁺, y) of a filter that says φᵀ b of the torque from outside instead of its own.

    The variance is c² (φᵀ C φ + s²) + f² (s² + spread²), with c = `band`, f being how far readings are outside the learned
    range. The filter's own torque and variance are put back before its next step.

    Args:
        inner: the filter.
        size: number of its states, n.
        width: number of its channels, those of the contact first.
        places: for each channel of the contact where in the carry its drive's place stands, None for what is read.
        torques: which states are the torques from outside, one for each joint of the contact.
        contact: as learned; its coefficients and ranges are parameters (`numbers_of`).
    """
    nj, m, k, own = len(contact.joints), len(contact.channels), len(contact.slipping), inner.size1_in(0)
    carry, x = ca.MX.sym("carry", own + memory_size(contact)), ca.MX.sym("x", inner.size1_in(1))
    given = inner.size1_in(2)
    p = ca.MX.sym("p", given + len(numbers_of(contact)))
    at, diagonal = list(torques), [size + j * (size + 1) for j in torques]
    before, memory = ca.MX(carry[:own]), carry[own:]
    before[at] -= memory[:nj]
    before[diagonal] -= memory[nj : 2 * nj]
    following, y = inner(before, x, p[:given])
    read = ca.vertcat(*(0 if place is None else following[place] for place in places))
    held = memory[2 * nj : 2 * nj + m]
    learned = _learned(contact, width, [place is not None for place in places])(
        held, memory[2 * nj + m : 2 * nj + m + k], x, read, p[given:]
    )
    added = learned[: 2 * nj] - ca.vertcat(following[at], following[diagonal])
    following[at] += added[:nj]
    following[diagonal] += added[nj:]
    after = ca.vertcat(following, added, learned[2 * nj :])
    return ca.Function("touched", [carry, x, p], [after, y], ["carry", "x", "p"], ["next", "y"])


def _learned(contact: Contact, width: int, placed: Sequence[bool]) -> ca.Function:
    """Return (held, plays, x, places, numbers) → torques, their variances, readings, plays."""
    nj, m, size = len(contact.joints), len(contact.channels), len(contact.terms)
    held, plays = ca.SX.sym("held", m), ca.SX.sym("plays", len(contact.slipping))
    x, places = ca.SX.sym("x", 1 + 2 * width), ca.SX.sym("places", m)
    lengths = [m, m, m, m, 1, 1, nj, *(nj * [size, size * size, 1])]
    numbers = ca.SX.sym("numbers", sum(lengths))
    centre, scale, low, high, half, band, spread, *own = ca.vertsplit(
        numbers, [int(i) for i in np.cumsum([0, *lengths])]
    )
    readings = [places[i] if placed[i] else ca.if_else(x[1 + width + i] > 0, x[1 + i], held[i]) for i in range(m)]
    scaled = [(readings[i] - centre[i]) / scale[i] for i in range(m)]
    after, slipping = [], {}
    for k, i in enumerate(contact.slipping):
        after.append(ca.fmin(ca.fmax(plays[k], scaled[i] - half), scaled[i] + half))
        slipping[i] = (scaled[i] - after[-1]) / half
    phi = ca.vertcat(*columns(contact, scaled, slipping, ca.SX(1), ca.fabs))
    far = ca.SX(0)
    for i in range(m):
        beyond = ca.fmax(low[i] - readings[i], readings[i] - high[i])
        far = ca.fmax(far, beyond / ca.fmax((high[i] - low[i]) / 2, 1e-12))
    torques, variances = [], []
    for j in range(nj):
        coefficients, covariance, std = own[3 * j : 3 * j + 3]
        matrix = ca.reshape(covariance, size, size)
        torques.append(ca.dot(coefficients, phi))
        variances.append(band**2 * (ca.bilin(matrix, phi, phi) + std**2) + far**2 * (std**2 + spread[j] ** 2))
    result = ca.cse(ca.densify(ca.vertcat(*torques, *variances, *readings, *after)))
    return ca.Function("contact", [held, plays, x, places, numbers], [result])
