"""A filter with a discrepancy: its angle is corrected after each sample, its own state goes on without the correction."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.estimators.discrepancy.terms import MARGIN, columns, limits, variables
from distal.rig import Discrepancy

Floats = NDArray[np.float64]

NEVER = 1e6
"""Age of a reading that there has not been yet [s]."""


def memory_size(discrepancy: Discrepancy) -> int:
    """Return how many numbers are remembered: corrections and variances, readings held, their ages, plays.

    Args:
        discrepancy: as learned.
    """
    return 2 * len(discrepancy.joints) + 2 * len(discrepancy.channels) + len(discrepancy.played)


def corrected_function(
    inner: ca.Function, size: int, width: int, places: Sequence[int | None], discrepancy: Discrepancy
) -> ca.Function:
    """Return (carry, x, p) → (carry⁺, y) of a filter whose angle is corrected: θ + δ, with the variance of both.

    The filter's own carry goes first. Its angles and their variances hold the correction of the last sample, which is
    taken off before the next step: what is learned of the model's error changes no state of the model.

    Args:
        inner: the filter, whose first states are the joints' angles.
        size: number of its states, n.
        width: number of its channels, those of the discrepancy first.
        places: for each channel of the discrepancy where in the carry its drive's place stands, None for what is read.
        discrepancy: as learned; its coefficients and ranges are parameters (`numbers_of`).
    """
    nj, own, given = len(discrepancy.joints), inner.size1_in(0), inner.size1_in(2)
    carry, x = ca.MX.sym("carry", own + memory_size(discrepancy)), ca.MX.sym("x", inner.size1_in(1))
    p = ca.MX.sym("p", given + len(numbers_of(discrepancy)))
    angles, diagonal = list(range(nj)), [size + j * (size + 1) for j in range(nj)]
    before, memory = ca.MX(carry[:own]), carry[own:]
    before[angles] -= memory[:nj]
    before[diagonal] -= memory[nj : 2 * nj]
    following, y = inner(before, x, p[:given])
    read = ca.vertcat(*(0 if place is None else following[place] for place in places))
    correction = _correction(discrepancy, width, [place is not None for place in places])
    remembered = correction(memory[2 * nj :], x, read, following[angles], following[diagonal], p[given:])
    following[angles] += remembered[:nj]
    following[diagonal] += remembered[nj : 2 * nj]
    return ca.Function(
        "corrected", [carry, x, p], [ca.vertcat(following, remembered), y], ["carry", "x", "p"], ["next", "y"]
    )


def _correction(d: Discrepancy, width: int, placed: Sequence[bool]) -> ca.Function:
    """Return (held, ages, plays; x; places; angles; variances; numbers) → (δ, what it adds to P, held, ages, plays).

    δ = φᵀ b. The angle's variance becomes own² (1 + ∂δ/∂θ)² P + φᵀ C φ + s² + f² (s² + spread²), f being how far readings
    are outside the learned range, and for each reading that is missing since a time a the square of ∂δ/∂reading times
    min(rate · a, its whole range).
    """
    nj, m, k, size = len(d.joints), len(d.channels), len(d.played), len(d.terms)
    memory, x = ca.SX.sym("memory", 2 * m + k), ca.SX.sym("x", 1 + 2 * width)
    places, angles, own_variances = ca.SX.sym("places", m), ca.SX.sym("angles", nj), ca.SX.sym("variances", nj)
    lengths = [*(5 * [m + nj]), 1, m * m, 1, 1, nj, *(nj * [size, size * size, 1])]
    numbers = ca.SX.sym("numbers", sum(lengths))
    centre, scale, low, high, rate, play, distance, reach, share, spread, *own = ca.vertsplit(numbers, _ends(lengths))
    held, ages, plays = ca.vertsplit(memory, _ends([m, m, k]))
    there = [x[1 + width + i] > 0 for i in range(m)]
    aged = [ca.if_else(there[i], 0, ages[i] + x[0]) for i in range(m)]
    readings = [places[i] if placed[i] else ca.if_else(there[i], x[1 + i], held[i]) for i in range(m)]
    symbols = ca.SX.sym("symbols", m + nj)
    half = ca.fmax((high - low) / 2, 1e-12)
    inside = [
        ca.fmin(ca.fmax(symbols[i], low[i] - MARGIN * half[i]), high[i] + MARGIN * half[i]) for i in range(m + nj)
    ]
    scaled = [(inside[i] - centre[i]) / scale[i] for i in range(m + nj)]
    after = {i: ca.fmin(ca.fmax(plays[at], scaled[i] - play), scaled[i] + play) for at, i in enumerate(d.played)}
    values = variables(d.channels, [joint.joint for joint in d.joints], scaled, after, ca.fabs)
    phi = ca.vertcat(*columns(d.terms, values, ca.SX(1)))
    z = (symbols[:m] - centre[:m]) / scale[:m]
    far = ca.fmax(0, ca.sqrt(ca.fmax(_form(distance, z), 0)) / reach - 1)
    for i in range(m + nj):
        far = ca.fmax(far, ca.fmax(low[i] - symbols[i], symbols[i] - high[i]) / half[i])
    deltas, variances = [], []
    for j in range(nj):
        coefficients, covariance, std = own[3 * j : 3 * j + 3]
        delta = ca.dot(coefficients, phi)
        slopes = ca.jacobian(delta, symbols)
        variance = _form(covariance, phi) + std**2 + far**2 * (std**2 + spread[j] ** 2)
        variance += ((share * (1 + slopes[m + j])) ** 2 - 1) * own_variances[j]
        for i in range(m):
            variance += (slopes[i] * ca.fmin(rate[i] * aged[i], 2 * half[i])) ** 2
        deltas.append(delta)
        variances.append(variance)
    result = ca.vertcat(*deltas, *variances, *readings, *aged, *(after[i] for i in d.played))
    result = ca.cse(ca.densify(ca.substitute(result, symbols, ca.vertcat(*readings, angles))))
    return ca.Function("discrepancy", [memory, x, places, angles, own_variances, numbers], [result])


def _ends(lengths: Sequence[int]) -> list[int]:
    return [int(i) for i in np.cumsum([0, *lengths])]


def _form(matrix: ca.SX, vector: ca.SX) -> ca.SX:
    """Return vᵀ M v of a symmetric matrix that stands row by row."""
    n = vector.numel()
    total = ca.SX(0)
    for i in range(n):
        total += vector[i] * ca.dot(matrix[i * n : (i + 1) * n], vector)
    return total


def numbers_of(discrepancy: Discrepancy) -> Floats:
    """Return the parameters of a discrepancy in `corrected_function`, (n,).

    Args:
        discrepancy: as learned.
    """
    d = discrepancy
    common = [np.asarray(getattr(d, name)) for name in ("centre", "scale", "low", "high", "rate")]
    common += [np.array([d.play]), np.asarray(d.distance).ravel(), np.array([d.reach, d.own]), np.asarray(d.spread)]
    for joint in d.joints:
        common += [np.asarray(joint.coefficients), np.asarray(joint.covariance).ravel(), np.array([joint.std])]
    return np.concatenate(common)


def first_memory(discrepancy: Discrepancy, values: ca.SX, mask: ca.SX) -> ca.SX:
    """Return what is remembered before the first sample: no correction, and readings as in that sample, or the usual ones.

    Args:
        discrepancy: as learned.
        values: of the channels, those of the discrepancy first.
        mask: 1 where there is a value.
    """
    d = discrepancy
    m = len(d.channels)
    held = [ca.if_else(mask[i] > 0, values[i], d.centre[i]) for i in range(m)]
    ages = [ca.if_else(mask[i] > 0, 0.0, NEVER) for i in range(m)]
    low, high = limits(d)
    inside = [ca.fmin(ca.fmax(held[i], low[i]), high[i]) for i in d.played]
    plays = [(value - d.centre[i]) / d.scale[i] for value, i in zip(inside, d.played)]
    return ca.vertcat(ca.SX.zeros(2 * len(d.joints)), *held, *ages, *plays)
