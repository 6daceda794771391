"""The belief of an estimator at a time, and the states that a learned map corrects or replaces in
what is reported of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distal.arrays import Floats
from distal.kernels import covariance_of, mean_of


@dataclass(frozen=True)
class Report:
    """Indices in a kernel's output y of the reported values, gains and variances of some states.

    A state x_i with error e_i is reported as a value v_i with the error g_i e_i + n_i, where n_i
    has the variance u_i, is correlated by R with those of the other states of its map, and is
    independent of everything else. With G the diagonal of the gains, 1 where nothing is reported,
    the covariance P becomes G P Gᵀ + diag(√u) R diag(√u), which is positive semidefinite as P and
    R are.

    Args:
        states: indices i of the states.
        values: indices of v in y.
        gains: indices of g in y.
        variances: indices of u in y.
        correlation: R, a row for each of the states.
    """

    states: tuple[int, ...] = ()
    values: tuple[int, ...] = ()
    gains: tuple[int, ...] = ()
    variances: tuple[int, ...] = ()
    correlation: tuple[tuple[float, ...], ...] = ()

    @classmethod
    def behind(
        cls, start: int, groups: Sequence[Sequence[int]], correlations: Sequence[Floats]
    ) -> Report:
        """Return the report of several maps, each of which corrects one of the `groups` of states,
        whose errors have such `correlations`.

        For one map after the other, its values, gains and variances stand in y from the index
        `start` on.
        """
        states = list[int]()
        parts = (list[int](), list[int](), list[int]())
        for group in groups:
            for columns in parts:
                columns += range(start, start + len(group))
                start += len(group)
            states += group
        correlation = np.zeros((len(states), len(states)))
        at = 0
        for block in correlations:
            correlation[at : at + len(block), at : at + len(block)] = block
            at += len(block)
        values, gains, variances = map(tuple, parts)
        rows = tuple(map(tuple, correlation.tolist()))
        return cls(tuple(states), values, gains, variances, rows)

    def only(self, states: Sequence[int]) -> Report:
        """Return the report of those of its states that are in `states`."""
        chosen = [k for k, state in enumerate(self.states) if state in states]
        parts = (self.states, self.values, self.gains, self.variances)
        of, values, gains, variances = (tuple(part[k] for k in chosen) for part in parts)
        rows = tuple(tuple(self.correlation[k][i] for i in chosen) for k in chosen)
        return Report(of, values, gains, variances, rows)

    def means(self, means: Floats, ys: Floats) -> Floats:
        """Return the states as they are reported, (k, n), from the filter's own `means`, (k, n),
        and the kernel's outputs `ys`, (k, n_y).
        """
        if not self.states:
            return means
        reported = np.array(means)
        reported[:, self.states] = ys[:, self.values]
        return reported

    def variances_of(self, variances: Floats, ys: Floats) -> Floats:
        """Return the filter's own `variances` as they are reported, (k, n); see `means`
        for `ys`.
        """
        if not self.states:
            return variances
        reported = np.array(variances)
        gains = ys[:, self.gains]  # in the order in which `covariances` multiplies, to the last bit
        reported[:, self.states] = reported[:, self.states] * gains * gains + ys[:, self.variances]
        return reported

    def covariances(self, covariances: Floats, ys: Floats) -> Floats:
        """Return the filter's own `covariances` as they are reported, (k, n, n); see `means` for
        `ys`.
        """
        if not self.states:
            return covariances
        gains = np.ones(covariances.shape[:2])
        gains[:, self.states] = ys[:, self.gains]
        reported: Floats = covariances * gains[:, :, None] * gains[:, None, :]
        stds = np.sqrt(ys[:, self.variances])
        added = np.array(self.correlation) * stds[:, :, None] * stds[:, None, :]
        diagonal = np.arange(len(self.states))
        added[:, diagonal, diagonal] = ys[:, self.variances]
        reported[np.ix_(range(len(ys)), self.states, self.states)] += added
        return reported


NOTHING_REPORTED = Report()
"""The report that leaves all states unchanged."""


@dataclass(frozen=True)
class Belief:
    """The mean and covariance that an estimator believes at a time; immutable.

    Args:
        time: stamp of the last sample [s].
        kernel_state: mean (n,), covariance (n, n) row by row, and what the estimator remembers of
            its inputs.
        size: number of states n.
        samples: number of samples taken in; the first one may have the belief's own stamp.
    """

    time: float
    kernel_state: Floats
    size: int
    samples: int = 0

    @property
    def mean(self) -> Floats:
        """The filter's own estimate of the states, (n,)."""
        return mean_of(self.kernel_state, self.size)

    @property
    def covariance(self) -> Floats:
        """The covariance of its error, (n, n)."""
        return covariance_of(self.kernel_state, self.size)
