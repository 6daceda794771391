"""Kalman filter algebra in CasADi: exact symmetry, and a covariance that scalar updates reduce."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from distal.expressions import Expression, MatrixNode, ScalarNode, VectorNode


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
