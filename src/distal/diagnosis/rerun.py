"""The filter, run over the same log again with one thing changed: a channel, a parameter of the
rig, or the start of a state.
"""

from __future__ import annotations

import operator
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from distal.arrays import Floats
from distal.estimators import AdaptiveFilter, Belief, Robustness
from distal.kernels import in_order
from distal.logs import Log
from distal.run.offline import out_of_bounds, prepared

MOST_RERUN = 2000
"""Largest number of samples of a log that are run again, the first ones: 60 compiled runs of them
take about a second. Source: judgement.
"""

OUTLIER = Robustness().wild_force
"""Value of ν²/S above which an innovation is an outlier [1], as in the filter."""


@dataclass(frozen=True)
class ModelChange:
    """What is changed in a run of the filter.

    Args:
        channels: channel → factor on its readings.
        added: channel → what is added to its readings, SI.
        parameters: path of a parameter → factor on it.
        shifts: state → what is added to its start, SI.
        later: channel → time by which its readings are taken later [s].
        exchanged: two channels whose readings are exchanged, or none.
    """

    channels: Mapping[str, float] = field(default_factory=dict)
    added: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    shifts: Mapping[str, float] = field(default_factory=dict)
    later: Mapping[str, float] = field(default_factory=dict)
    exchanged: tuple[str, ...] = ()

    @property
    def reads_otherwise(self) -> bool:
        """Whether readings are changed, and with them the first sample."""
        return bool(self.channels or self.added or self.later or self.exchanged)

    def __and__(self, other: ModelChange) -> ModelChange:
        """Return both changes as one; only one of them may exchange channels."""
        return ModelChange(
            channels=_combined(self.channels, other.channels, operator.mul),
            added=_combined(self.added, other.added, operator.add),
            parameters=_combined(self.parameters, other.parameters, operator.mul),
            shifts=_combined(self.shifts, other.shifts, operator.add),
            later=_combined(self.later, other.later, operator.add),
            exchanged=self.exchanged or other.exchanged,
        )


@dataclass(frozen=True)
class Outcome:
    """What a run of the filter gives.

    Args:
        means: of all states, (k, n).
        variances: of all states, (k, n).
        innovations: (k, m), NaN where not compared.
        innovation_variances: (k, m), NaN where not compared.
        bounded: whether the filter stayed within all bounds.
    """

    means: Floats
    variances: Floats
    innovations: Floats
    innovation_variances: Floats
    bounded: bool

    @property
    def squares(self) -> Floats:
        """ν²/S of each innovation, (k, m)."""
        squares: Floats = self.innovations**2 / self.innovation_variances
        return squares

    @property
    def log_likelihood(self) -> float:
        """ln p of all compared values, without a constant; beyond `OUTLIER` an outlier counts as in
        the filter.
        """
        compared = np.isfinite(self.innovations)
        squares = self.squares[compared]
        variances = self.innovation_variances[compared]
        inflation = np.maximum(1.0, squares / OUTLIER)
        return float(-0.5 * np.sum(squares / inflation + np.log(variances * inflation)))


def _combined(
    first: Mapping[str, float],
    second: Mapping[str, float],
    operation: Callable[[float, float], float],
) -> dict[str, float]:
    both = {name: operation(first[name], second[name]) for name in first.keys() & second.keys()}
    return {**first, **second, **both}


class Rerun:
    """Runs the adaptive filter over a log, as it is and with changes; its kernel is built once.

    Args:
        log: as it was estimated; of a long one the first `MOST_RERUN` samples are used.
        estimator: the filter, from `estimator_for`.
        homing: time for which the reference angle is used [s], or None.
    """

    def __init__(self, log: Log, estimator: AdaptiveFilter, homing: float | None = None) -> None:
        if len(log) > MOST_RERUN:
            log = log.select(slice(MOST_RERUN))
            homing = None if homing is None or homing >= float(np.ptp(log.time)) else homing
        self.log = log
        self._run = prepared(log, estimator, homing)
        assert isinstance(self._run.estimator, AdaptiveFilter)
        self.estimator = self._run.estimator  # a homing move may give it other maps
        self._begun = dict[str, list[tuple[int, float]]]()
        self.base = self(ModelChange())

    def covered(self, channel: str) -> float:
        """Return the range that a channel's samples cover, in its SI unit."""
        readings = self._run.samples[:, self.estimator.channels.index(channel)]
        return (
            float(np.nanmax(readings) - np.nanmin(readings)) if np.isfinite(readings).any() else 0.0
        )

    def __call__(self, change: ModelChange) -> Outcome:
        """Return the outcome of the filter with a change."""
        return next(self.each([change]))

    def each(self, changes: Iterable[ModelChange]) -> Iterator[Outcome]:
        """Yield the outcome of the filter with each of several changes, run side by side in vector
        lanes.
        """
        changes = list(changes)
        width = self.estimator.kernel.side_by_side if len(changes) > 1 else 1
        runs = in_order(map(self._changed, changes), width, self._outcomes, os.cpu_count() or 1)
        return (outcome for _, outcome in runs)

    def _outcomes(self, inputs: list[tuple[Belief, Floats, Floats]]) -> list[Outcome]:
        """Return the outcomes of some runs, each of a belief, samples and parameters."""
        estimator = self.estimator
        (beliefs, samples, parameters) = zip(*inputs)
        found = estimator.scan_all(beliefs, len(inputs) * [self.log.time], samples, parameters)
        outcomes = []
        for (means, variances, ys), read in zip(found, samples):
            bounded = len(out_of_bounds(means, variances, len(estimator.rig.joints))) == 0
            outcomes.append(Outcome(means, variances, *estimator.innovations_of(ys, read), bounded))
        return outcomes

    def _starts(self, path: str) -> list[tuple[int, float]]:
        """Return the states whose start depends on a parameter of the rig, each with its start."""
        if path not in self._begun:
            estimator = self.estimator
            number = float(estimator.parameters[estimator.parameter_names.index(path)])
            other = estimator.states_of(estimator.rig.with_values({path: 1.01 * number}))
            means = estimator.states.means
            moved = np.flatnonzero(other.means != means) if len(other) == len(means) else ()
            self._begun[path] = [(int(i), float(means[i])) for i in moved]
        return self._begun[path]

    def _changed(self, change: ModelChange) -> tuple[Belief, Floats, Floats]:
        """Return the belief, the samples and the parameters of a run with a change."""
        estimator = self.estimator
        run = self._run
        samples = run.samples
        begin = run.start
        p = np.array(estimator.parameters)
        if change.reads_otherwise:
            samples = samples.copy()
            pair = [estimator.channels.index(name) for name in change.exchanged]
            samples[:, pair] = samples[:, pair[::-1]]
            for name, delay in change.later.items():
                at = estimator.channels.index(name)
                samples[:, at] = np.interp(self.log.time + delay, self.log.time, samples[:, at])
            for name, factor in change.channels.items():
                samples[:, estimator.channels.index(name)] *= factor
            for name, shift in change.added.items():
                samples[:, estimator.channels.index(name)] += shift
            is_finite = np.isfinite(samples)
            first = samples[is_finite.argmax(axis=0), np.arange(samples.shape[1])]
            begin = estimator.initial(self.log.time[0], first)
        kernel_state = np.array(begin.kernel_state)
        for name, shift in change.shifts.items():
            i = estimator.state_names.index(name)
            kernel_state[i] = max(kernel_state[i] + shift, estimator.states.lowest[i])
        for path, factor in change.parameters.items():
            p[estimator.parameter_names.index(path)] *= factor
            for i, start in self._starts(path):
                kernel_state[i] += (factor - 1.0) * start
        return replace(begin, kernel_state=kernel_state), samples, p
