"""The parameters of a rig from a homing move: their maximum a posteriori over the whole window,
found by iteration.

A filter that reads the angle as a sensor linearises at each sample, without the rest of the window:
with wide priors it finds parameters with which the joint would move away once the reference is
gone. Here the parameters, mean + std · z of their prior, are constant over the window. The filter
runs without the reference, as in later use, and its angle is compared with the reference:

    minimise ½ Σ (θ_ref − θ̂(z))²/(w_θ s_θ²) + ½ Σ ν(z)²/(w_f S₀) + ½ |z|²

The variances s_θ² and S₀ are those at the prior's mean, so that a wider band does not reduce the
criterion. A weight w is the number of samples that tell as much as one independent sample, times
the ratio of the squared errors to what the filter expects; both weights are computed again after
each fit. Solved by Gauss–Newton in a trust region (Branch, Coleman and Li, SIAM J. Sci. Comput. 21,
1999; `scipy.optimize.least_squares`); the covariance is the inverse of its Hessian.
"""

from __future__ import annotations

import numpy as np

from distal.arrays import Floats
from distal.estimators import Belief
from distal.homing.window import Window
from distal.kernels import covariance_of, variances_of
from distal.logs import frozen
from distal.regression import correlated_samples

ROUNDS = 3
"""Number of fits, after each of which the weights are computed again [1]. Source: judgement."""

EVALUATIONS = 30
"""Largest number of points that are tried in one fit [1]. Source: judgement."""

STEP = 0.02
"""Change of a parameter for its slope by differences, in stds of its prior [1]. Source: judgement.
"""

INDEPENDENT = 0.1
"""Time for which errors are assumed to last, at least [s]. Source: judgement."""

UNEXPLAINED = 10.0
"""Factor on the weight of the errors of the angle in the first fit [1]. Source: judgement."""

LARGEST_RESIDUAL = 1e3
"""Largest size of a residual, in standard deviations [1]; a larger one is cut. Source: judgement.
"""

KEPT = 0.3
"""Share of the covariance that the filter keeps [1]: with all of it, forces of a wrong model would
change the parameters again. Source: judgement.
"""


def most_likely_start(window: Window, independent: float = INDEPENDENT) -> Belief:
    """Return a belief before the first sample with the parameters at their maximum a posteriori,
    and `KEPT` of their covariance.

    It is the window's own first belief where no parameter is uncertain, or where the filter
    diverges with the prior's mean.

    Args:
        window: of the homing move.
        independent: time for which errors are assumed to last, at least [s].
    """
    from scipy.optimize import least_squares  # not needed before

    search = _Search(window, independent)
    z = np.zeros(len(search.at))
    weights = search.first_weights
    if not len(z) or not search.begins():
        return window.start
    bounds = search.low, np.full(len(z), np.inf)
    limits = {"max_nfev": EVALUATIONS, "xtol": 1e-4, "ftol": 1e-4}
    for _ in range(ROUNDS):
        answer = least_squares(
            search.residuals, z, search.slopes, bounds, args=(weights,), **limits
        )
        z = answer.x
        weights = search.weights(answer.x)
    slopes = search.slopes(z, weights)
    covariance = KEPT * np.linalg.inv(slopes.T @ slopes) * np.outer(search.stds, search.stds)
    kernel_state = search.kernel_state(z)
    n = window.start.size
    covariance_of(kernel_state, n)[np.ix_(search.at, search.at)] = covariance
    return Belief(window.start.time, frozen(kernel_state), n)


class _Search:
    """The criterion as a function of the parameters z, in stds of their prior."""

    def __init__(self, window: Window, independent: float) -> None:
        self._window = window
        self._unaided = window.unaided
        estimator = window.estimator
        start = window.start
        n = window.start.size
        spread = np.sqrt(variances_of(start.kernel_state, n))
        lasting = np.flatnonzero(estimator.states.lasting)
        self.at = lasting[spread[lasting] > 0.0]
        self.means = start.kernel_state[self.at]
        self.stds = spread[self.at]
        self.low = np.minimum((estimator.states.lowest[self.at] - self.means) / self.stds, -1e-6)
        # before the first sample numbers are certain, and the first angles those of the reference
        self._begin = window.anchored(start.kernel_state)
        covariance = covariance_of(self._begin, n)
        covariance[self.at, :] = covariance[:, self.at] = 0.0
        references = {estimator.channels[c] for c in window.references}
        self._proximal = [i for i, name in enumerate(estimator.measured) if name not in references]
        interval = float(np.median(np.diff(window.time))) if len(window.time) > 1 else independent
        self._least = max(1.0, independent / interval)
        self.first_weights = (UNEXPLAINED * self._least, self._least)
        self._bases: tuple[Floats, ...] = ()
        self._last: tuple[bytes, tuple[Floats, Floats]] | None = None

    def kernel_state(self, z: Floats) -> Floats:
        """Return the kernel state before the first sample with the parameters z."""
        kernel_state = self._begin.copy()
        kernel_state[self.at] = self.means + self.stds * z
        return kernel_state

    def _ratios(self, z: Floats) -> tuple[Floats, Floats]:
        """Return errors of the angles and innovations, each over its standard deviation at the
        prior's mean.
        """
        if self._last is not None and self._last[0] == z.tobytes():
            return self._last[1]
        done = self._window.scan(self.kernel_state(z), self._unaided)
        if done is None:
            ratios = tuple(np.full_like(base, LARGEST_RESIDUAL) for base in self._bases)
        else:
            errors = self._window.errors(done[0])[0]
            innovations = self._innovations(done[1])[0]
            ratios = tuple(
                np.clip(
                    np.nan_to_num(part / np.sqrt(base), nan=0.0),
                    -LARGEST_RESIDUAL,
                    LARGEST_RESIDUAL,
                )
                for part, base in zip((errors, innovations), self._bases)
            )
        self._last = (z.tobytes(), (ratios[0], ratios[1]))
        return self._last[1]

    def begins(self) -> bool:
        """Return whether the filter stays bounded at the prior's mean; its standard deviations
        there become those of the criterion.
        """
        done = self._window.scan(self.kernel_state(np.zeros(len(self.at))), self._unaided)
        if done is None:
            return False
        errors, variances = self._window.errors(done[0])
        self._bases = (
            np.broadcast_to(np.mean(variances, axis=0), errors.shape),
            self._innovations(done[1])[1],
        )
        return True

    def _innovations(self, outputs: Floats) -> tuple[Floats, Floats]:
        """Return innovations and their variances of all but the references, (k, m) each."""
        m = len(self._window.estimator.measured)
        return outputs[:, :m][:, self._proximal], outputs[:, m : 2 * m][:, self._proximal]

    def residuals(self, z: Floats, weights: tuple[float, float]) -> Floats:
        """Return the residuals, whose squares are summed, (n_residuals,)."""
        parts = [ratio.ravel() / np.sqrt(weight) for ratio, weight in zip(self._ratios(z), weights)]
        return np.concatenate([*parts, z])

    def slopes(self, z: Floats, weights: tuple[float, float]) -> Floats:
        """Return the slopes of the residuals by the parameters, (n_residuals, n_parameters)."""
        base = self.residuals(z, weights)
        columns = []
        for i in range(len(z)):
            moved = z.copy()
            moved[i] += STEP
            columns.append((self.residuals(moved, weights) - base) / STEP)
        self._last = None
        return np.column_stack(columns) if columns else np.zeros((len(base), 0))

    def weights(self, z: Floats) -> tuple[float, float]:
        """Return the weights by which the squares of errors and of innovations are divided."""
        return _weight(self._ratios(z)[0], self._least), _weight(self._ratios(z)[1], self._least)


def _weight(ratios: Floats, least: float) -> float:
    """Return the weight of some residuals, `least` for none: the number of samples that count as
    one, times the residuals' mean square where that is above 1.
    """
    if not ratios.size:
        return least
    return max(1.0, float(np.mean(ratios**2))) * max(least, correlated_samples(ratios[:, 0]))
