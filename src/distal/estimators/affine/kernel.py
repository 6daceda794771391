"""The affine map as a function of one sample, with what it remembers between samples."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.estimators.affine.mapping import half_ranges
from distal.rig import Affine

Floats = NDArray[np.float64]

NEVER = 1e6
"""Age of a reading that there has not been yet [s]."""


def affine_function(n_joints: int, n_channels: int, n_positions: int) -> ca.Function:
    """Return (carry, x, p) → (carry⁺, y) of the affine estimator; p is that of `numbers_of`.

    θ_j = φᵀ b_j with φ = (1, (s − centre)/scale, directions); the variance is that of `predicted`, and for each reading
    that is missing since a time a the square of its coefficient times min(rate · a, its whole range).

    Args:
        n_joints: number of joints.
        n_channels: number of sensors, m; those of positions first.
        n_positions: number of position sensors.
    """
    nj, m, k = n_joints, n_channels, n_positions
    n, size = nj + 1, 1 + m + k
    carry, x = ca.SX.sym("carry", n + n * n + 2 * m + k), ca.SX.sym("x", 1 + 2 * m)
    lengths = [m, m, m, m, m, m, k, m * m, 1, *(nj * [size, size * size, 1])]
    p = ca.SX.sym("p", sum(lengths))
    centre, scale, low, high, half, rate, band, distance, reach, *own = ca.vertsplit(
        p, [int(i) for i in np.cumsum([0, *lengths])]
    )
    held, age, play = ca.vertsplit(carry[n + n * n :], [0, m, 2 * m, 2 * m + k])
    dt, values, mask = x[0], x[1 : 1 + m], x[1 + m :]
    readings = [ca.if_else(mask[i] > 0, values[i], held[i]) for i in range(m)]
    ages = [ca.if_else(mask[i] > 0, 0, age[i] + dt) for i in range(m)]
    plays = [ca.fmin(ca.fmax(play[i], readings[i] - band[i]), readings[i] + band[i]) for i in range(k)]
    scaled = [(readings[i] - centre[i]) / scale[i] for i in range(m)]
    columns = ca.vertcat(1, *scaled, *((readings[i] - plays[i]) / band[i] for i in range(k)))
    squared = _form(distance, ca.vertcat(*scaled))
    far = ca.fmax(0, ca.sqrt(ca.fmax(squared, 0)) / reach - 1)
    for i in range(m):
        far = ca.fmax(far, ca.fmax(low[i] - readings[i], readings[i] - high[i]) / half[i])
    angles, variances = [], []
    for j in range(nj):
        coefficients, covariance, std = own[3 * j : 3 * j + 3]
        angles.append(ca.dot(coefficients, columns))
        variance = _form(covariance, columns) + std**2 * (1 + far**2)
        for i in range(m):
            moved = ca.fmin(rate[i] * ages[i], 2 * half[i])
            variance += (coefficients[1 + i] / scale[i] * moved) ** 2
        variances.append(variance)
    spread = ca.diag(ca.vertcat(*variances, 0))
    following = ca.vertcat(*angles, far, ca.densify(ca.reshape(spread, n * n, 1)), *readings, *ages, *plays)
    return ca.Function("affine", [carry, x, p], [following, ca.SX.zeros(1)], ["carry", "x", "p"], ["next", "y"])


def _form(matrix: ca.SX, vector: ca.SX) -> ca.SX:
    """Return vᵀ M v of a symmetric matrix that stands row by row."""
    n = vector.numel()
    total = ca.SX(0)
    for i in range(n):
        total += vector[i] * ca.dot(matrix[i * n : (i + 1) * n], vector)
    return total


def numbers_of(affine: Affine, noise: Floats) -> Floats:
    """Return the parameters of `affine_function`, (n_p,).

    Args:
        affine: the map.
        noise: standard deviation of each channel's random error [SI], (m,).
    """
    common = [
        np.asarray(affine.centre),
        np.asarray(affine.scale),
        np.asarray(affine.low),
        np.asarray(affine.high),
        half_ranges(affine, noise),
        np.asarray(affine.rate),
        np.asarray(affine.dead_band),
        np.asarray(affine.distance).ravel(),
        np.array([affine.reach]),
    ]
    for joint in affine.joints:
        common += [np.asarray(joint.coefficients), np.asarray(joint.covariance).ravel(), np.array([joint.std])]
    return np.concatenate(common)


def prior_of(affine: Affine, angles: Floats, stds: Floats, n_p: int) -> ca.Function:
    """Return (values, mask, p) → (mean, covariance's diagonal, memory) before the first sample.

    A sensor without a value is taken to be at the centre of what was learned, and never seen.

    Args:
        affine: the map.
        angles: of the joints before any sample [rad], (n_joints,).
        stds: of these [rad], (n_joints,).
        n_p: numbers in p.
    """
    m, k = len(affine.channels), len(affine.dead_band)
    values, mask = ca.SX.sym("values", m), ca.SX.sym("mask", m)
    held = [ca.if_else(mask[i] > 0, values[i], affine.centre[i]) for i in range(m)]
    ages = [ca.if_else(mask[i] > 0, 0, NEVER) for i in range(m)]
    mean, spread = ca.SX(ca.DM([*angles, 0.0])), ca.SX(ca.DM([*(stds**2), 0.0]))
    return ca.Function(
        "prior", [values, mask, ca.SX.sym("p", n_p)], [mean, spread, ca.vertcat(*held, *ages, *held[:k])]
    )
