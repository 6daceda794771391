"""What a fit minimises: −ln p of logs as a function of a rig's parameters, with its derivatives,
evaluated in vector lanes by a filter whose kernel has the free parameters as inputs.

Where a rig lacks physics, its innovations are larger than the filter expects, and keep one sign
for seconds. The weight of each channel is therefore estimated from the innovations
(docs/explanation/learning.md): their variance is taken as c S, with c the mean of ν²/S, and a
value counts by the ratio of their plain to their long-run variance. Samples in which a joint rests
in a stop do not count: its angle depends on the stop alone there.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.estimators import AdaptiveFilter, Robustness, first_values
from distal.fitting.parameters_and_priors import Free
from distal.kernels import Feed, Kernel, advance_all
from distal.kernels.layout import COMPARED_ONLY
from distal.logs import Log, true_angles
from distal.rig import Rig, Sensor
from distal.run import samples_of

FEWEST_SHARE = 0.05
"""Least share of a channel's values that counts as compared, so that one value stands for at most
20: a channel that is hardly compared tells hardly anything. Source: judgement.
"""

CORRELATED = 2.0
"""Time after which innovations are taken as independent [s], since a sensor's systematic errors
last for a stroke. Source: judgement.
"""

NORMAL_MEDIAN = 0.4549
"""Median of ν²/S where ν is normal with variance S. Source: definition (median of the χ²
distribution with one degree of freedom).
"""

UNBOUNDED = 1e100
"""Size of innovations, variances or slopes above which the filter has left all bounds. Source:
rounding (squares that overflow).
"""


@dataclass(frozen=True)
class Innovations:
    """The innovations ν of a run of the filter over a log, NaN where nothing is compared, and their
    variances S, (k, m) each.
    """

    values: Floats
    variances: Floats

    @property
    def bounded(self) -> bool:
        """Whether the filter stayed within all bounds."""
        is_bounded = (self.variances > 0.0) & (self.variances < UNBOUNDED)
        is_bounded &= np.abs(self.values) < UNBOUNDED
        return bool(np.all(is_bounded | ~np.isfinite(self.values)))


@dataclass(frozen=True)
class Weighing:
    """How the values of each channel of a log are weighed.

    Args:
        tolerance: the ν²/(c S) above which an innovation is an outlier, (m,).
        share: weight of one value, (m,).
        counts: number of values of each channel that those compared stand for, (m,). Which values
            are compared depends on the parameters (a drive's force near its stop is not), and fewer
            values must not make a log look likelier or less likely.
        scale: c, the factor by which the innovations' variances are larger than the filter expects,
            (m,).
    """

    tolerance: Floats
    share: Floats
    counts: Floats
    scale: Floats | float = 1.0


@dataclass(frozen=True)
class Derivatives:
    """−ln p, less constants, and its derivatives at a point.

    Args:
        cost: −ln p.
        gradient: its gradient by the coordinates, (n,).
        information: Fisher information of the logs, (n, n).
    """

    cost: float
    gradient: Floats
    information: Floats


def scales_of(runs: Sequence[Innovations], tolerance: Floats) -> Floats:
    """Return c of each channel over some logs, (m,): the mean of ν²/S, at least 1, where an outlier
    counts as if it were at its `tolerance`.

    This c makes the innovations most likely, −ln p = ½ Σ (ν²/(c S) + ln c S).
    """
    scales = np.ones(len(tolerance))
    for k, limit in enumerate(tolerance):
        compared = [np.isfinite(run.values[:, k]) for run in runs]
        ratios = [
            run.values[mask, k] ** 2 / run.variances[mask, k] for run, mask in zip(runs, compared)
        ]
        pooled = np.concatenate(ratios)
        if len(pooled):
            plain = max(1.0, float(np.median(pooled)) / NORMAL_MEDIAN)
            scales[k] = max(1.0, float(np.mean(np.minimum(pooled, limit * plain))))
    return scales


def shares_of(runs: Sequence[Innovations], times: Sequence[Floats]) -> Floats:
    """Return the weight of one value of each channel, (m,): Σ ν²/S over Σ (Σ_span ν/√S)², at most
    1, the ratio of the plain to the long-run variance.

    Values that keep one sign for seconds tell less than their number says (Newey and West,
    Econometrica 55, 1987; of wrong models Müller, Econometrica 81, 2013). A span lasts `CORRELATED`
    s by `times`, the stamps of each run's samples [s], (k,).
    """
    plain = together = np.zeros(runs[0].values.shape[1])
    for run, stamps in zip(runs, times):
        spans = np.floor((stamps - stamps[0]) / CORRELATED).astype(int)
        normalized = np.nan_to_num(run.values / np.sqrt(run.variances))
        of_spans = [np.bincount(spans, of_channel) for of_channel in normalized.T]
        plain = plain + np.sum(normalized**2, axis=0)
        together = together + np.sum(np.square(of_spans), axis=1)
    return 1.0 / np.maximum(1.0, together / np.maximum(plain, 1e-300))


def cost_of(run: Innovations, weighing: Weighing) -> float:
    """Return ½ Σ w (ν²/S' + ln S') over the values that were compared; it is infinite where the
    filter left all bounds.

    S' is c S, enlarged to ν²/tolerance for an outlier, as in the filter.
    """
    if not run.bounded:
        return float("inf")
    nu, spread, inflation, weight = _weighed(run, weighing)
    ratio = nu * nu / spread
    return 0.5 * float(np.sum(weight * (ratio / inflation + np.log(spread * inflation))))


def _weighed(run: Innovations, weighing: Weighing) -> tuple[Floats, Floats, Floats, Floats]:
    """Return ν, c S, the factor by which c S is enlarged, and w of all values compared, (n,)."""
    compared = np.isfinite(run.values)
    nu = run.values[compared]
    spread = (run.variances * weighing.scale)[compared]
    of_channel = (weighing.tolerance, weighing.share * evened(run, weighing))
    tolerance, weight = (np.broadcast_to(x, compared.shape)[compared] for x in of_channel)
    return nu, spread, np.maximum(1.0, nu * nu / spread / tolerance), weight


def evened(run: Innovations, weighing: Weighing) -> Floats:
    """Return the factor on the weights of each channel, (m,), with which the number of values
    compared in this run does not matter.
    """
    compared = np.maximum(np.isfinite(run.values).sum(axis=0), FEWEST_SHARE * weighing.counts)
    even: Floats = np.where(weighing.counts > 0, weighing.counts / np.maximum(compared, 1.0), 1.0)
    return even


def derivatives_of(
    base: Innovations,
    ends: Sequence[Innovations],
    widths: Floats,
    weighing: Weighing,
) -> Derivatives:
    """Return −ln p of a log and its derivatives at a point, by differences between runs.

    The score of a sample is ν ν'/S + ½ (ln S)' (1 − ν²/S), for an outlier ν'/ν; Fisher's
    information is Σ ν' ν'ᵀ/S + ½ (ln S)' (ln S)'ᵀ (Gupta and Mehra, IEEE TAC 19, 1974), here with c
    S in place of S. The scale c is held, which gives the right gradient because c minimises −ln p.

    Args:
        base: the run at the point.
        ends: for each coordinate the run at the end of a step.
        widths: the steps, (n,).
        weighing: weights of the log's values.
    """
    compared = np.isfinite(base.values)
    nu, spread, inflation, weight = _weighed(base, weighing)
    with np.errstate(all="ignore"):  # an end may have left all bounds
        slopes = [(end.values - base.values)[compared] for end in ends]
        log_slopes = [np.log(end.variances / base.variances)[compared] for end in ends]
        steps = np.reshape([slopes, log_slopes], (2, len(ends), len(nu))) / widths[:, None]
    # what is compared may change at the ends (a slider at a stop): such a sample has no slope
    slope, log_slope = np.where(np.abs(steps) < UNBOUNDED, steps, 0.0)
    inlier = inflation <= 1.0
    influence = np.where(inlier, nu / spread, 1.0 / np.where(nu == 0.0, 1.0, nu))
    surprise = np.where(inlier, 1.0 - nu * nu / spread, 0.0)
    scores = weight * (slope * influence + 0.5 * log_slope * surprise)
    root = slope * np.sqrt(weight / (spread * inflation))
    spreads = np.sqrt(0.5 * weight) * log_slope * inlier
    information = root @ root.T + spreads @ spreads.T
    return Derivatives(cost_of(base, weighing), scores.sum(axis=1), information)


NEAR_STOP = float(np.deg2rad(0.5))
"""Distance from a stop within which a joint is in it [rad], beside twice the std of its encoder's
offset. Source: judgement.
"""

AFTER_STOP = 0.05
"""Time after which a joint has left a stop [s]. Source: judgement."""


def in_stops(times: Floats, truth: Floats, rig: Rig) -> Bools:
    """Return whether each joint is in one of its stops or has just left it, (k, n_joints).

    The angles `truth` [rad], (k, n_joints), are NaN where not known; `times` are the stamps [s],
    (k,).
    """
    resting = np.zeros(truth.shape, dtype=bool)
    for j, (joint, angles) in enumerate(zip(rig.joints, truth.T)):
        if joint.stops is not None:
            doubts = [
                sensor.bias.filter_std
                for sensor in rig.sensors_of("angle")
                if sensor.of == joint.name
            ]
            margin = NEAR_STOP + 2.0 * max(doubts, default=0.0)
            low, high = joint.stops
            with np.errstate(invalid="ignore"):
                resting[:, j] = (angles < low + margin) | (angles > high - margin)
    last = np.maximum.accumulate(np.where(resting, times[:, None], -np.inf), axis=0)
    return times[:, None] - last <= AFTER_STOP


FINE = 0.2
"""Largest product of a sub-step and a joint's own angular frequency in a fit, so that the errors of
the sub-steps do not look like parameters. Source: judgement.
"""


@dataclass(frozen=True)
class Data:
    """A log, ready for the filter.

    Args:
        samples: values of its channels, those of the references last, (k, n_channels).
        rows: rows of the filter's kernel.
        last: index of each sample's own row, (k,).
    """

    log: Log
    samples: Floats
    rows: Floats
    last: NDArray[np.intp]


class FitFilter(AdaptiveFilter):
    """The filter of a fit: the free parameters are inputs of its kernel, and several runs go
    through it side by side.

    Args:
        rig: the rig, with its references.
        references: sensors of joints' angles that give the reference.
        free: the free parameters.
        compiled: whether the kernel is compiled; else it is interpreted.
    """

    def __init__(
        self,
        rig: Rig,
        references: Sequence[Sensor],
        free: Sequence[Free],
        compiled: bool = True,
    ) -> None:
        super().__init__(
            rig,
            "lanes" if compiled else False,
            Robustness.fitting(),
            name="fit",
            references=references,
            inputs=[path for part in free for path in part.paths],
            resolution=FINE,
        )
        self.references = tuple(references)

    def data_of(self, log: Log) -> Data:
        """Return a log, ready for the filter.

        The known angles are the readings of the references, NaN where they are not known.
        """
        joints = self.rig.joint_names
        context = self.states.context
        names = self.channels[: -len(self.references)]
        proximal = samples_of(log, names, self.name).copy()
        for sensor in context.channels.positions:
            centre, away = context.possible_positions(sensor)
            column = proximal[:, names.index(sensor.name)]
            column[np.abs(column - centre) > away] = np.nan
        angles = true_angles(log, joints)
        truth = np.full((len(log), len(joints)), np.nan) if angles is None else angles
        read = [joints.index(sensor.of) for sensor in self.references]
        # in a stop the angle depends on the stop alone: readings there teach nothing of the other
        # parameters
        stopped = in_stops(log.time, truth, self.rig)
        samples = np.column_stack([proximal, np.where(stopped, np.nan, truth)[:, read]])
        samples[stopped.all(axis=1), self.bridged :] = np.nan
        rows, last = self.rows(np.diff(log.time, prepend=log.time[0]), samples)
        return Data(log, samples, rows, last)


@dataclass(frozen=True)
class Weight:
    """The weights of the channels' values, as estimated at a point.

    Args:
        share: weight of one value of each channel (`shares_of`), (m,).
        counts: index of a log → the number of values of each channel that are compared, (m,).
    """

    share: Floats
    counts: Mapping[int, Floats]


@dataclass(frozen=True)
class Problem:
    """−ln p = ½ Σ w (ν²/(c S) + ln c S) + prior, of the innovations ν of logs, with variances S, at
    coordinates z.

    It is the prediction-error method (Ljung, System Identification, 1999, ch. 7; Åström, Automatica
    16, 1980): the innovations come from the filter that will be used, so that hidden states,
    missing samples and sensor noise count as in use. For each channel c is the scale of its
    variances and w the weight of its values: c is found at every point, w where `assessed` was
    called. The coordinates z, (size,), are those that all logs share, then those of each log.

    Args:
        filter: the filter, whose kernel has the free parameters as inputs.
        free: the parameters that are varied.
        data: the logs.
        out: indices of the logs that are left out.
        homing: for how long the reference is read [s], None for never, since it would hide the
            errors of the angle; with it only the reference after that time is compared.
        open_loop: whether no force is read, and only the reference compared.
        workers: number of threads; the result does not depend on it.
        weight: weights of the channels' values; None before they are assessed.
        noises: free noises that are not varied.
    """

    asks_equations: ClassVar[bool] = False
    """Whether the residuals are those of the rig's equations, not of its filter."""

    power: ClassVar[float] = 0.5
    """Power of the likelihood beside the priors [1]: a filter's own states hold most of what its
    rig lacks. Source: benchmark (python -m benchmarks.fitting: errors are 1.5 stds with 1).
    """

    filter: FitFilter
    free: tuple[Free, ...]
    data: tuple[Data, ...]
    out: frozenset[int] = frozenset()
    homing: float | None = None
    open_loop: bool = False
    workers: int = 2
    weight: Weight | None = None
    noises: tuple[Free, ...] = ()

    def assessed(self, z: Floats) -> Problem:
        """Return the problem with the weights of the channels' values as found at a point z,
        (size,), or unchanged where the filter leaves all bounds there.
        """
        runs = self.at(z)
        if not all(run.bounded for run in runs):
            return self
        counts = {
            j: np.isfinite(run.values).sum(axis=0).astype(np.float64)
            for j, run in zip(self.logs, runs)
        }
        shares = self.power * shares_of(runs, [self._times(j) for j in self.logs])
        return replace(self, weight=Weight(shares, counts))

    @property
    def logs(self) -> list[int]:
        """Indices of the logs that count."""
        return [j for j in range(len(self.data)) if j not in self.out]

    @property
    def measured(self) -> tuple[str, ...]:
        """Names of the channels that are compared, (m,)."""
        return self.filter.measured

    @cached_property
    def _is_reference(self) -> Bools:
        names = {sensor.name for sensor in self.filter.references}
        return np.array([name in names for name in self.measured])

    @cached_property
    def positions(self) -> list[list[int]]:
        """For each free parameter, the indices of its paths among the kernel's parameters."""
        names = self.filter.parameter_names
        return [[names.index(path) for path in part.paths] for part in self.free]

    @cached_property
    def parts(self) -> tuple[tuple[Free, int | None], ...]:
        """For each coordinate, (size,), its free parameter, and the index of the log that it
        belongs to, None for a coordinate that all logs share.
        """
        shared: list[tuple[Free, int | None]] = [
            (part, None) for part in self.free if not part.per_log
        ]
        per_log = [part for part in self.free if part.per_log]
        return (*shared, *((part, j) for j in range(len(self.data)) for part in per_log))

    @property
    def size(self) -> int:
        """The number of coordinates."""
        return len(self.parts)

    @property
    def bounds(self) -> Floats:
        """Lower and upper bound of each coordinate, (size, 2)."""
        return np.array([part.bounds for part, _ in self.parts]).reshape(-1, 2)

    @property
    def prior_stds(self) -> Floats:
        """Standard deviation of each coordinate's prior, infinite where it has none, (size,)."""
        return np.array([part.spread if part.has_prior else np.inf for part, _ in self.parts])

    @cached_property
    def prior_information(self) -> Floats:
        """P of the prior ½ zᵀ P z, (size, size): another quadratic penalty is added here."""
        return np.diag(1.0 / self.prior_stds**2)

    def columns(self, log: int) -> list[int]:
        """Return for each free parameter the index of the coordinate that holds it in a log."""
        return [self.parts.index((part, log if part.per_log else None)) for part in self.free]

    def run(self, tasks: Sequence[tuple[int, Floats]]) -> list[Innovations]:
        """Return the innovations of some runs, each given by the index of a log and by its
        coordinates, one for each free parameter.

        The runs go side by side in vector lanes, on all workers.
        """
        size = self._kernel.side_by_side
        # runs of one length go together, since those that end early leave their lanes idle
        order = sorted(range(len(tasks)), key=lambda k: (len(self._rows[tasks[k][0]]), tasks[k][0]))
        groups = [order[i : i + size] for i in range(0, len(order), size)]

        def work(group: list[int]) -> list[Innovations]:
            runs = advance_all(self._kernel, [self._feed(*tasks[k]) for k in group], keep=())
            return [self._compared(tasks[k][0], run.ys) for k, run in zip(group, runs)]

        with ThreadPoolExecutor(self.workers) as pool:
            done = list(pool.map(work, groups))
        innovations = dict(zip(order, itertools.chain.from_iterable(done)))
        return [innovations[k] for k in range(len(tasks))]

    @property
    def _kernel(self) -> Kernel:
        return self.filter.kernel

    def _feed(self, log: int, z: Floats) -> Feed:
        """Return the kernel's input for a log at its coordinates."""
        p = self.parameters(z)
        mean, covariance, memory = self.filter.prior(first_values(self.data[log].samples), p)
        return Feed(np.concatenate([mean, covariance.ravel(), memory]), self._rows[log], p)

    def parameters(self, z: Floats) -> Floats:
        """Return the kernel's parameters, (n_p,), at a log's coordinates, one for each free
        parameter.
        """
        p = np.array(self.filter.parameters)
        for part, positions, coordinate in zip(self.free, self.positions, z):
            p[positions] = part.values(part.value(float(coordinate)))
        return p

    @cached_property
    def _rows(self) -> tuple[Floats, ...]:
        """The kernel's rows of each log; where the reference is not read, its mask says that it is
        compared only.
        """
        masked = []
        for data in self.data:
            rows = data.rows.copy()
            times = data.log.time
            late = data.last[times - times[0] >= (0.0 if self.homing is None else self.homing)]
            rows[late, -len(self.filter.references) :] *= COMPARED_ONLY
            if self.open_loop:
                channels = self.filter.channels
                forces = [name for name, of in zip(self.measured, self._is_reference) if not of]
                width = 1 + len(channels)
                rows[:, [width + channels.index(name) for name in forces]] *= COMPARED_ONLY
            masked.append(rows)
        return tuple(masked)

    def _times(self, log: int) -> Floats:
        """Return the stamps of what is compared in a log [s], (k,)."""
        return self.data[log].log.time

    def _compared(self, log: int, ys: Floats) -> Innovations:
        data = self.data[log]
        values, variances = self.filter.innovations_of(ys[data.last], data.samples)
        if self.homing is not None or self.open_loop:
            values = np.where(self._is_reference, values, np.nan)
        if self.homing is not None:
            values[data.log.time - data.log.time[0] < self.homing] = np.nan
        return Innovations(values, variances)

    @cached_property
    def _tolerance(self) -> Floats:
        """The ν²/(c S) above which an innovation is an outlier, (m,); the reference has no
        outliers.
        """
        return np.where(self._is_reference, np.inf, Robustness().wild_force)

    def _weighing(self, log: int, scale: Floats) -> Weighing:
        """Return the weights, tolerances and scales for the values of a log's channels."""
        none = np.zeros(len(self.measured))
        weight = self.weight or Weight(none + self.power, {})
        return Weighing(self._tolerance, weight.share, weight.counts.get(log, none), scale)

    def scales(self, runs: Sequence[Innovations]) -> Floats:
        """Return c of each channel, (m,): the factor, at least 1, by which the innovations'
        variance is larger than the filter expects.
        """
        return scales_of(runs, self._tolerance)

    def at(self, z: Floats) -> list[Innovations]:
        """Return the innovations of each of the `logs` at coordinates z, (size,)."""
        return self.run([(j, z[self.columns(j)]) for j in self.logs])

    def costs(self, points: Sequence[Floats]) -> Floats:
        """Return −ln p of the `logs` and the prior at each of some points; it is infinite where the
        filter left all bounds.
        """
        runs = self.run([(j, z[self.columns(j)]) for j in self.logs for z in points])
        costs = []
        for k, z in enumerate(points):
            log_runs = runs[k :: len(points)]
            cost = np.inf
            if all(run.bounded for run in log_runs):
                scale = self.scales(log_runs)
                pairs = zip(self.logs, log_runs)
                cost = sum(cost_of(run, self._weighing(j, scale)) for j, run in pairs)
            costs.append(cost + self._prior(z))
        return np.array(costs)

    def _prior(self, z: Floats) -> float:
        return 0.5 * float(z @ self.prior_information @ z)

    def derivatives(self, z: Floats, widths: Floats) -> Derivatives:
        """Return −ln p of the `logs` and the prior at a point z, its gradient, and the logs'
        information, by one-sided differences of ν and ln S.

        The differences go over `widths`, (size,), to the side where they stay within the bounds; a
        width of 0 means that a coordinate is not varied.
        """
        low, high = self.bounds.T
        ends = np.where(z + widths <= high, z + widths, np.maximum(z - widths, low))
        steps = []
        for j in self.logs:
            at = np.array(self.columns(j))
            steps.append((j, at, at[widths[at] != 0.0]))
        tasks = [
            (j, np.where(at == k, ends[at], z[at]))
            for j, at, varied in steps
            for k in (-1, *varied)  # none, then one after the other
        ]
        runs = iter(self.run(tasks))
        of_logs = [(next(runs), [next(runs) for _ in varied]) for *_, varied in steps]
        scale = self.scales([base for base, _ in of_logs])
        cost = self._prior(z)
        gradient = self.prior_information @ z
        information = np.zeros((self.size, self.size))
        for (j, _, varied), (base, sides) in zip(steps, of_logs):
            part = derivatives_of(base, sides, (ends - z)[varied], self._weighing(j, scale))
            cost += part.cost
            gradient[varied] += part.gradient
            information[np.ix_(varied, varied)] += part.information
        return Derivatives(cost, gradient, information)
