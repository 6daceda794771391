"""The numbers of a rig from a homing move: their maximum a posteriori over the whole window, by
iteration.

A filter that reads the angle as a sensor linearises at each moment, without the rest of the window:
with wide priors it finds numbers with which the joint would move away once the reference is gone.
Here the numbers are constant over the window, the filter runs without the reference, as in later
use, and its angle is compared with the reference:

    minimise ½ Σ (θ_ref − θ̂(z))²/(w_θ s_θ²) + ½ Σ ν(z)²/(w_f S₀) + ½ |z|²,    numbers = mean + std
    · z

Denominators are those at the prior's mean, so that no number can be bought by a wider band. w
counts how many samples tell as much as one that is independent, and how much larger the errors are
than the filter thinks; both are found again after each fit. Solved by Gauss–Newton in a trust
region (Branch, Coleman and Li, SIAM J. Sci. Comput. 21, 1999; `scipy.optimize.least_squares`); the
covariance is the inverse of its Hessian.
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
"""How often the weights are computed again."""

EVALUATIONS = 30
"""At most this many points are tried in a round."""

STEP = 0.02
"""Change of a number by which its slope is found, in stds of its prior."""

INDEPENDENT = 0.1
INDEPENDENT_CORRECTED = 1.0
SHARE_CORRECTED = 1 / 3
"""Errors are taken to last at least so long [s]; with a learned map longer, 1 s but at most this
share of the window: what is wrong with the model is left to the map, instead of bending the numbers
(docs/explanation/discrepancy.md).
"""

UNEXPLAINED = 10.0
"""Factor on the filter's variance of the angle with which the weights of its errors begin."""

LARGEST_RESIDUAL = 1e3
"""A residual is limited to this many standard deviations."""

KEPT = 0.3
"""Share of the covariance that the filter keeps: with all of it, forces of a wrong model would
change the numbers again.
"""


def most_likely_start(window: Window, independent: float = INDEPENDENT) -> Belief:
    """Return a belief before the first sample: the numbers at their maximum a posteriori, with its
    covariance.

    The first angle is the reference's own; errors last for `independent` s or more. Where nothing
    is uncertain, or the filter leaves all bounds with the prior's mean, it is the belief as it was.
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
    """The criterion as a function of the numbers, in stds of their prior."""

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
        """Return the kernel state before the first sample at some numbers."""
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
        """Return whether the filter has an answer at the prior's mean, and take its standard
        deviations from there.
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
        """Return what is squared and summed, (n_residuals,)."""
        parts = [ratio.ravel() / np.sqrt(weight) for ratio, weight in zip(self._ratios(z), weights)]
        return np.concatenate([*parts, z])

    def slopes(self, z: Floats, weights: tuple[float, float]) -> Floats:
        """Return the slopes of the residuals, (n_residuals, n_numbers)."""
        base = self.residuals(z, weights)
        columns = []
        for i in range(len(z)):
            moved = z.copy()
            moved[i] += STEP
            columns.append((self.residuals(moved, weights) - base) / STEP)
        self._last = None
        return np.column_stack(columns) if columns else np.zeros((len(base), 0))

    def weights(self, z: Floats) -> tuple[float, float]:
        """Return by what the squares of errors and innovations are divided: samples per independent
        one, and their size.
        """
        return _weight(self._ratios(z)[0], self._least), _weight(self._ratios(z)[1], self._least)


def _weight(ratios: Floats, least: float) -> float:
    """Return what sums of squares are divided by; a rig in which nothing is compared has no
    ratios.
    """
    if not ratios.size:
        return least
    return max(1.0, float(np.mean(ratios**2))) * max(least, correlated_samples(ratios[:, 0]))
