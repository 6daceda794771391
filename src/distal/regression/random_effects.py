"""Least squares over several logs, each with coefficients of its own: correlated samples, Gaussian
updates, random effects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distal.arrays import Bools, Floats
from distal.rig import JointMap

EM_ITERATIONS = 100
"""Largest number of steps of expectation–maximisation for the covariance between logs. Source:
judgement.
"""

EM_SETTLED = 1e-2
"""Relative change of that covariance in a step, below which the steps end. Source: judgement."""

SMALLEST_SHARE = 1e-8
"""Share of the largest mean square of a combination of columns, below which a combination is left
out. Source: rounding (division by a mean square near zero).
"""

SMALLEST_RESIDUAL = 1e-6
"""Least std of a residual [rad]. Source: rounding (division by a std of zero)."""


def correlated_samples(residuals: Floats) -> float:
    """Return how many of evenly spaced residuals, (k,), count as one independent sample: 1 + 2 Σ
    ρ_j.

    The sum goes over the autocorrelations ρ_j up to the first that is not positive (Sokal, 1997,
    §3).
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
    """The coefficients b = (XᵀX)⁻¹Xᵀy of one log by least squares, (n,), and their covariance s² N
    (XᵀX)⁻¹, (n, n).

    N samples count as one (`correlated`). The std s of the residual has k/N − n degrees of freedom:
    s² = RSS/(k − n N).
    """

    coefficients: Floats
    covariance: Floats
    std: float
    correlated: float


def line(design: Floats, angles: Floats) -> LogCoefficients:
    """Return the `LogCoefficients` of least squares of `angles` y [rad], (k,), over a `design` X of
    full rank, (k, n).
    """
    k, n = design.shape
    inverse = _inverse(design.T @ design)
    coefficients = inverse @ (design.T @ angles)
    residuals = angles - design @ coefficients
    correlated = correlated_samples(residuals)
    # without a degree of freedom the std would have no value
    freedom = max(k / correlated - n, 1.0)
    std = max(float(np.sqrt(np.mean(residuals**2) * (freedom + n) / freedom)), SMALLEST_RESIDUAL)
    return LogCoefficients(coefficients, std**2 * correlated * inverse, std, correlated)


def _inverse(gram: Floats) -> Floats:
    """Return the pseudoinverse of XᵀX, positive semidefinite, without the directions that rounding
    alone may have made.
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
    """Return mean and covariance of coefficients after samples: P⁺ = (P⁻¹ + XᵀX/r)⁻¹, in a form
    that needs no P⁻¹.

    Args:
        mean: mean before the samples, (n,).
        covariance: covariance P before them, which may be singular, (n, n).
        gram: XᵀX of the samples' columns X, (n, n), or of several logs, each updated alone, (logs,
            n, n).
        moment: Xᵀy of their angles y [rad], (n,) or (logs, n).
        spread: r, the variance of a sample times the number of samples that count as one; of
            several logs (logs,).
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
    """Return the squared Mahalanobis distance between a log's own coefficients, (n,), and the
    expected ones.

    Directions that the log does not show are left out. The arguments `mean`, `covariance`, `gram`,
    `moment` and `spread` are those of `posterior_of`, for one log.
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
    """Return which columns have information of their own, (m,): the part that earlier columns do
    not explain is larger than the noise.

    The `values` are centred readings, (k, m); `noise` is the std of each sensor's random error in
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
        # a sensor of noise alone has an RMS of one std; a rounded constant has none
        chosen[i] = rms > max(ABOVE_NOISE * noise[i], RANK * size)
    return chosen


ROUNDED = 1e-12
"""Share of the largest eigenvalue of XᵀX, its columns scaled to size one, below which an eigenvalue
is taken as zero. Source: rounding (sums of rounding errors).
"""

ABOVE_NOISE = 1.5
"""Ratio of RMS to the noise's std: a sensor is used where the part that others do not explain is
larger. Source: judgement.
"""

RANK = 1e-6
"""Share of a column's own RMS, below which the part that others do not explain counts as none.
Source: rounding (a column that is a combination of others).
"""


def random_effects(
    joint: JointMap,
    columns: Sequence[int],
    parts: Sequence[tuple[Floats, Floats, float]],
    pooled: bool = False,
) -> tuple[JointMap, float]:
    """Return the map of one joint, with its coefficients' mean and covariance between logs, and the
    correlation time of the residuals [s].

    Each log's coefficients are a draw from one normal distribution, which is found by
    expectation–maximisation. From a single log the covariance is that of its least squares.

    Args:
        joint: a map of the joint with as many coefficients as are needed.
        columns: indices of the coefficients that are learned, (n,).
        parts: for each log its design (k, n), its angles [rad] (k,) and its interval [s].
        pooled: whether the mean is fitted to all samples together, so that differences between logs
            count too (a load that is constant in each); else it is the mean of the logs' own
            coefficients.
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
    # a wide first guess: each coefficient alone explains the residual of the common map
    left = np.concatenate([y - x @ mean for x, y in zip(designs, angles)])
    spread = np.eye(len(mean)) * max(float(np.mean(left**2)), std**2)
    for _ in range(EM_ITERATIONS):
        means, covariances = posterior_of(mean, spread, grams, moments, std**2 * count)
        mean = mean if pooled else means.mean(axis=0)
        off = means - mean
        before = spread
        # the mean comes from the same logs, which takes one degree of freedom
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
    """Return W, (n, up to n), for which the columns of X W are uncorrelated and of size one over
    all logs.

    The covariance between logs is guessed and shrunk for such columns, so that it does not depend
    on how the columns are written. Combinations of columns that hardly ever differ from zero are
    left out.
    """
    rows = np.vstack(designs)
    values, vectors = np.linalg.eigh(rows.T @ rows / len(rows))
    large = values > SMALLEST_SHARE * values[-1]
    basis: Floats = vectors[:, large] / np.sqrt(values[large])
    return basis


def _shrunk(spread: Floats, logs: int) -> Floats:
    """Return the covariance between logs with its correlations shrunk towards zero, where there are
    fewer than 2n + 1 logs for n coefficients.

    They shrink by n/(n + logs − 1): a covariance from few logs has no variance at all in some
    directions.
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
    """Return a joint's map with `mean` [rad], (n,), and `covariance` [rad²], (n, n), at the indices
    `columns`; its other coefficients are zero for certain.

    The residual has the standard deviation `std` [rad].
    """
    size = len(joint.coefficients)
    coefficients = np.zeros(size)
    square = np.zeros((size, size))
    coefficients[list(columns)] = mean
    square[np.ix_(columns, columns)] = covariance
    return joint_map(joint.joint, coefficients, square, float(std))


def joint_map(name: str, coefficients: Floats, covariance: Floats, std: float) -> JointMap:
    """Return the map of a joint with such coefficients [rad], (n,), their covariance [rad²], (n,
    n), and the std of the residual [rad].
    """
    return JointMap(
        joint=name,
        coefficients=row_of(coefficients),
        covariance=rows_of_groups(covariance),
        std=std,
    )


def row_of(array: Floats) -> tuple[float, ...]:
    """Return an array, (n,), as a tuple of Python floats."""
    return tuple(float(number) for number in array)


def rows_of_groups(matrix: Floats) -> tuple[tuple[float, ...], ...]:
    """Return a matrix as a tuple of rows of Python floats."""
    return tuple(row_of(row) for row in matrix)
