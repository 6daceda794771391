"""Least squares over several logs whose coefficients differ: correlated samples, Gaussian updates,
random effects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distal.arrays import Bools, Floats
from distal.rig import JointMap

EM_ITERATIONS = 100
"""Most steps of expectation–maximisation for the spread between logs."""

EM_SETTLED = 1e-2
"""It ends where a step changes the spread by less than this share."""

SMALLEST_SHARE = 1e-8
"""Combinations of columns with less than this share of the largest one's mean square are left out.
"""

SMALLEST_RESIDUAL = 1e-6
"""The std of a residual is not taken as smaller than this [rad]."""


def correlated_samples(residuals: Floats) -> float:
    """Return how many of evenly spaced samples count as one, 1 + 2 Σ ρ_k up to the first ρ_k ≤ 0
    (Sokal, 1997, §3).
    """
    centred = residuals - residuals.mean()
    n = len(residuals)
    power = np.abs(np.fft.rfft(centred, 2 * n)) ** 2
    correlation = np.fft.irfft(power)[:n]
    if not correlation[0] > 0.0:
        return 1.0
    correlation = correlation / correlation[0]
    ended = np.flatnonzero(correlation <= 0.0)
    last = int(ended[0]) if len(ended) else n
    return float(max(1.0, 1.0 + 2.0 * correlation[1:last].sum()))


@dataclass(frozen=True)
class LogCoefficients:
    """Coefficients b = (XᵀX)⁻¹Xᵀy of one log by least squares, (n,), and their covariance s² N
    (XᵀX)⁻¹.

    N samples count as one (`correlated`); the std s has the degrees of freedom that are left, s² =
    RSS/(k − n N).
    """

    coefficients: Floats
    covariance: Floats
    std: float
    correlated: float


def line(design: Floats, angles: Floats) -> LogCoefficients:
    """Return the least-squares `Line` of `angles` y [rad], (k,), over a `design` X of full rank,
    (k, n).
    """
    k, n = design.shape
    inverse = _inverse(design.T @ design)
    coefficients = inverse @ (design.T @ angles)
    residuals = angles - design @ coefficients
    correlated = correlated_samples(residuals)
    # below one independent sample beyond the coefficients nothing could be said at all
    freedom = max(k / correlated - n, 1.0)
    std = max(float(np.sqrt(np.mean(residuals**2) * (freedom + n) / freedom)), SMALLEST_RESIDUAL)
    return LogCoefficients(coefficients, std**2 * correlated * inverse, std, correlated)


def _inverse(gram: Floats) -> Floats:
    """Return the pseudoinverse of XᵀX, positive semidefinite: directions that rounding may have
    made are left out.
    """
    size = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(gram / np.outer(size, size))
    large = values > ROUNDED * values[-1]
    root = vectors[:, large] / np.sqrt(values[large]) / size[:, None]
    inverse: Floats = root @ root.T
    return inverse


def posterior_of(
    mean: Floats, covariance: Floats, gram: Floats, moment: Floats, spread: float | Floats
) -> tuple[Floats, Floats]:
    """Return mean and covariance of coefficients after samples, by P⁺ = (P⁻¹ + XᵀX/r)⁻¹ in a form
    that needs no P⁻¹.

    Args:
        mean: before, (n,).
        covariance: P, may be singular, (n, n).
        gram: XᵀX of the samples' columns X, (n, n), or of several logs, each updated alone, (logs,
            n, n).
        moment: Xᵀy of their angles y [rad], (n,) or (logs, n).
        spread: r, variance of a sample times the number of samples that count as one; of each log,
            (logs,).
    """
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    r = np.asarray(spread)[..., None]
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    information = root.T @ gram @ root / r[..., None] + np.eye(len(mean))
    gain = root @ np.linalg.solve(information, np.broadcast_to(root.T, information.shape))
    after = mean + np.squeeze(gain @ ((moment - gram @ mean) / r)[..., None], -1)
    return after, 0.5 * (gain + np.swapaxes(gain, -1, -2))


def surprise(
    mean: Floats, covariance: Floats, gram: Floats, moment: Floats, spread: float
) -> float:
    """Return the squared Mahalanobis distance of a log's own n coefficients from what was expected.

    The arguments `mean`, `covariance`, `gram`, `moment` and `spread` are as for `updated`, of one
    log.
    """
    values, vectors = np.linalg.eigh(gram / spread)
    seen = values > 1e-9 * values[-1]
    scale = np.sqrt(values[seen])
    off = (vectors[:, seen].T @ (moment - gram @ mean) / spread) / scale
    expected = (
        scale[:, None] * (vectors[:, seen].T @ covariance @ vectors[:, seen])
    ) * scale + np.eye(int(seen.sum()))
    return float(off @ np.linalg.solve(expected, off))


def independent(values: Floats, noise: Floats) -> Bools:
    """Return which columns have information of their own: the part that earlier ones leave is more
    than the noise.

    The `values` are centred readings, (k, m), `noise` the std of each sensor's random error in
    their units, (m,).
    """
    chosen = np.zeros(values.shape[1], dtype=bool)
    for i in range(values.shape[1]):
        residual = column = values[:, i]
        if chosen.any():
            earlier = values[:, chosen]
            residual = column - earlier @ np.linalg.lstsq(earlier, column, rcond=None)[0]
        rms = float(np.sqrt(np.mean(residual**2)))
        size = float(np.sqrt(np.mean(column**2)))
        # noise alone leaves one std of it; a rounded constant leaves nothing
        chosen[i] = rms > max(ABOVE_NOISE * noise[i], RANK * size)
    return chosen


ROUNDED = 1e-12
"""Eigenvalues of XᵀX, its columns of size one, below this share of the largest are sums of rounding
errors.
"""

ABOVE_NOISE = 1.5
"""A sensor is used where what it alone tells has this many standard deviations of its noise."""

RANK = 1e-6
"""The same without noise: the share of its size below which a column is a combination of others."""


def random_effects(
    joint: JointMap,
    columns: Sequence[int],
    parts: Sequence[tuple[Floats, Floats, float]],
    pooled: bool = False,
) -> tuple[JointMap, float]:
    """Return the coefficients of one joint and the correlation time of the residuals [s].

    Args:
        joint: its coefficients give their number.
        columns: which of them are learned, (n,).
        parts: of each log (design (k, n), angles [rad] (k,), interval [s]).
        pooled: take the mean from all samples together, so that what differs between logs tells it
            too (a load that is constant in each); else from each log's own coefficients.
    """
    full_designs, angles, intervals = zip(*parts)
    if len(parts) == 1:
        only = line(full_designs[0], angles[0])
        return filled_groups(
            joint, columns, only.coefficients, only.covariance, only.std
        ), only.correlated * intervals[0]
    basis = _basis(full_designs)
    designs = [design @ basis for design in full_designs]
    grams = np.array([x.T @ x for x in designs])
    moments = np.array([x.T @ y for x, y in zip(designs, angles)])
    mean = np.linalg.pinv(grams.sum(axis=0)) @ moments.sum(axis=0)
    lines = [line(x, y) for x, y in zip(designs, angles)]
    count = np.array([fit.correlated for fit in lines])
    std = np.sqrt(
        max(
            np.average([fit.std**2 for fit in lines], weights=[len(y) for y in angles]),
            SMALLEST_RESIDUAL**2,
        )
    )
    # wide to start from: as if every coefficient alone explained the residual of the common map
    left = np.concatenate([y - x @ mean for x, y in zip(designs, angles)])
    spread = np.eye(len(mean)) * max(float(np.mean(left**2)), std**2)
    for _ in range(EM_ITERATIONS):
        means, covariances = posterior_of(mean, spread, grams, moments, std**2 * count)
        mean = mean if pooled else means.mean(axis=0)
        off = means - mean
        before = spread
        # the mean is of the same logs: one degree of freedom less
        spread = (off.T @ off + covariances.sum(axis=0)) / (len(parts) - 1)
        if np.abs(spread - before).max() < EM_SETTLED * np.abs(spread).max():
            break
    spread = _shrunk(spread, len(parts))
    residuals = [y - x @ after for x, y, after in zip(designs, angles, means)]
    std = max(float(np.sqrt(np.mean(np.concatenate(residuals) ** 2))), SMALLEST_RESIDUAL)
    times = [
        correlated_samples(residual) * interval for residual, interval in zip(residuals, intervals)
    ]
    covariance = basis @ (spread * (1.0 + 1.0 / len(parts))) @ basis.T
    covariance = 0.5 * (covariance + covariance.T)
    return filled_groups(joint, columns, basis @ mean, covariance, std), float(np.mean(times))


def _basis(designs: Sequence[Floats]) -> Floats:
    """Return W for which the columns of X W are uncorrelated and of size one over all logs, (n, up
    to n).

    The spread between logs is assumed for such columns, so that the assumption does not depend on
    how the same columns are written; combinations that hardly ever differ from zero are left at
    zero.
    """
    rows = np.vstack(designs)
    values, vectors = np.linalg.eigh(rows.T @ rows / len(rows))
    large = values > SMALLEST_SHARE * values[-1]
    basis: Floats = vectors[:, large] / np.sqrt(values[large])
    return basis


def _shrunk(spread: Floats, logs: int) -> Floats:
    """Return the spread with its correlations drawn to zero where logs are too few to tell them,
    fewer than 2n + 1 for n.

    The share is n/(n + logs − 1): from few logs the spread has fewer directions than columns, and
    would be sure of the rest.
    """
    n = len(spread)
    if logs > 2 * n:
        return spread
    share = n / (n + logs - 1)
    shrunk: Floats = (1.0 - share) * spread + share * np.diag(np.diag(spread))
    return shrunk


def filled_groups(
    joint: JointMap, columns: Sequence[int], mean: Floats, covariance: Floats, std: float
) -> JointMap:
    """Return a joint's map with some of its coefficients; the others are zero for certain.

    The `columns` are indices of these n coefficients, which have a mean and covariance [rad, rad²];
    `std` is of the residual.
    """
    size = len(joint.coefficients)
    coefficients = np.zeros(size)
    square = np.zeros((size, size))
    coefficients[list(columns)] = mean
    square[np.ix_(columns, columns)] = covariance
    return JointMap(
        joint=joint.joint,
        coefficients=row_of(coefficients),
        covariance=rows_of_groups(square),
        std=float(std),
    )


def row_of(array: Floats) -> tuple[float, ...]:
    """Return an array as plain numbers."""
    return tuple(float(number) for number in array)


def rows_of_groups(matrix: Floats) -> tuple[tuple[float, ...], ...]:
    """Return a matrix as rows of plain numbers."""
    return tuple(row_of(row) for row in matrix)
