"""What an estimate says by itself of a rig: innovations that are too large or not white, states
that left their priors; and Rao's score test: whether a change of one cause would make what was
observed likelier, by more than chance and by more than the rig's own stds allow.

With residuals r of unit variance under the rig and their derivatives D by the causes x, each cause
has the score s = −Dᵀ r and the information I = Dᵀ D (Rao, Proc. Camb. Phil. Soc. 44, 1948). Where
what a cause leaves of a channel has a larger variance, both are divided by that. Residuals are
correlated: a value of a channel counts by the ratio of its plain to its long-run variance, that of
sums over spans of time (Newey and West, Econometrica 55, 1987). The rig's own std σ of a cause
adds (I σ)² to the variance of its score.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import compress
from math import radians
from statistics import NormalDist

import numpy as np
from scipy.special import stdtrit

from distal.arrays import Bools, Floats
from distal.confidence import LARGE_PRIOR, SMALL
from distal.diagnosis.causes import Finding, Kind
from distal.estimators import StateKind
from distal.results.estimate import Estimate

LEVEL = 1e-3
"""Chance with which anything is said against a right rig, for each log and each kind of test [1].
Source: judgement.
"""

SPAN = 2.0
"""Length of the spans of time whose sums count as independent [s], as in a fit. Source: judgement.
"""

UNBOUNDED = 1e50
"""Size of a derivative beyond which a run has left all bounds [1]. Source: rounding (squares of
squares that overflow).
"""


LARGE_RATIO = 1.7
"""Largest normal mean of ν²/S of a channel [1]; a filter is an approximation, and right rigs have
up to that. Source: judgement.
"""

SELDOM = 0.5
"""Share of a channel's samples that are compared, below which a finding says so [1]. Source:
judgement.
"""

NEVER_COMPARED = 0.1
"""The same share, below which the channel tests nothing [1]. Source: judgement."""

COLOURED = 0.3
"""Correlation of a channel's neighbouring innovations from which on the rig or the sensor is
doubted [1]; a moment arm that is 20 % wrong on one side of two gives 0.3 to 0.7. Source: judgement.
"""

NOISE_RATIO = 0.5
"""Mean of ν²/S above which a channel's innovations are mostly noise [1]; below it, S is mostly the
uncertainty of the rig's parameters, whose errors last. Source: judgement.
"""

LARGEST_TRAVEL = radians(270.0)
"""Range of an angle above which it is of no joint that tendons pull [rad]; fingers and wrists turn
by 180° at most. Source: judgement.
"""


def quantile(tests: int) -> float:
    """Return the number of standard deviations beyond which one of several tests is significant at
    `LEVEL` together (Bonferroni), on either side.
    """
    return -NormalDist().inv_cdf(0.5 * LEVEL / max(tests, 1))


def span_sums(values: Floats, time: Floats) -> Floats:
    """Return the sums of values over spans of `SPAN`, (spans, n); NaN counts as zero.

    Args:
        values: (k, n).
        time: stamps [s], (k,).
    """
    starts = np.searchsorted(time, np.arange(time[0], time[-1] + 1e-9, SPAN))
    return np.add.reduceat(np.nan_to_num(values), np.unique(starts), axis=0)


def independent(residuals: Floats, time: Floats) -> Floats:
    """Return how many independent values each column of residuals is worth, (n,): its number of
    values times Σ r² over Σ (sum over a span)², at most that number.

    Args:
        residuals: (k, n), NaN where there is none.
        time: stamps [s], (k,).
    """
    plain = np.nansum(residuals**2, axis=0)
    together = np.sum(span_sums(residuals, time) ** 2, axis=0)
    counts = np.isfinite(residuals).sum(axis=0)
    values: Floats = counts * np.minimum(1.0, plain / np.maximum(together, 1e-300))
    return values


def finite_means(values: Floats) -> Floats:
    """Return the mean of each column over its values that are not NaN, (n,); 0 where none is.

    Args:
        values: (k, n).
    """
    counts = np.maximum(np.isfinite(values).sum(axis=0), 1)
    means: Floats = np.nansum(values, axis=0) / counts
    return means


@dataclass(frozen=True)
class ScoreTest:
    """Scores and information of causes.

    Args:
        residuals: r of unit variance, (k, m), NaN where nothing is compared.
        slopes: derivatives of r by each cause, (n, k, m).
        time: stamps [s], (k,).
        stds: the rig's own std of each cause, (n,).
    """

    residuals: Floats
    slopes: Floats
    time: Floats
    stds: Floats

    @cached_property
    def _sums(self) -> Floats:
        """Score, information and least-squares estimate of each cause, (n, 3).

        The weight of a channel's values is that of what a cause leaves of them, so that what it
        explains does not count as noise.
        """
        compared = np.isfinite(self.residuals)
        residuals = np.nan_to_num(self.residuals)
        counts = np.maximum(compared.sum(axis=0), 1)
        inverse = 1.0 / np.maximum(finite_means(self.residuals**2), 1.0)
        sums = np.zeros((len(self.slopes), 3))
        for k, by_cause in enumerate(self.slopes):
            slopes = np.where(compared & (np.abs(by_cause) < UNBOUNDED), by_cause, 0.0)
            square = np.sum(inverse * slopes**2)
            if square > 0.0:
                x = -np.sum(inverse * slopes * residuals) / square
                left = self.residuals + slopes * x
                variances = np.maximum(finite_means(left**2), 1.0)
                weighted = independent(left, self.time) / counts / variances * slopes
                sums[k] = -np.sum(weighted * residuals), np.sum(weighted * slopes), x
        return sums

    @property
    def estimates(self) -> Floats:
        """Change of each cause alone that makes the residuals least, (n,); zero where nothing
        depends on it.
        """
        return self._sums[:, 2]

    @property
    def standard_errors(self) -> Floats:
        """Standard error of the estimates, 1/√I, (n,); infinite where nothing depends on it."""
        with np.errstate(divide="ignore"):
            return 1.0 / np.sqrt(self._sums[:, 1])

    @property
    def statistics(self) -> Floats:
        """Rao's statistic of each cause, s²/(I + (I σ)²), (n,): χ² with one degree of freedom where
        the cause is as the rig says.
        """
        score, information, _ = self._sums.T
        variances = information + (information * self.stds) ** 2
        # without information there is no score either
        statistics: Floats = score**2 / np.where(variances > 0.0, variances, 1.0)
        return statistics

    @property
    def limit(self) -> float:
        """Number of standard errors beyond which a cause is significant among all: Student's t, of
        as many degrees of freedom as spans less one (Ibragimov and Müller, J. Business and Economic
        Statistics 28, 2010).
        """
        spans = len(span_sums(self.time[:, None], self.time))
        return float(stdtrit(max(spans - 1, 1), 1.0 - 0.5 * LEVEL / len(self.stds)))

    @property
    def significant(self) -> Bools:
        """Whether each cause is significant among all, (n,)."""
        return self.statistics > self.limit**2


LONGEST_LINE = 200
"""Largest number of characters of the line, roughly. Source: layout."""

NOTHING = (
    "not checked: no sensor is compared (this estimator has no innovations, or the rig no "
    "force sensor)"
)


@dataclass(frozen=True)
class ChannelStatistics:
    """Statistics of the innovations of each channel, all in the order of `names`.

    Where logs taught what forces are normal, innovations tell nothing: the ratios are 1 then, the
    correlations 0, and the limits infinite.

    Args:
        names: of the channels.
        ratios: means of ν²/S, NaN where nothing was compared.
        correlations: of neighbouring normalised innovations.
        since: time from which on a channel disagrees to the end [s], or NaN.
        shares: of the samples that were compared.
        limits: of the ratios, by chance.
    """

    names: tuple[str, ...]
    ratios: Floats
    correlations: Floats
    since: Floats
    shares: Floats
    limits: Floats

    @property
    def is_tested(self) -> Bools:
        """Whether each channel could have disagreed, (m,)."""
        return (self.ratios >= SMALL) & (self.shares >= NEVER_COMPARED)

    @property
    def tested(self) -> tuple[str, ...]:
        """Names of the channels that could have disagreed."""
        return tuple(compress(self.names, self.is_tested))

    def disagreeing(self) -> list[Finding]:
        """Return the findings on channels that disagree."""
        large = self.ratios > self.limits
        coloured = self.correlations > COLOURED
        coloured &= self.ratios > NOISE_RATIO
        count = large.sum()
        several = ", ".join(compress(self.names, large if count else coloured))
        kind: Kind = "too large"
        if not several:
            return []
        if count == 1 and np.isfinite(self.since[large][0]):
            kind = "disagrees"
            text = f"sensor {several} disagrees from {self.since[large][0]:.0f} s on: its "
            text += "innovations are too large"
        elif count:
            verb = "disagrees" if count == 1 else "disagree"
            size = np.sqrt(self.ratios[large].max())
            text = f"{several} {verb} with the rig: innovations {size:.1f}× larger than normal"
        else:
            kind = "drifts"
            largest = self.correlations[coloured].max()
            text = f"innovations of {several} are not white (correlation {largest:.1f})"
            text += ": something acts that the rig does not have"
        return [Finding(kind, several, text)]

    def untested(self) -> list[Finding]:
        """Return the findings on channels that test nothing."""
        findings = []
        for name, ratio, share in zip(self.names, self.ratios, self.shares):
            if share < SELDOM:
                text = f"only {100 * share:.0f} % of {name} could be compared"
                text += " (missing, or the slider at a stop)"
                findings.append(Finding("hardly compared", name, text))
            if share >= NEVER_COMPARED and ratio < SMALL:
                text = f"not tested by {name}: its innovations are "
                text += f"only {np.sqrt(ratio):.2f} of the expected size"
                findings.append(Finding("not tested", name, text))
        return findings


def statistics_of(
    names: Sequence[str], scaled: Floats, time: Floats, *, is_taught: bool
) -> ChannelStatistics:
    """Return the statistics of the innovations of channels.

    The mean of m squares of variance 2 of correlated values, ρ their correlation, is significant
    beyond 1 + z √(2 (1 + ρ²)/((1 − ρ²) m)) of what is normal (Bartlett 1946).

    Args:
        names: of the channels.
        scaled: ν/√S, (k, m), NaN where not compared.
        time: stamps [s], (k,).
        is_taught: see `Estimate`.
    """
    # in the first moments the filter still finds the parameters
    settled = time >= time[0] + min(0.5, 0.1 * np.ptp(time))
    shares = np.isfinite(scaled).mean(axis=0)
    if is_taught:
        ratios = np.where(shares > 0.0, 1.0, np.nan)
        none, never, beyond = (np.full(len(names), x) for x in (0.0, np.nan, np.inf))
        return ChannelStatistics(tuple(names), ratios, none, never, shares, beyond)
    later = scaled[settled]
    counts = np.isfinite(later).sum(axis=0)
    correlations = np.array([_neighbours(column) for column in later.T])
    squares = np.minimum(correlations**2, 0.99)
    spreads = np.sqrt(2.0 * (1.0 + squares) / (1.0 - squares) / np.maximum(counts, 1))
    limits = LARGE_RATIO * (1.0 + quantile(len(names)) * spreads)
    return ChannelStatistics(
        tuple(names),
        np.where(counts > 0, finite_means(later**2), np.nan),
        correlations,
        np.array([_since(time, *channel) for channel in zip(scaled.T, limits)]),
        shares,
        limits,
    )


def _neighbours(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    if len(finite) < 20 or np.std(finite) == 0.0:
        return 0.0
    return float(np.clip(np.mean(finite[1:] * finite[:-1]) / np.mean(finite**2), -1, 1))


def _since(time: Floats, scaled: Floats, limit: float) -> float:
    """Return the time from which on a channel is too large to the end; NaN if it is from the begin,
    or is not.

    Of all spans it is the one from which on ν²/S is most above its limit, in the sum (the change
    point of Page's cumulative sum, Biometrika 41, 1954).
    """
    squares = scaled[:, None] ** 2
    sums = span_sums(squares - np.where(np.isfinite(squares), limit, 0.0), time).ravel()
    above = np.cumsum(sums[::-1])[::-1]
    first = int(np.argmax(above))
    before = sums[:first].sum()
    return float(time[0] + first * SPAN) if first > 0 and before < 0.0 < above[first] else np.nan


def _left(estimate: Estimate) -> list[Finding]:
    """Return the findings on parameters that left their priors."""
    means = estimate.prior_means
    stds = estimate.prior_stds
    ends = estimate.means[-1]
    spreads = np.sqrt(estimate.variances[-1])
    away = np.abs(ends - means)
    left = dict[str, Finding]()
    # NaN: a state that is meant to move
    order = np.flatnonzero((stds > 0.0) & (away - spreads > LARGE_PRIOR * stds))
    order = order[np.argsort(-away[order] / stds[order], kind="stable")]
    for i in order:
        subject = estimate.state_names[i]
        if estimate.state_kinds[i] is StateKind.LINEARITY:
            # the weights of a sensor's linearity are one thing
            subject = f"linearity_{estimate.state_parts[i]}"
        text = f"{subject} is {ends[i]:.3g} ± {spreads[i]:.1g}"
        text += f", its prior {means[i]:.3g} ± {stds[i]:.1g}"
        left.setdefault(subject, Finding("left its prior", subject, text))
    return list(left.values())


def _turning(estimate: Estimate) -> list[Finding]:
    covered = zip(estimate.joint_names, np.ptp(estimate.angles, axis=0).tolist())
    return [
        Finding(
            "cannot be there",
            joint,
            f"the angle of {joint} covers {np.rad2deg(most):.0f}°, which no joint does: is a gear, "
            "a unit or a radius wrong?",
        )
        for joint, most in covered
        if most > LARGEST_TRAVEL
    ]


def _friction(estimate: Estimate) -> Iterator[Finding]:
    for i, (kind, drive) in enumerate(zip(estimate.state_kinds, estimate.state_parts)):
        friction = estimate.means[-1, i]
        prior, std = np.sqrt(estimate.variances[[0, -1], i])
        if kind is StateKind.FRICTION and friction > max(0.25 * prior, 3.0 * std):
            size = f"friction that the rig does not have: {friction:.2g} at '{drive}' [SI]"
            text = f"{size} (set drives.{drive}.friction, or a hand acts)"
            yield Finding("friction", drive, text)


@dataclass(frozen=True)
class Diagnosis:
    """What a log says of the rig, the sensors and the band.

    Args:
        channels: statistics of the innovations.
        findings: contradictions first, then what is untested.
    """

    channels: ChannelStatistics
    findings: tuple[Finding, ...] = ()

    def __str__(self) -> str:
        """Return the line."""
        return self.text

    @property
    def tested(self) -> tuple[str, ...]:
        """Names of the channels that could have disagreed."""
        return self.channels.tested

    @property
    def headline(self) -> str:
        """The line up to its first colon: the result without the reasons."""
        return self.text.split(":")[0]

    @property
    def contradicts(self) -> bool:
        """Whether anything contradicts."""
        return any(finding.contradicts for finding in self.findings)

    @property
    def untested(self) -> bool:
        """Whether nothing was tested and nothing contradicts."""
        return not self.tested and not self.contradicts

    @property
    def consistent(self) -> bool:
        """Whether something was tested and nothing contradicts."""
        return bool(self.tested) and not self.contradicts

    def _of(self, kind: Kind) -> list[Finding]:
        return [finding for finding in self.findings if finding.kind == kind]

    @property
    def text(self) -> str:
        """The diagnosis in one line."""
        hardly = [finding.text for finding in self._of("hardly compared")]
        if self.contradicts:
            return _joined([f.text for f in self.findings if f.contradicts] + hardly)
        beyond = [finding.subject for finding in self._of("cannot test")]
        small = self._of("not tested")
        parts = [f"an error inside the band: {f.text}" for f in self._of("would explain")]
        if not self.channels.names:
            parts.append(NOTHING)
        elif not self.tested:
            parts += [f.text for f in small] or ["not tested: hardly anything could be compared"]
        else:
            least = self.channels.shares[self.channels.is_tested].min()
            verb = "agrees" if len(self.tested) == 1 else "agree"
            compared = f"{100 * least:.0f} % compared"
            agree = f"{', '.join(self.tested)} {verb} with the rig, {compared}"
            parts.append(agree if beyond or parts else f"consistent: {agree}")
            silent = ", ".join(finding.subject for finding in small)
            hardly += [f"not tested by {silent}"] if small else []
        return _joined([*parts, *hardly], beyond)


def diagnose_estimate(
    estimate: Estimate,
    further: Sequence[Finding] = (),
    channels: ChannelStatistics | None = None,
) -> Diagnosis:
    """Return what the innovations and states of an estimate say, together with findings by other
    means; see `distal.diagnose`.

    Args:
        estimate: to be diagnosed.
        further: findings by other means.
        channels: statistics of the innovations; by default those of the estimate.
    """
    channels = channels_of(estimate) if channels is None else channels
    # the truth has the last word, so it is said first; causes come right after what they explain
    truth = [finding for finding in further if finding.kind == "against the truth"]
    looks = [finding for finding in further if finding.kind in ("looks like", "cannot be there")]
    disagreeing = channels.disagreeing()
    findings = [
        *truth,
        *(looks + disagreeing if truth else disagreeing + looks),
        # numbers of a rig that lacks physics stray without end
        *([] if estimate.is_taught else _left(estimate.with_all_states)),
        *_turning(estimate),
        *_friction(estimate.with_all_states),
        *(finding for finding in further if finding not in (*truth, *looks)),
        *channels.untested(),
    ]
    findings.sort(key=lambda finding: not finding.contradicts)
    return Diagnosis(channels, tuple(findings))


def channels_of(estimate: Estimate) -> ChannelStatistics:
    """Return the statistics of the innovations of an estimate."""
    scaled = estimate.innovations / np.sqrt(estimate.innovation_variances)
    return statistics_of(estimate.measured, scaled, estimate.time, is_taught=estimate.is_taught)


def _joined(parts: Sequence[str], beyond: Sequence[str] = ()) -> str:
    """Return the parts and what cannot be felt as one line; parts that do not fit are counted, and
    the list of what cannot be felt is cut.
    """
    line = parts[0]
    for k, part in enumerate(parts[1:]):
        if len(line) + len(part) + 2 > LONGEST_LINE:
            return f"{line}; and {len(parts) - 1 - k} more (--findings)"
        line = f"{line}; {part}"
    for k, subject in enumerate(beyond):
        added = f"; {subject}" if k else f"; cannot be felt: {subject}"
        if len(line) + len(added) > LONGEST_LINE - 3:
            return f"{line}; …"
        line += added
    return line
