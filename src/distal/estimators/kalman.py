"""Kalman filter algebra in CasADi: symmetric prediction and sequential scalar updates in Joseph
form.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from distal.expressions import Expression, Matrix, MatrixNode, ScalarNode, Vector, VectorNode


def symmetric(entries: Expression) -> Expression:
    """Return the symmetric matrix with the lower triangle of `entries`: symmetry is exact, not
    approximate.
    """
    return ca.tril2symm(ca.tril(entries))


class Downdate:
    """A covariance less what scalar updates have taken, P − Σ g gᵀ + Σ k kᵀ, written out once after
    the last of them.

    With g = P hᵀ/√S an update with the optimal gain K = P hᵀ/S takes g gᵀ. A state that takes only
    a share κ of its gain keeps k kᵀ of that, k = (1 − κ) g. Until `matrix` is asked for, P is only
    multiplied by the slopes of later updates: it is read and written once, not once for each.
    """

    def __init__(self, covariance: MatrixNode) -> None:
        self._before = covariance
        self._gains: list[VectorNode] = []
        self._remainders: list[tuple[list[int], VectorNode]] = []

    def times(self, slope: VectorNode) -> VectorNode:
        """Return the covariance, as it is now, times a slope hᵀ, (n,), sparse."""
        ahead = ca.mtimes(self._before, slope)
        if not slope.nnz():
            return ahead
        for gain, (at, remainder) in zip(self._gains, self._remainders):
            ahead = ca.rank1(ahead, -along(slope, gain), gain, 1)
            if slope[at].nnz():
                ahead[at] += along(slope[at], remainder) * remainder
        return ahead

    def take(self, gain: VectorNode, at: Sequence[int], shares: VectorNode) -> None:
        """Take what one update tells, its `gain` g, (n,), zero for one that does not count.

        The states `at` some indices take only `shares` of it.
        """
        self._gains.append(gain)
        self._remainders.append((list(at), gain[list(at)] * (1 - shares)))

    def matrix(self) -> MatrixNode:
        """Return the covariance, symmetric: products of the same two numbers are added in the same
        order on both sides.
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
    """Return a slope, (n,), sparse, times a vector, (n,)."""
    return ca.mtimes(slope.T, values) if slope.nnz() else ca.MX(0)


def predict_covariance(
    covariance: Matrix,
    transition: Matrix,
    input_map: Matrix,
    input_variances: Vector,
    process: Vector,
) -> Matrix:
    """Return the `covariance` P⁻ = Φ P Φᵀ + G diag(q_u) Gᵀ + diag(q), with the `process` variances
    q.

    The `transition` Φ = ∂x⁺/∂x, (n, n), `input_map` G = ∂x⁺/∂u, (n, k), and `input_variances` q_u,
    (k,).
    """
    mapped = input_map * ca.repmat(input_variances.T, input_map.size1(), 1)
    added = ca.mtimes(mapped, input_map.T) + ca.diag(process)
    predicted = symmetric(ca.mtimes(ca.mtimes(transition, covariance), transition.T) + added)
    return with_least(predicted, ca.diag(added))


def with_least(covariance: Matrix, least: Vector) -> Matrix:
    """Return the `covariance` with no variance below what it is at `least`, (n,): rounding alone
    brings it there.

    Where one number is known 1e16 times as well as another, terms cancel to less than their
    rounding.
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
    H) P (I − K H)ᵀ + K R Kᵀ (Joseph), multiplied out: P − K aᵀ − a Kᵀ + K S Kᵀ with a = P Hᵀ. With
    the linearisation kept at x⁻ this equals the update with all values at once (their errors are
    independent).

    There are `residuals` z − h(x⁻), (m,), a `jacobian` H, (m, n), and `variances` R, (m,). The
    `mask` is READ or MISSING, see `distal.kernels.mask`, (m,); a value that is MISSING changes
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
