"""The filter over a log with changes of causes, side by side in vector lanes."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distal.arrays import Floats
from distal.confidence import LARGE_PRIOR
from distal.diagnosis.causes import Cause, starts_of
from distal.diagnosis.score_test import ScoreTest
from distal.estimators import AdaptiveFilter, Belief, Robustness, first_values
from distal.kernels import in_order
from distal.logs import LARGEST_READING, Log, true_angles
from distal.run.offline import out_of_bounds, prepared

MOST_SAMPLES = 6000
"""Largest number of samples of a log over which the filter runs with changes, the first ones: a
minute at 100 Hz. Source: judgement.
"""

OUTLIER = Robustness().wild_force
"""Value of ν²/S above which an innovation is an outlier [1], as in the filter."""

Change = Mapping[Cause, float]
"""Size of each cause that is changed in a run."""


@dataclass(frozen=True)
class Outcome:
    """What a run of the filter gives.

    Args:
        angles: of the joints [rad], (k, n_joints).
        variances: of their errors, (k, n_joints).
        innovations: (k, m), NaN where not compared.
        innovation_variances: (k, m).
        bounded: whether the filter stayed within all bounds.
    """

    angles: Floats
    variances: Floats
    innovations: Floats
    innovation_variances: Floats
    bounded: bool

    @property
    def normalized(self) -> Floats:
        """ν/√S, (k, m)."""
        normalized: Floats = self.innovations / np.sqrt(self.innovation_variances)
        return normalized

    def log_likelihoods(self) -> Floats:
        """Return ln p of a value of each channel in the mean, (m,), without a constant; an outlier
        counts as in the filter.
        """
        squares = self.normalized**2
        inflation = np.maximum(1.0, squares / OUTLIER)
        terms = squares / inflation + np.log(self.innovation_variances * inflation)
        counts = np.maximum(np.isfinite(terms).sum(axis=0), 1)
        likelihoods: Floats = -0.5 * np.nansum(terms, axis=0) / counts
        return likelihoods

    def excess(self) -> float:
        """Return how much the innovations are too large, ½ ln max(1, mean ν²/S) in the mean of the
        channels: −ln p of a value whose S is as much too small.
        """
        squares = self.normalized**2
        counts = np.maximum(np.isfinite(squares).sum(axis=0), 1)
        means = np.nansum(squares, axis=0) / counts
        return float(np.mean(0.5 * np.log(np.maximum(means, 1.0)))) if means.size else 0.0


class PerturbedRuns:
    """Runs the adaptive filter over the first `MOST_SAMPLES` samples of a log with changes; its
    kernel is built once.

    Args:
        log: of the estimate.
        estimator: the filter.
        homing: time for which the reference angle is used [s], or None.
    """

    def __init__(self, log: Log, estimator: AdaptiveFilter, homing: float | None = None) -> None:
        if len(log) > MOST_SAMPLES:
            log = log.select(slice(MOST_SAMPLES))
            homing = None if homing is None or homing >= float(np.ptp(log.time)) else homing
        self.log = log
        self._run = prepared(log, estimator, homing)
        assert isinstance(self._run.estimator, AdaptiveFilter)
        self.estimator = self._run.estimator  # a homing move may give it other maps
        truths = true_angles(log, self.estimator.rig.joint_names)
        if truths is not None and homing is not None:
            truths = np.where((log.time - log.time[0] < homing)[:, None], np.nan, truths)
        self.truths = truths

    def __call__(self, changes: Sequence[Change]) -> list[Outcome]:
        """Return the outcome of the filter with each of several changes."""
        width = self.estimator.kernel.side_by_side if len(changes) > 1 else 1
        inputs = map(self._changed, changes)
        return [
            outcome for _, outcome in in_order(inputs, width, self._outcomes, os.cpu_count() or 1)
        ]

    def begun_with(self, end: Floats) -> Outcome:
        """Return the outcome of the filter that begins with the parameters that it had learned at
        the end, as far as the rig's stds allow.

        A parameter that is wrong by no more than that makes the first innovations large and alike,
        until it is learned, and contradicts nothing.

        Args:
            end: means of all states at the end, (n,).
        """
        begin, samples, p = self._changed({})
        states = self.estimator.states
        room = np.where(states.lasting, LARGE_PRIOR * states.stds, 0.0)
        kernel_state = np.array(begin.kernel_state)
        kernel_state[: len(end)] += np.clip(end - states.means, -room, room)
        (outcome,) = self._outcomes([(replace(begin, kernel_state=kernel_state), samples, p)])
        return outcome

    def errors(self, outcome: Outcome) -> Floats:
        """Return the errors of the angles [rad], (k, n_joints), NaN where no truth is known."""
        if self.truths is None:
            return np.full(outcome.angles.shape, np.nan)
        errors: Floats = outcome.angles - self.truths
        return errors

    def _outcomes(self, inputs: list[tuple[Belief, Floats, Floats]]) -> list[Outcome]:
        estimator = self.estimator
        (beliefs, samples, parameters) = zip(*inputs)
        scans = estimator.scan_all(beliefs, len(inputs) * [self.log.time], samples, parameters)
        joints = len(estimator.rig.joints)
        outcomes = []
        for (filter_means, filter_variances, ys), read in zip(scans, samples):
            means = estimator.report.means(filter_means, ys)[:, :joints]
            variances = estimator.report.variances_of(filter_variances, ys)[:, :joints]
            bounded = len(out_of_bounds(filter_means, filter_variances, joints)) == 0
            compared = estimator.innovations_of(ys, read)
            outcomes.append(Outcome(means.copy(), variances.copy(), *compared, bounded))
        return outcomes

    def _changed(self, change: Change) -> tuple[Belief, Floats, Floats]:
        """Return the belief, the samples and the parameters of a run with a change."""
        estimator = self.estimator
        names = estimator.parameter_names
        samples = self._run.samples
        p = np.array(estimator.parameters)
        if any(cause.channels for cause in change):
            samples = samples.copy()
        for cause, x in change.items():
            columns = [estimator.channels.index(name) for name in cause.channels]
            cause.apply(x, samples, columns, self.log.time)
            for path in cause.paths:
                for name in (path, *starts_of(estimator, path)):
                    p[names.index(name)] *= 1.0 + x
        if not change:
            return self._run.start, samples, p
        samples = np.where(np.abs(samples) > LARGEST_READING, np.nan, samples)
        first = first_values(samples)
        begin = estimator.initial(self.log.time[0], first)
        mean, covariance, memory = estimator.prior(first, p)
        kernel_state = np.concatenate([mean, covariance.ravel(), memory])
        return replace(begin, kernel_state=kernel_state), samples, p


@dataclass(frozen=True)
class Derivatives:
    """The filter over a log, and how its results depend on the causes.

    Args:
        runs: of the filter.
        causes: all that were perturbed.
        base: the run as the rig says.
        ends: the run with each cause perturbed by its step.
    """

    runs: PerturbedRuns
    causes: tuple[Cause, ...]
    base: Outcome
    ends: tuple[Outcome, ...]

    @property
    def angles(self) -> Floats:
        """Derivatives of the angles by the causes, (n, k, n_joints)."""
        return np.array(
            [(end.angles - self.base.angles) / c.step for c, end in zip(self.causes, self.ends)]
        )

    @property
    def innovations(self) -> Floats:
        """Derivatives of ν/√S by the causes at the S of the base, (n, k, m)."""
        spread = np.sqrt(self.base.innovation_variances)
        with np.errstate(invalid="ignore"):
            return np.array(
                [
                    (end.innovations - self.base.innovations) / spread / cause.step
                    for cause, end in zip(self.causes, self.ends)
                ]
            )

    def test(self, *, of_truth: bool) -> ScoreTest:
        """Return the score test of the causes: of the innovations, or of the angles' errors in
        their stds.

        Args:
            of_truth: whether the errors are asked.
        """
        stds = np.array([cause.std for cause in self.causes])
        time = self.runs.log.time
        if of_truth:
            spread = np.sqrt(self.base.variances)
            return ScoreTest(self.runs.errors(self.base) / spread, self.angles / spread, time, stds)
        residuals = self.base.normalized
        counts = np.maximum(np.isfinite(residuals).sum(axis=0), 1)
        limits = np.sqrt(OUTLIER * np.maximum(np.nansum(residuals**2, axis=0) / counts, 1.0))
        return ScoreTest(np.clip(residuals, -limits, limits), self.innovations, time, stds)


def derivatives_of(runs: PerturbedRuns, causes: Sequence[Cause]) -> Derivatives:
    """Return the filter's results and their derivatives, by one pass of the filter over the log in
    vector lanes.
    """
    base, *ends = runs([{}, *({cause: cause.step} for cause in causes)])
    return Derivatives(runs, tuple(causes), base, tuple(ends))
