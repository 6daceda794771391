"""Which cause explains what a log says against its rig: sizes by known motion and by the score
test, then the filter itself, run without each likely cause, side by side in vector lanes.

Of a rig whose logs taught what forces are normal, it is the change of a reading after which the
forces are those of free motion at their positions (`wrong_readings`). Each change costs k Σ
min(T², c) + 2 ln(1 + δ²): T² of `distal.run.exchanged_or_late` in the mean of the log, c where a
position is where no log has been; k spans of time that count as independent; and the distance δ of
the change from what the rig says, in its stds, with Cauchy's prior.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from itertools import combinations
from math import log1p, sqrt

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND, LARGE_PRIOR
from distal.diagnosis.causes import UNITS, Cause, of_sensors, starts_of, swap
from distal.diagnosis.innovation_tests import (
    SPAN,
    ScoreTest,
    finite_means,
    independent,
    quantile,
)
from distal.estimators import AdaptiveFilter, Belief, KernelEstimator, Robustness, first_values
from distal.kernels import in_order
from distal.logs import LARGEST_READING, Log, true_angles
from distal.rig import Rig
from distal.run.exchanged_or_late import Redundancy
from distal.run.offline import out_of_bounds, prepared

MOST_SAMPLES = 6000
"""Largest number of samples of a log over which the filter runs with changes, the first ones: a
minute at 100 Hz. Source: judgement.
"""

OUTLIER = Robustness().wild_force
"""Value of ν²/S above which an innovation is an outlier [1], as in the filter."""

Change = Mapping[Cause, float]
"""Size of each cause that is changed in a run."""

Gains = list[tuple[Change, float]]
"""Changes with their gains in −2 ln p, the likeliest first."""


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
        return self.innovations / np.sqrt(self.innovation_variances)

    def log_likelihoods(self) -> Floats:
        """Return ln p of a value of each channel in the mean, (m,), without a constant; an outlier
        counts as in the filter.
        """
        squares = self.normalized**2
        inflation = np.maximum(1.0, squares / OUTLIER)
        terms = squares / inflation + np.log(self.innovation_variances * inflation)
        return -0.5 * finite_means(terms)

    def excess(self) -> float:
        """Return how much the innovations are too large, ½ ln max(1, mean ν²/S) in the mean of the
        channels: −ln p of a value whose S is as much too small.
        """
        means = finite_means(self.normalized**2)
        return float(np.mean(0.5 * np.log(np.maximum(means, 1.0)))) if means.size else 0.0


class PerturbedRuns:
    """Runs the adaptive filter over the first `MOST_SAMPLES` samples of a log with changes; its
    kernel is built once.

    Args:
        log: of the estimate.
        estimator: the adaptive filter.
        homing: time for which the reference angle is used [s], or None.
    """

    def __init__(self, log: Log, estimator: KernelEstimator, homing: float | None = None) -> None:
        if len(log) > MOST_SAMPLES:
            log = log.select(slice(MOST_SAMPLES))
            if homing is not None and homing >= np.ptp(log.time):
                homing = None
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
        return outcome.angles - (np.nan if self.truths is None else self.truths)

    def _outcomes(self, inputs: list[tuple[Belief, Floats, Floats]]) -> list[Outcome]:
        estimator = self.estimator
        (beliefs, samples, parameters) = zip(*inputs)
        scans = estimator.scan_all(beliefs, len(inputs) * [self.log.time], samples, parameters)
        joints = len(estimator.rig.joints)
        outcomes = []
        for (filter_means, filter_variances, ys), read in zip(scans, samples):
            bounded = len(out_of_bounds(filter_means, filter_variances, joints)) == 0
            moments = estimator.reported(filter_means, filter_variances, ys, read)
            angles, variances = (moment[:, :joints].copy() for moment in moments[:2])
            innovations, spreads = moments[2:]
            outcomes.append(Outcome(angles, variances, innovations, spreads, bounded))
        return outcomes

    def _changed(self, change: Change) -> tuple[Belief, Floats, Floats]:
        """Return the belief, the samples and the parameters of a run with a change."""
        estimator = self.estimator
        names = estimator.parameter_names
        samples = self._run.samples.copy()
        p = np.array(estimator.parameters)
        for cause, x in change.items():
            cause.apply(x, samples, estimator.channels, self.log.time)
            for path in cause.paths:
                for name in (path, *starts_of(estimator, path)):
                    p[names.index(name)] *= 1.0 + x
        if not change:
            return self._run.start, samples, p
        samples = np.where(np.abs(samples) > LARGEST_READING, np.nan, samples)
        mean, covariance, memory = estimator.prior(first_values(samples), p)
        kernel_state = np.concatenate([mean, covariance.ravel(), memory])
        return replace(self._run.start, kernel_state=kernel_state), samples, p


class Derivatives:
    """The filter over a log, and how its results depend on causes, by one pass of the filter over
    the log in vector lanes.

    Args:
        runs: of the filter.
        causes: all that are perturbed.
    """

    def __init__(self, runs: PerturbedRuns, causes: Sequence[Cause]) -> None:
        self.runs = runs
        self.causes = causes
        self.base, *ends = runs([{}, *({cause: cause.step} for cause in causes)])
        base = self.base
        spread = np.sqrt(base.innovation_variances)
        pairs = [*zip(causes, ends)]
        with np.errstate(invalid="ignore"):
            angles = [(end.angles - base.angles) / cause.step for cause, end in pairs]
            innovations = [
                (end.innovations / spread - base.normalized) / cause.step for cause, end in pairs
            ]
        self.angles: Floats = np.array(angles)
        """Derivatives of the angles by the causes, (n, k, n_joints)."""
        self.innovations: Floats = np.array(innovations)
        """Derivatives of ν/√S by the causes at the S of the base, (n, k, m)."""

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
        limits = np.sqrt(OUTLIER * np.maximum(finite_means(residuals**2), 1.0))
        return ScoreTest(np.clip(residuals, -limits, limits), self.innovations, time, stds)


@dataclass(frozen=True)
class Trial:
    """Causes that are taken off in a run of the filter: one, or two together.

    Args:
        change: size of each change.
        outcome: of the run.
        gain: in −2 ln p.
    """

    change: Change
    outcome: Outcome
    gain: float


NEARER = (0.6, 0.85, 1.15, 1.4)
"""Shares of a change that are tried beside it [1]. Source: judgement."""

LIKELIEST = 4
"""Number of the likeliest causes that are refined; twice as many are tried beside the first [1].
Source: judgement.
"""

LARGEST_CHANGE = 0.7
"""Largest change of a factor by the score test alone [1]: it is linear. Source: judgement."""

FRICTIONS_TRIED = (-0.6, 1.5)
"""Changes of friction and damping that are tried [1]: kinks hide their derivatives. Source:
judgement.
"""

HALF = 0.5
"""Largest share of the error of a joint that a cause may leave [1]: what leaves more explains
little. Source: definition (half).
"""

NOISE_SHARE = 0.3
"""Share ε of the band's std that is noise, and not an error of the rig [1]: smaller errors are not
explained. Source: judgement.
"""


def candidates(
    causes: Sequence[Cause], sized: Mapping[Cause, Sequence[float]], tests: Sequence[ScoreTest]
) -> list[Change]:
    """Return changes that may explain what was found: signs, units and exchanged columns; sizes by
    known motion, and half of them; and those of causes that a score test finds significant.

    Args:
        causes: all.
        sized: sizes by known motion.
        tests: score tests, in the order of the causes.
    """
    chosen = list[Change]()
    for i, cause in enumerate(causes):
        tried = list(cause.tried)
        if cause.kind in ("friction", "damping"):
            tried += FRICTIONS_TRIED
        for x in sized.get(cause, ()):
            tried += [x, sqrt(1.0 + x) - 1.0] if cause.is_factor and x > -1.0 else [x]
        limit = LARGEST_CHANGE if cause.is_factor else np.inf
        tried += [
            float(np.clip(test.estimates[i], -limit, limit))
            for test in tests
            if cause.kind != "swap" and test.significant[i]
        ]
        chosen += [{cause: x} for x in tried if x != 0.0]
    return chosen


@dataclass
class Search:
    """Runs without each likely cause, and what is gained by it.

    −2 ln p = k Σ_j ln(e_j² + (ε σ_j)²) + 2 ln(1 + δ²) with known angles: the mean square error e_j²
    of joint j and the variance σ_j² of its band, of which the share ε is noise; the number k of
    independent values, and the distance δ of the change from the rig in its stds, with Cauchy's
    prior. If the sensors agree less with each other, that is subtracted. Without known angles it is
    −2 ln p of the innovations; readings that are scaled have the density of what they were.

    Args:
        runs: of the filter.
        base: the run as the rig says.
        of_truth: whether known angles are asked, not the innovations.
    """

    runs: PerturbedRuns
    base: Outcome
    _: KW_ONLY
    of_truth: bool

    def __call__(self, changes: Sequence[Change]) -> list[Trial]:
        """Return the trials of causes that explain something by more than chance, the best of each
        cause, the likeliest first.
        """
        outcomes = self._tried(changes)
        if not outcomes:
            return []
        residuals = self.base.normalized
        if self.of_truth:
            errors = (self.runs.errors(outcome) for _, outcome in outcomes)
            residuals = min(errors, key=lambda error: max(finite_means(error**2)))
        counts = independent(residuals, self.runs.log.time)
        self._count = float(counts.max(initial=1.0))
        trials = self._best(self._weighed(outcomes))
        if self.of_truth:
            near = [
                {cause: share * x}
                for trial in trials[:LIKELIEST]
                for cause, x in trial.change.items()
                for share in NEARER
                if cause.kind != "swap"
            ]
            likely = {cause for trial in trials[1 : 2 * LIKELIEST] for cause in trial.change}
            others = [change for change in changes if likely.issuperset(change)]
            pairs = [{**trials[0].change, **other} for other in others]
            ranked = self._best([*trials, *self._weighed(self._tried([*near, *pairs]))])
            trials = [trial for trial in ranked if len(trial.change) == 1]
            both = [trial for trial in ranked if len(trial.change) == 2][:1]
            needed = trials[0].gain + quantile(len(trials)) ** 2
            if any(t.gain > needed and self._halves(t.outcome, trials[0].outcome) for t in both):
                trials = both
            trials = [trial for trial in trials if self._halves(trial.outcome, self.base)]
        else:
            # a known angle may speak against what the innovations allow
            trials = [trial for trial in trials if not self._halves(self.base, trial.outcome)]
        # of a filter that was lost anything that is not is likelier
        least = quantile(1) ** 2 if self.base.bounded else -np.inf
        return [trial for trial in trials if trial.gain > least]

    def _tried(self, changes: Sequence[Change]) -> list[tuple[Change, Outcome]]:
        """Return the changes with which the filter stays within all bounds, and its outcomes."""
        return [pair for pair in zip(changes, self.runs(changes)) if pair[1].bounded]

    def _weighed(self, outcomes: Iterable[tuple[Change, Outcome]]) -> list[Trial]:
        return [Trial(*pair, self._gain(*pair)) for pair in outcomes]

    def _best(self, trials: Sequence[Trial]) -> list[Trial]:
        best = dict[tuple[Cause, ...], Trial]()
        for trial in sorted(trials, key=lambda trial: -trial.gain):
            best.setdefault(tuple(trial.change), trial)
        return list(best.values())

    def _halves(self, outcome: Outcome, before: Outcome) -> bool:
        """Return whether the largest error of a joint falls to `HALF` of what it was
        before; a filter that was lost had an error of a radian.
        """
        last = max(self._squares(before)) if before.bounded else 1.0
        return outcome.bounded and bool(max(self._squares(outcome)) < HALF**2 * last)

    def _squares(self, outcome: Outcome) -> Floats:
        return finite_means(self.runs.errors(outcome) ** 2)

    def _cost(self, outcome: Outcome) -> float:
        """Return k Σ_j ln(e_j² + (ε σ_j)²); 0, of errors of a radian, where the filter is lost.

        The σ are those of the run, at most those of the base; a run whose band is more than twice
        as wide pays for it, since a sensor that it leaves out explains nothing.
        """
        if not outcome.bounded:
            return 0.0
        variances = np.mean(outcome.variances, axis=0)
        usual = np.mean(self.base.variances, axis=0) if self.base.bounded else variances
        noise = NOISE_SHARE**2 * np.minimum(variances, usual)
        spread = self._squares(outcome) + noise + np.maximum(HALF**2 * variances - usual, 0.0)
        return self._count * float(np.sum(np.log(spread)))

    def _gain(self, change: Change, outcome: Outcome) -> float:
        base = self.base
        far = sum(log1p(cause.distance(x) ** 2) for cause, x in change.items())
        if self.of_truth:
            worse = outcome.excess() - (base.excess() if base.bounded else 0.0)
            if worse > HALF:
                return -np.inf  # a reading so wrong that the filter leaves it out explains nothing
            likelier = 0.5 * (self._cost(base) - self._cost(outcome)) - self._count * max(
                worse, 0.0
            )
        else:
            values = outcome.log_likelihoods() - (base.log_likelihoods() if base.bounded else 0.0)
            for k, name in enumerate(self.runs.estimator.measured):
                values[k] += sum(c.jacobian(x) for c, x in change.items() if c.channels == (name,))
            likelier = self._count * float(np.mean(values))
        return 2.0 * (likelier - far)


UNFELT = ("scale", "zero", "arm", "stiffness")
"""Kinds of causes that may move an angle before any innovation shows it. Source: definition."""


def unfelt(derivatives: Derivatives, test: ScoreTest) -> Iterator[Cause]:
    """Yield the causes that no innovation shows before the angle leaves its band: the smallest
    change that the score test would notice, or of a factor the whole, moves an angle by more than
    the band.

    Args:
        derivatives: of the filter's results.
        test: score test of the innovations.
    """
    noticed = test.limit * np.hypot(test.standard_errors, test.stds)
    moved = np.sqrt(np.mean(derivatives.angles**2, axis=1))
    band = BAND * np.sqrt(np.mean(derivatives.base.variances, axis=0))
    for cause, least, by in zip(derivatives.causes, noticed, moved):
        change = min(least, 1.0) if cause.is_factor else least
        if cause.kind in UNFELT and np.any(by > band / change):
            yield cause


SAMPLES = 400
"""Number of samples of a log that are looked at. Source: layout (they take half a second)."""

SIZES = 9
"""Number of sizes of a change that are tried at first. Source: layout."""

LARGEST_FACTOR = 3.0
"""Largest factor of a reading that is no unit [1]. Source: layout."""

LONGEST_DELAY = 0.3
"""Largest delay of a reading [s]. Source: layout."""


def wrong_readings(log: Log, rig: Rig) -> Gains:
    """Return the changes of readings that take off most of what is not as in free motion.

    Args:
        log: of the rig.
        rig: with `LearnedMaps.efforts`.
    """
    redundancy = replace(Redundancy.of(rig, list(log.channels)), supposes=False)
    names = redundancy.channels
    log = log.select(slice(None, None, max(len(log) // SAMPLES, 1)))
    time = log.time
    readings = np.column_stack(list(log.channels.values()))
    spans = max(np.ptp(time) / SPAN, 1.0)
    weights = np.array([len(learned.joints) for learned in redundancy.maps])

    def judged(cause: Cause, x: float) -> tuple[float, float, float]:
        """Return the cost of a change, the share of the log that is not as in free motion, and the
        change.
        """
        samples = readings.copy()
        cause.apply(x, samples, names, time)
        is_read = np.isfinite(samples)
        costs, unlike, outside = redundancy.along(time, np.where(is_read, samples, 0.0), is_read)
        far = 2.0 * log1p(cause.distance(x) ** 2)
        share = float(np.mean(np.hstack([outside, unlike]).any(axis=1)))
        return spans * float(np.mean(costs @ weights)) + far, share, x

    read = list(of_sensors(rig, names, float(np.median(np.diff(time)))))
    before, share, _ = judged(read[0], 0.0)
    tried = [
        (min(judged(cause, x) for x in sizes), cause)
        for cause in [*read, *_of_all(rig, names)]
        if (sizes := [*cause.tried, *_sizes(cause, readings, names)])
    ]
    trials: Gains = []
    for best, cause in sorted(tried, key=lambda trial: trial[0])[:SIZES]:
        cost, left, x = best
        if x not in cause.tried:
            cost, left, x = min(best, *(judged(cause, part * x) for part in NEARER))
        if left < HALF * share:
            trials.append(({cause: x}, before - cost))
    return sorted(trials, key=lambda trial: -trial[1])


def _of_all(rig: Rig, channels: Sequence[str]) -> Iterator[Cause]:
    """Yield the units in which all positions or forces may be read together, and drives whose
    readings are all exchanged.
    """
    read = [sensor for sensor in rig.sensors if sensor.name in channels]
    for first, second in combinations(rig.drive_names, 2):
        these, others = ([s for s in read if s.of == name] for name in (first, second))
        if len(these) > 1 and [s.measures for s in these] == [s.measures for s in others]:
            yield swap(f"{first} and {second}", these, others)
    for unit, factors in UNITS.items():
        names = tuple(s.name for s in read if s.si == unit)
        if len(names) > 1:
            yield Cause(
                "scale",
                ", ".join(names),
                names,
                tried=tuple(factor - 1.0 for factor in factors),
                unit=unit,
            )


def _sizes(cause: Cause, readings: Floats, names: Sequence[str]) -> list[float]:
    """Return the sizes of a change that are tried at first, as far apart as they are wide."""
    if len(cause.channels) > 1:
        return []
    if cause.kind == "scale":
        return [*np.geomspace(1.0 / LARGEST_FACTOR, LARGEST_FACTOR, SIZES) - 1.0]
    if cause.kind == "delay":
        return [*np.linspace(-LONGEST_DELAY, LONGEST_DELAY, SIZES)]
    largest = np.nan_to_num(np.abs(readings[:, names.index(cause.channels[0])])).max()
    return [*np.linspace(-largest, largest, 2 * SIZES + 1)] if largest > 0.0 else []
