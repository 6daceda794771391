"""What a fit minimises: −ln p of logs as a function of a rig's parameters, evaluated in vector
lanes.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
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
    SearchSettings,
    Weighing,
    cost_of,
    derivatives_of,
    scales_of,
    shares_of,
)
from distal.kernels import Feed, Kernel, advance_all
from distal.kernels.layout import COMPARED_ONLY


@dataclass(frozen=True)
class Weight:
    """The weights of the channels' values, as estimated at a point.

    Args:
        share: weight of one value of each channel (`shares_of`), (m,).
        counts: for each log the number of values of each channel that are compared, (m,).
    """

    share: Floats
    counts: tuple[Floats, ...]


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
        homing: for how long the reference is read [s], None for never; with it only the reference
            after that time is compared.
        aided: whether, without homing, the reference is read wherever it is known, as one more
            sensor. This identifies more where the model is right; where the model is wrong it hides
            the errors of the angle.
        open_loop: whether no force is read, and only the reference compared.
        workers: number of threads; the result does not depend on it.
        weight: weights of the channels' values; None before they are assessed, when every value
            counts in full.
        noises: free noises that are not varied.
        settings: how a search for the least −ln p goes.
    """

    asks_equations: ClassVar[bool] = False
    """Whether the residuals are those of the rig's equations, not of its filter."""

    filter: FitFilter
    free: tuple[Free, ...]
    data: tuple[Data, ...]
    homing: float | None = None
    aided: bool = False
    open_loop: bool = False
    workers: int = 2
    weight: Weight | None = None
    noises: tuple[Free, ...] = ()
    settings: SearchSettings = field(default_factory=SearchSettings)

    def assessed(self, z: Floats) -> Problem:
        """Return the problem with the weights of the channels' values as found at a point z,
        (size,), or unchanged where the filter leaves all bounds there.
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
    def measured(self) -> tuple[str, ...]:
        """Names of the channels that are compared, (m,)."""
        return self.filter.estimator.measured

    @cached_property
    def _is_reference(self) -> Bools:
        names = {sensor.name for sensor in self.filter.references}
        return np.array([name in names for name in self.measured])

    @cached_property
    def positions(self) -> list[list[int]]:
        """For each free parameter, the indices of its paths among the kernel's parameters."""
        names = self.filter.estimator.parameter_names
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
        positions = {(id(part), of_log): k for k, (part, of_log) in enumerate(self.parts)}
        return [positions[id(part), log if part.per_log else None] for part in self.free]

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
        """Return the kernel's input for a log at its coordinates."""
        p = self.parameters(z)
        mean, covariance, memory = self.filter.estimator.prior(
            first_values(self.data[log].samples), p
        )
        return Feed(np.concatenate([mean, covariance.ravel(), memory]), self._rows[log], p)

    def parameters(self, z: Floats) -> Floats:
        """Return the kernel's parameters, (n_p,), at a log's coordinates, one for each free
        parameter.
        """
        p = np.array(self.filter.estimator.parameters)
        for part, positions, coordinate in zip(self.free, self.positions, z):
            p[positions] = part.values(float(coordinate))
        return p

    @cached_property
    def _rows(self) -> tuple[Floats, ...]:
        """The kernel's rows of each log; where the reference is not read, its mask says that it is
        compared only.
        """
        if self.aided and self.homing is None:
            return tuple(data.rows for data in self.data)
        masked = []
        for data in self.data:
            rows = data.rows.copy()
            times = data.log.time
            late = data.last[times - times[0] >= (0.0 if self.homing is None else self.homing)]
            rows[late, -len(self.filter.references) :] *= COMPARED_ONLY
            if self.open_loop:
                channels = self.filter.estimator.channels
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
        values, variances = self.filter.estimator.innovations_of(ys[data.last], data.samples)
        if self.homing is not None or self.open_loop:
            values = values.copy()
            values[:, ~self._is_reference] = np.nan
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
        share, counts = (
            (none + 1.0, none)
            if self.weight is None
            else (self.weight.share, self.weight.counts[log])
        )
        return Weighing(self._tolerance, share, self._times(log), counts, scale)

    def scales(self, runs: Sequence[Innovations]) -> Floats:
        """Return c of each channel, (m,): the factor, at least 1, by which the innovations'
        variance is larger than the filter expects.
        """
        return scales_of(runs, self._tolerance)

    def at(self, z: Floats) -> list[Innovations]:
        """Return the innovations of every log at coordinates z, (size,)."""
        return self.run([(j, z[self.columns(j)]) for j in range(len(self.data))])

    def costs(self, points: Sequence[Floats]) -> Floats:
        """Return −ln p of all logs and the prior at each of some points; it is infinite where the
        filter left all bounds.
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
        return 0.5 * float(z @ self.prior_information @ z)

    def of_logs(self, z: Floats, widths: Floats) -> list[Derivatives]:
        """Return the derivatives of −ln p of each log at a point z, without the prior, by one-sided
        differences of ν and ln S.

        The differences go over `widths`, (size,), to the side where they stay within the bounds; a
        width of 0 means that a coordinate is not varied.
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
            steps = (ends - z)[self.columns(j)]
            derivatives.append(derivatives_of(base, side, steps, self._weighing(j, scale)))
        return derivatives

    def derivatives(self, z: Floats, widths: Floats) -> Derivatives:
        """Return −ln p of logs and prior at z, its gradient, and the logs' information; `widths`
        are as in `of_logs`.
        """
        return self.summed(dict(enumerate(self.of_logs(z, widths))), z)

    def summed(self, of_logs: Mapping[int, Derivatives], z: Floats) -> Derivatives:
        """Return the derivatives of some logs and the prior at z, from the derivatives of each of
        these logs there, by its index.
        """
        n = self.size
        gradient = np.zeros(n)
        information = np.zeros((n, n))
        meat = np.zeros((n, n))
        for j, part in of_logs.items():
            square = np.ix_(self.columns(j), self.columns(j))
            gradient[self.columns(j)] += part.gradient
            information[square] += part.information
            meat[square] += part.meat
        parts = tuple(of_logs.values())
        cost = sum(part.cost for part in parts) + self._prior(z)
        spans = sum(part.spans for part in parts)
        gradient += self.prior_information @ z
        return Derivatives(cost, gradient, information, meat, spans, parts)
