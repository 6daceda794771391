"""Least squares with correlated errors: independent samples, Gaussian updates, and what readings tell nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SMALLEST_STD = 1e-6
"""The std of a residual is not taken as smaller than this [rad]."""


def correlated_samples(residuals: Floats) -> float:
    """Return how many samples count as one, 1 + 2 Σ ρ_k up to the first ρ_k that is not positive (Sokal, 1997, §3).

    Args:
        residuals: in the order of time, evenly spaced, (k,).
    """
    centred, n = residuals - residuals.mean(), len(residuals)
    power = np.abs(np.fft.rfft(centred, 2 * n)) ** 2
    correlation = np.fft.irfft(power)[:n]
    if not correlation[0] > 0.0:
        return 1.0
    correlation = correlation / correlation[0]
    ended = np.flatnonzero(correlation <= 0.0)
    last = int(ended[0]) if len(ended) else n
    return float(max(1.0, 1.0 + 2.0 * correlation[1:last].sum()))


@dataclass(frozen=True)
class Line:
    """Coefficients of one log by least squares.

    Args:
        coefficients: b = (XᵀX)⁻¹Xᵀy, (n,).
        covariance: s² N (XᵀX)⁻¹, N samples counting as one, (n, n).
        std: s, with the degrees of freedom that are left: s² = RSS/(k − n N).
        correlated: N.
        freedom: k/N − n, at least 1.
    """

    coefficients: Floats
    covariance: Floats
    std: float
    correlated: float
    freedom: float


def line(design: Floats, angles: Floats) -> Line:
    """Return the least-squares coefficients, their covariance with correlated residuals, and the residuals' std.

    Args:
        design: X of full rank, (k, n).
        angles: y [rad], (k,).
    """
    k, n = design.shape
    inverse = np.asarray(np.linalg.pinv(design.T @ design), dtype=np.float64)
    coefficients = inverse @ (design.T @ angles)
    residuals = angles - design @ coefficients
    correlated = correlated_samples(residuals)
    # below one independent sample beyond the coefficients nothing could be said at all
    freedom = max(k / correlated - n, 1.0)
    std = max(float(np.sqrt(np.mean(residuals**2) * (freedom + n) / freedom)), SMALLEST_STD)
    return Line(coefficients, std**2 * correlated * inverse, std, correlated, freedom)


def updated(mean: Floats, covariance: Floats, gram: Floats, moment: Floats, spread: float) -> tuple[Floats, Floats]:
    """Return mean and covariance of coefficients after samples, by P⁺ = (P⁻¹ + XᵀX/r)⁻¹ in a form that needs no P⁻¹.

    Args:
        mean: before, (n,).
        covariance: P, may be singular, (n, n).
        gram: XᵀX of the samples' columns X, (n, n).
        moment: Xᵀy of their angles y [rad], (n,).
        spread: r, variance of a sample times the number of samples that count as one.
    """
    n = len(mean)
    root = _root(covariance)
    told = root.T @ gram @ root / spread + np.eye(n)
    gain = root @ np.linalg.solve(told, root.T)
    after = mean + gain @ (moment - gram @ mean) / spread
    return after, 0.5 * (gain + gain.T)


def surprise(mean: Floats, covariance: Floats, gram: Floats, moment: Floats, spread: float) -> float:
    """Return the squared Mahalanobis distance of a log's own coefficients from what was expected, for n numbers.

    Args:
        mean: expected, (n,).
        covariance: of that, (n, n).
        gram: XᵀX, (n, n).
        moment: Xᵀy [rad], (n,).
        spread: as for `updated`.
    """
    values, vectors = np.linalg.eigh(gram / spread)
    seen = values > 1e-9 * values[-1]
    scale = np.sqrt(values[seen])
    off = (vectors[:, seen].T @ (moment - gram @ mean) / spread) / scale
    expected = (scale[:, None] * (vectors[:, seen].T @ covariance @ vectors[:, seen])) * scale + np.eye(int(seen.sum()))
    return float(off @ np.linalg.solve(expected, off))


def independent(values: Floats, noise: Floats) -> NDArray[np.bool_]:
    """Return which columns tell something of their own: what the others before it leave is more than its noise.

    Args:
        values: centred readings, (k, m).
        noise: standard deviation of each sensor's random error, in the units of `values`, (m,).
    """
    kept = np.zeros(values.shape[1], dtype=bool)
    for i in range(values.shape[1]):
        column = values[:, i]
        if kept.any():
            others = values[:, kept]
            column = column - others @ np.linalg.lstsq(others, column, rcond=None)[0]
        own, size = float(np.sqrt(np.mean(column**2))), float(np.sqrt(np.mean(values[:, i] ** 2)))
        # noise alone leaves one std of it; a rounded constant leaves nothing
        kept[i] = own > max(ABOVE_NOISE * noise[i], RANK * size)
    return kept


ABOVE_NOISE = 1.5
"""A sensor is used where what it alone tells has this many standard deviations of its noise."""

RANK = 1e-6
"""The same without noise: the share of its size below which a column is a combination of others."""


def _root(covariance: Floats) -> Floats:
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    root: Floats = vectors * np.sqrt(np.maximum(values, 0.0))
    return root
