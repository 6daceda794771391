"""What a fit minimises: −ln p of logs as a function of a rig's numbers, evaluated in vector
lanes.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from distal.arrays import Bools, Floats
from distal.estimators import Robustness, first_values
from distal.fitting.fit_filter import Data, FitFilter
from distal.fitting.free_parameter import Free
from distal.fitting.likelihood import (
    Derivatives,
    Innovations,
    Weighing,
    cost_of,
    derivatives_of,
    scales_of,
    shares_of,
)
from distal.kernels import Feed, Kernel, advance, advance_all, covariance_of, mean_of
from distal.kernels.mask import COMPARED_ONLY

PROBED = 0.3
"""How a step bends is found at this share of it."""


@dataclass(frozen=True)
class Weight:
    """What the values of each channel are worth, as found at a point: how much one counts
    (`shares_of`), (m,).

    The counts are how many values of each channel are compared, of each log, (m,) each.
    """

    share: Floats
    counts: tuple[Floats, ...]


@dataclass(frozen=True)
class Problem:
    """−ln p = ½ Σ w (ν²/(c S) + ln c S) + prior of the innovations ν of logs, with variances S, at
    coordinates z.

    The prediction-error method (Ljung, System Identification, 1999, ch. 7; Åström, Automatica 16,
    1980): hidden states, missing samples and sensor noise are treated as in use, because it is the
    filter that is used. Of each channel c and w say what its values are weight: c is found at every
    point, w where `assessed` was called. Coordinates z, (size,), are those that logs share, then
    each log's own.

    Args:
        filter: with what is free as inputs.
        homing: for how long the reference is used [s], None for never; with it only what comes
            after counts.
        aided: without homing, use the reference wherever it is as one more sensor, which tells more
            where the model is right, and hides what the angle errs by where it is not.
        workers: threads; the numbers do not depend on them.
        weight: of the channels' values; None before they are assessed: every value counts in full.
        noises: that are free and not varied.
    """

    asks_equations: ClassVar[bool] = False
    """Whether the rig's equations are asked, and not its filter."""

    filter: FitFilter
    free: tuple[Free, ...]
    data: tuple[Data, ...]
    homing: float | None = None
    aided: bool = False
    workers: int = 2
    weight: Weight | None = None
    noises: tuple[Free, ...] = ()

    def beginning(self, share: float, least: int) -> Problem:
        """Return the same for the beginnings of the logs, a `share` of each, of `least` samples or
        more; not assessed.
        """
        data = tuple(
            log_data.beginning(max(least, round(share * len(log_data.last))))
            for log_data in self.data
        )
        return replace(self, data=data, weight=None)

    def among(self, logs: Sequence[int]) -> Problem:
        """Return the problem of some of the logs; what their values are worth stays."""
        weight = self.weight
        if weight is not None:
            weight = replace(weight, counts=tuple(weight.counts[j] for j in logs))
        return replace(self, data=tuple(self.data[j] for j in logs), weight=weight)

    def assessed(self, z: Floats) -> Problem:
        """Return the problem with the worth of the channels' values at a point, as it is where the
        filter is unbounded.
        """
        runs = self.at(z)
        if not all(run.bounded for run in runs):
            return self
        counts = tuple(np.isfinite(run.values).sum(axis=0).astype(np.float64) for run in runs)
        return replace(
            self,
            weight=Weight(shares_of(runs, [self._times(j) for j in range(len(self.data))]), counts),
        )

    @property
    def of_filter(self) -> Problem:
        """The filter's problem at the same coordinates."""
        return self

    @property
    def measured(self) -> tuple[str, ...]:
        """Names of the channels that are compared, (m,)."""
        return self.filter.estimator.measured

    @cached_property
    def _is_reference(self) -> Bools:
        names = {sensor.name for sensor in self.filter.references}
        return np.array([name in names for name in self.measured])

    @cached_property
    def positions(self) -> list[list[int]]:
        """Where among the kernel's parameters each free number stands."""
        names = self.filter.estimator.parameter_names
        return [[names.index(path) for path in part.paths] for part in self.free]

    @cached_property
    def parts(self) -> tuple[tuple[Free, int | None], ...]:
        """The free number behind each coordinate, and the log where it is one log's own,
        (size,).
        """
        shared: list[tuple[Free, int | None]] = [
            (part, None) for part in self.free if not part.per_log
        ]
        per_log = [part for part in self.free if part.per_log]
        return (*shared, *((part, j) for j in range(len(self.data)) for part in per_log))

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.parts)

    @property
    def bounds(self) -> Floats:
        """Lower and upper bound of each coordinate, (size, 2)."""
        return np.array([part.bounds for part, _ in self.parts]).reshape(-1, 2)

    @property
    def prior_stds(self) -> Floats:
        """Standard deviation of each coordinate's prior, infinite where it has none, (size,)."""
        return np.array([part.spread if part.has_prior else np.inf for part, _ in self.parts])

    def columns(self, log: int) -> list[int]:
        """Return for each free number the coordinate that holds it in a log."""
        positions = {(id(part), of_log): k for k, (part, of_log) in enumerate(self.parts)}
        return [positions[id(part), log if part.per_log else None] for part in self.free]

    def run(self, tasks: Sequence[tuple[int, Floats]]) -> list[Innovations]:
        """Return the innovations of some runs, of a log's index and its coordinates, one for each
        free number.

        They go side by side in vector lanes, on all workers.
        """
        size = self._kernel.side_by_side
        # runs of one length go together, since those that end early leave their lanes idle
        order = sorted(range(len(tasks)), key=lambda k: (len(self._rows[tasks[k][0]]), tasks[k][0]))
        groups = [order[i : i + size] for i in range(0, len(order), size)]

        def work(group: list[int]) -> list[Innovations]:
            runs = advance_all(self._kernel, [self._feed(*tasks[k]) for k in group], keep=())
            return [self._compared(tasks[k][0], run.ys) for k, run in zip(group, runs)]

        if self.workers < 2 or len(groups) < 2:
            done = [work(group) for group in groups]
        else:
            with ThreadPoolExecutor(self.workers) as pool:
                done = list(pool.map(work, groups))
        innovations = dict(zip(order, itertools.chain.from_iterable(done)))
        return [innovations[k] for k in range(len(tasks))]

    @property
    def _kernel(self) -> Kernel:
        return self.filter.estimator.kernel

    def _feed(self, log: int, z: Floats) -> Feed:
        """Return what the kernel is fed at a log's coordinates."""
        p = self.parameters(z)
        mean, covariance, memory = self.filter.estimator.prior(
            first_values(self.data[log].samples), p
        )
        return Feed(np.concatenate([mean, covariance.ravel(), memory]), self._rows[log], p)

    def parameters(self, z: Floats) -> Floats:
        """Return the kernel's parameters, (n_p,), at a log's coordinates, one for each free
        number.
        """
        p = np.array(self.filter.estimator.parameters)
        for part, positions, coordinate in zip(self.free, self.positions, z):
            p[positions] = part.values(float(coordinate))
        return p

    @cached_property
    def _rows(self) -> tuple[Floats, ...]:
        """Return the kernel's rows of each log; where a reference is not used it is compared
        only.
        """
        if self.aided and self.homing is None:
            return tuple(data.rows for data in self.data)
        masked = []
        for data in self.data:
            rows = data.rows.copy()
            times = data.log.time
            late = data.last[times - times[0] >= (0.0 if self.homing is None else self.homing)]
            rows[late, -len(self.filter.references) :] *= COMPARED_ONLY
            masked.append(rows)
        return tuple(masked)

    def _times(self, log: int) -> Floats:
        """Return the stamps of what is compared in a log [s], (k,)."""
        return self.data[log].log.time

    def _compared(self, log: int, ys: Floats) -> Innovations:
        data = self.data[log]
        values, variances = self.filter.estimator.innovations_of(ys[data.last], data.samples)
        if self.homing is not None:
            values = values.copy()
            values[:, ~self._is_reference] = np.nan
            values[data.log.time - data.log.time[0] < self.homing] = np.nan
        return Innovations(values, variances)

    @cached_property
    def _tolerance(self) -> Floats:
        """Return from which ν²/(c S) on an innovation is wild, (m,); the reference is never
        wild.
        """
        return np.where(self._is_reference, np.inf, Robustness().wild_force)

    def _weighing(self, log: int, scale: Floats) -> Weighing:
        """Return how the values of a log's channels count."""
        none = np.zeros(len(self.measured))
        share, counts = (
            (none + 1.0, none)
            if self.weight is None
            else (self.weight.share, self.weight.counts[log])
        )
        return Weighing(self._tolerance, share, self._times(log), counts, scale)

    def scales(self, runs: Sequence[Innovations]) -> Floats:
        """Return by what the variance of each channel's innovations is larger than the filter
        expects, at least 1, (m,).
        """
        return scales_of(runs, self._tolerance)

    def at(self, z: Floats) -> list[Innovations]:
        """Return the innovations of every log."""
        return self.run([(j, z[self.columns(j)]) for j in range(len(self.data))])

    def costs(self, points: Sequence[Floats]) -> Floats:
        """Return −ln p of all logs and the prior at some points, infinite where the filter left all
        bounds.
        """
        logs = range(len(self.data))
        runs = self.run([(j, z[self.columns(j)]) for j in logs for z in points])
        costs = []
        for k, z in enumerate(points):
            log_runs = [runs[j * len(points) + k] for j in logs]
            costs.append(
                self._cost(log_runs) + self._prior(z)
                if all(run.bounded for run in log_runs)
                else np.inf
            )
        return np.array(costs)

    def _cost(self, runs: Sequence[Innovations]) -> float:
        scale = self.scales(runs)
        return sum(cost_of(run, self._weighing(j, scale)) for j, run in enumerate(runs))

    def _prior(self, z: Floats) -> float:
        return 0.5 * float(np.sum((z / self.prior_stds) ** 2))

    def of_logs(self, z: Floats, widths: Floats) -> list[Derivatives]:
        """Return what each log tells at a point z, by one-sided differences of ν and ln S, without
        the prior.

        Slopes are taken over `widths`, (size,), away from a bound, 0 for a coordinate that is not
        varied.
        """
        low, high = self.bounds.T
        ends = np.where(z + widths <= high, z + widths, np.maximum(z - widths, low))
        tasks = list[tuple[int, Floats]]()
        for j in range(len(self.data)):
            positions = self.columns(j)
            tasks.append((j, z[positions]))
            varied = np.eye(len(positions), dtype=bool)[widths[positions] != 0.0]
            tasks += [
                (j, np.where(is_varied, ends[positions], z[positions])) for is_varied in varied
            ]
        runs = iter(self.run(tasks))
        bases = list[Innovations]()
        sides = list[list[Innovations]]()
        for j in range(len(self.data)):
            bases.append(next(runs))
            sides.append([next(runs) if width else bases[j] for width in widths[self.columns(j)]])
        scale = self.scales(bases)
        derivatives = []
        for j, (base, side) in enumerate(zip(bases, sides)):
            pairs = [(end, base) for end in side]
            steps = (ends - z)[self.columns(j)]
            derivatives.append(derivatives_of(base, pairs, steps, self._weighing(j, scale)))
        return derivatives

    def derivatives(self, z: Floats, widths: Floats) -> Derivatives:
        """Return −ln p of logs and prior, its gradient, and the logs' information at z; `widths`
        are those of `of_logs`.
        """
        return self.summed(self.of_logs(z, widths), z)

    def bends(self, z: Floats, of_logs: Sequence[Derivatives], steps: Sequence[Floats]) -> Floats:
        """Return Jᵀ r'' of all logs along some `steps` from z, (k, size): see `Slopes.bend`."""
        logs = range(len(self.data))
        runs = iter(
            self.run([(j, (z + PROBED * step)[self.columns(j)]) for j in logs for step in steps])
        )
        bends = np.zeros((len(steps), self.size))
        for j, of_log in enumerate(of_logs):
            for k, step in enumerate(steps):
                positions = self.columns(j)
                run = next(runs)
                if of_log.slopes is not None:
                    bends[k, positions] += of_log.slopes.bend(run, step[positions], PROBED)
        return bends

    def summed(self, of_logs: Sequence[Derivatives], z: Floats) -> Derivatives:
        """Return the derivatives of all logs and the prior, from those of each log at z."""
        n = self.size
        gradient = np.zeros(n)
        information = np.zeros((n, n))
        meat = np.zeros((n, n))
        for j, part in enumerate(of_logs):
            square = np.ix_(self.columns(j), self.columns(j))
            gradient[self.columns(j)] += part.gradient
            information[square] += part.information
            meat[square] += part.meat
        cost = sum(part.cost for part in of_logs) + self._prior(z)
        spans = sum(part.spans for part in of_logs)
        return Derivatives(
            cost, gradient + z / self.prior_stds**2, information, meat, spans, tuple(of_logs)
        )

    def states(self, log: int, z: Floats) -> tuple[Floats, Floats]:
        """Return mean (n,) and covariance (n, n) of the filter's states at the end of a log, at all
        coordinates z.
        """
        estimator = self.filter.estimator
        n = len(self.filter.estimator.state_names)
        end = advance(estimator.kernel, self._feed(log, z[self.columns(log)])).kernel_states[-1]
        return mean_of(end, n), covariance_of(end, n)
