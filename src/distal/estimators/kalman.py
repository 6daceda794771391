"""Kalman filter algebra in CasADi: symmetric prediction and sequential scalar updates in Joseph form."""

from __future__ import annotations

import casadi as ca

from distal.expressions import Expression, Matrix, MatrixNode, Vector, VectorNode


def symmetric(entries: Expression) -> Expression:
    """Return the symmetric matrix with the lower triangle of `entries`: symmetry is exact, not approximate."""
    return ca.tril2symm(ca.tril(entries))


def lowered(covariance: MatrixNode, gain: VectorNode, loops: bool) -> MatrixNode:
    """Return P − g gᵀ, symmetric: with g = P hᵀ/√S the update with the optimal gain K = P hᵀ/S.

    Args:
        covariance: P, (n, n).
        gain: g, (n,).
        loops: as a rank-one change in place, else as a product of which the lower triangle is taken.
    """
    return ca.rank1(covariance, -1, gain, gain) if loops else symmetric(covariance - ca.mtimes(gain, gain.T))


def predict_covariance(
    covariance: Matrix, transition: Matrix, input_map: Matrix, input_variances: Vector, process: Vector
) -> Matrix:
    """Return P⁻ = Φ P Φᵀ + G diag(q_u) Gᵀ + diag(q).

    Args:
        covariance: P, (n, n).
        transition: Φ = ∂x⁺/∂x, (n, n).
        input_map: G = ∂x⁺/∂u, (n, k).
        input_variances: q_u, (k,).
        process: q, (n,).
    """
    mapped = input_map * ca.repmat(input_variances.T, input_map.size1(), 1)
    added = ca.mtimes(mapped, input_map.T) + ca.diag(process)
    whole = symmetric(ca.mtimes(ca.mtimes(transition, covariance), transition.T) + added)
    return with_least(whole, ca.diag(added))


def with_least(covariance: Matrix, least: Vector) -> Matrix:
    """Return the matrix with no variance below what it is at least, (n,): rounding alone brings it there.

    Where one number is known 1e16 times as well as another, terms cancel to less than their rounding.

    Args:
        covariance: symmetric, (n, n).
        least: variances, (n,).
    """
    diagonal = ca.diag(covariance)
    return covariance + ca.diag(ca.fmax(diagonal, least) - diagonal)


def update(
    mean: Vector, covariance: Matrix, residuals: Vector, jacobian: Matrix, variances: Vector, mask: Vector
) -> tuple[Vector, Matrix, Vector, Vector]:
    """Return mean, covariance, innovations and their variances after a sample, one scalar at a time.

    For each value: ν = z − h(x⁻) − H (x − x⁻), S = H P Hᵀ + R, K = P Hᵀ/S, x ← x + K ν,
    P ← (I − K H) P (I − K H)ᵀ + K R Kᵀ (Joseph), multiplied out: P − K aᵀ − a Kᵀ + K S Kᵀ with a = P Hᵀ. With the
    linearisation kept at x⁻ this equals the update with all values at once (their errors are independent). A value that
    is MISSING changes nothing.

    Args:
        mean: x⁻, (n,).
        covariance: P⁻, (n, n).
        residuals: z − h(x⁻), (m,).
        jacobian: H, (m, n).
        variances: R, (m,).
        mask: READ or MISSING, see `distal.kernels.mask`, (m,).
    """
    prior, innovations, spreads = mean, [], []
    for i in range(residuals.numel()):
        row = jacobian[i, :]
        across = ca.mtimes(covariance, row.T)
        spread = ca.fmax(ca.mtimes(row, across), 0) + variances[i]
        value = residuals[i] - ca.mtimes(row, mean - prior)
        gain = mask[i] * across / spread
        mean = mean + gain * value
        other = across - gain * (spread / 2)
        after = symmetric(covariance - (ca.mtimes(gain, other.T) + ca.mtimes(other, gain.T)))
        covariance = with_least(after, gain**2 * variances[i])  # the first term of Joseph's form is no less than zero
        innovations.append(value)
        spreads.append(spread)
    return mean, covariance, ca.vertcat(*innovations), ca.vertcat(*spreads)
