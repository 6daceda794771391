"""Kalman filter algebra in CasADi: symmetric prediction and sequential scalar updates in Joseph
form.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from distal.expressions import Expression, Matrix, MatrixNode, ScalarNode, Vector, VectorNode


def symmetric(entries: Expression) -> Expression:
    """Return the symmetric matrix that has the lower triangle of `entries`, so that symmetry is
    exact.
    """
    return ca.tril2symm(ca.tril(entries))


class Downdate:
    """A covariance P that several scalar updates reduce: P − Σ g gᵀ + Σ k kᵀ.

    With g = P hᵀ/√S an update with the optimal gain K = P hᵀ/S subtracts g gᵀ. Where a state takes
    only a share κ of its gain, k kᵀ of that is added again, k = (1 − κ) g. The updates are
    collected, and `matrix` computes the sum after the last of them, so that P is read and written
    once and not once per update.
    """

    def __init__(self, covariance: MatrixNode) -> None:
        self._before = covariance
        self._gains: list[VectorNode] = []
        self._remainders: list[tuple[list[int], VectorNode]] = []

    def times(self, slope: VectorNode) -> VectorNode:
        """Return the covariance after the updates so far, times a slope hᵀ, (n,), sparse."""
        ahead = ca.mtimes(self._before, slope)
        if not slope.nnz():
            return ahead
        for gain, (at, remainder) in zip(self._gains, self._remainders):
            ahead = ca.rank1(ahead, -along(slope, gain), gain, 1)
            if slope[at].nnz():
                ahead[at] += along(slope[at], remainder) * remainder
        return ahead

    def take(self, gain: VectorNode, at: Sequence[int], shares: VectorNode) -> None:
        """Add one update with its `gain` g, (n,), which is zero where the update does not count.

        The states with the indices `at` take only the shares κ in `shares` of their gain.
        """
        self._gains.append(gain)
        self._remainders.append((list(at), gain[list(at)] * (1 - shares)))

    def matrix(self) -> MatrixNode:
        """Return the covariance after all updates.

        It is exactly symmetric: products of the same two numbers are added in the same order on
        both sides.
        """
        if not self._gains:
            return self._before
        gains = ca.horzcat(*self._gains)
        after = ca.mac(gains, -gains.T, self._before)
        for at in dict.fromkeys(tuple(at) for at, _ in self._remainders if at):
            remainders = ca.horzcat(
                *(remainder for rows, remainder in self._remainders if tuple(rows) == at)
            )
            after[list(at), list(at)] += ca.mtimes(remainders, remainders.T)
        return after


def along(slope: VectorNode, values: VectorNode) -> ScalarNode:
    """Return the scalar product of a slope, (n,), sparse, and a vector, (n,)."""
    return ca.mtimes(slope.T, values) if slope.nnz() else ca.MX(0)


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
