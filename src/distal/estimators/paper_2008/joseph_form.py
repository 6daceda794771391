"""Kalman filter algebra: prediction of the covariance, and sequential scalar updates in Joseph's
form.
"""

from __future__ import annotations

import casadi as ca

from distal.estimators.kalman import symmetric
from distal.expressions import Matrix, Vector


def predict_covariance(
    covariance: Matrix,
    transition: Matrix,
    input_map: Matrix,
    input_variances: Vector,
    process: Vector,
) -> Matrix:
    """Return the predicted covariance P⁻ = Φ P Φᵀ + G diag(q_u) Gᵀ + diag(q).

    Args:
        covariance: P, (n, n).
        transition: Φ = ∂x⁺/∂x, (n, n).
        input_map: G = ∂x⁺/∂u, (n, k).
        input_variances: q_u, (k,).
        process: variances q that are added to the states, (n,).
    """
    mapped = input_map * ca.repmat(input_variances.T, input_map.size1(), 1)
    added = ca.mtimes(mapped, input_map.T) + ca.diag(process)
    predicted = symmetric(ca.mtimes(ca.mtimes(transition, covariance), transition.T) + added)
    return with_least(predicted, ca.diag(added))


def with_least(covariance: Matrix, least: Vector) -> Matrix:
    """Return the `covariance` with each variance raised to `least`, (n,), where it is below.

    Only rounding brings a variance there: where one state is known 1e16 times as well as another,
    terms cancel to less than their rounding.
    """
    diagonal = ca.diag(covariance)
    return covariance + ca.diag(ca.fmax(diagonal, least) - diagonal)


def update(
    mean: Vector,
    covariance: Matrix,
    residuals: Vector,
    jacobian: Matrix,
    variances: Vector,
    mask: Vector,
) -> tuple[Vector, Matrix, Vector, Vector]:
    """Return mean, covariance, innovations and their variances after a sample, one scalar at a
    time.

    For each value: ν = z − h(x⁻) − H (x − x⁻), S = H P Hᵀ + R, K = P Hᵀ/S, x ← x + K ν, P ← (I − K
    H) P (I − K H)ᵀ + K R Kᵀ (Joseph), multiplied out: P − K aᵀ − a Kᵀ + K S Kᵀ with a = P Hᵀ. The
    linearisation stays that at x⁻ and the errors of the values are independent, so that this equals
    the update with all values at once.

    Args:
        mean: x⁻, (n,).
        covariance: P, (n, n).
        residuals: z − h(x⁻), (m,).
        jacobian: H, (m, n).
        variances: R, (m,).
        mask: READ or MISSING, see `distal.kernels.layout`, (m,); a value that is MISSING changes
            nothing.
    """
    prior = mean
    innovations = []
    spreads = []
    for i in range(residuals.numel()):
        row = jacobian[i, :]
        across = ca.mtimes(covariance, row.T)
        spread = ca.fmax(ca.mtimes(row, across), 0) + variances[i]
        innovation = residuals[i] - ca.mtimes(row, mean - prior)
        gain = mask[i] * across / spread
        mean = mean + gain * innovation
        change = across - gain * (spread / 2)
        after = symmetric(covariance - (ca.mtimes(gain, change.T) + ca.mtimes(change, gain.T)))
        covariance = with_least(
            after, gain**2 * variances[i]
        )  # the first term of Joseph's form is no less than zero
        innovations.append(innovation)
        spreads.append(spread)
    return mean, covariance, ca.vertcat(*innovations), ca.vertcat(*spreads)
