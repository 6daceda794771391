"""What a fit minimises: −ln p of logs as a function of a rig's numbers, evaluated in vector lanes."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from distal.estimators import AdaptiveFilter, Robustness, first_values
from distal.fitting.free import Free
from distal.fitting.likelihood import Derivatives, Innovations, Weighing, cost_of, derivatives_of
from distal.fitting.resampling import refined, steps_per_sample
from distal.fitting.stops import in_stops
from distal.kernels import CompileError, LaneKernel, covariance_of, mean_of
from distal.kernels.mask import COMPARED_ONLY
from distal.logs import Log, true_angles
from distal.rig import Rig, Sensor
from distal.run import samples_of
from distal.sensors import variance

Floats = NDArray[np.float64]

FINE = 0.2
"""Largest product of sub-step and a joint's own frequency in a fit: its errors must not look like parameters."""

ERROR_LASTS = 0.5
"""What the unaided angle errs by lasts about so long [s]: samples within it tell as much as one."""


@dataclass(frozen=True)
class Data:
    """A log, ready for the filter.

    Args:
        log: as read.
        samples: values of the filter's channels, (k, n_channels); references are the last.
        rows: what the kernel takes.
        last: index of each sample's own row.
    """

    log: Log
    samples: Floats
    rows: Floats
    last: NDArray[np.intp]

    def beginning(self, count: int) -> Data:
        """Return the first samples of the log.

        Args:
            count: how many.
        """
        count = min(count, len(self.last))
        log = Log(self.log.time[:count], {}, {}, self.log.source)
        return Data(log, self.samples[:count], self.rows[: self.last[count - 1] + 1], self.last[:count])


class FitFilter:
    """The filter of a fit: what is free is an input of its kernel, and several runs go through it side by side.

    Args:
        rig: the description, with its references.
        references: the sensors of joints' angles.
        free: what is varied.
        steps: rows per sample, see `resampling`; more of them need fewer sub-steps each.
        compiled: compile the kernel where possible.
    """

    def __init__(
        self, rig: Rig, references: Sequence[Sensor], free: Sequence[Free], steps: int = 1, compiled: bool = True
    ) -> None:
        self.rig, self.references, self.steps = rig, tuple(references), steps
        given = [path for part in free for path in part.paths]
        self.runner = AdaptiveFilter(
            rig,
            False,
            Robustness.fitting(),
            name="fit",
            references=self.references,
            inputs=given,
            resolution=FINE * steps,
        )
        self.lanes: LaneKernel | None = None
        if compiled:
            try:
                self.lanes = LaneKernel(self.runner.kernel.function)
            except CompileError:
                self.lanes = None  # the interpreter gives the same numbers
        names = self.runner.parameter_names
        self.places = [[names.index(path) for path in part.paths] for part in free]

    def data_of(self, log: Log) -> Data:
        """Return a log, ready for the filter; displacements between samples follow a cubic where chords would err.

        Args:
            log: with the reference as truth, NaN or absent where it is not known.
        """
        runner, joints = self.runner, [joint.name for joint in self.rig.joints]
        proximal = samples_of(log, runner.channels[: -len(self.references)], "fit")
        known = true_angles(log, joints)
        truth = np.full((len(log), len(joints)), np.nan) if known is None else known
        read = [joints.index(sensor.of) for sensor in self.references]
        # how a joint rests in a stop is the stop's own affair: what is read there teaches nothing of the rest
        stopped = in_stops(log.time, truth, self.rig)
        samples = np.column_stack([proximal, np.where(stopped, np.nan, truth)[:, read]])
        samples[stopped.all(axis=1), runner.bridged :] = np.nan
        times, fine, own = refined(log.time, samples, runner.bridged, self.steps)
        rows, last = runner.rows(np.diff(times, prepend=times[0]), fine)
        return Data(log, samples, rows, last[own])


def steps_of(rig: Rig, logs: Sequence[Log]) -> int:
    """Return how many rows per sample all of some logs need, so that displacements between samples are right.

    Joints that settle within an interval need one: where a drive went between two slow samples no curve tells.

    Args:
        rig: the description.
        logs: of a fit.
    """
    if AdaptiveFilter(rig, False).states.context.joints_settle:
        return 1
    sensors = list(rig.sensors_of("position"))
    noise = np.sqrt([variance(sensor) for sensor in sensors])
    places = [np.column_stack([log.channels[sensor.name] for sensor in sensors]) for log in logs if sensors]
    return max((steps_per_sample(each, noise) for each in places), default=1)


@dataclass(frozen=True)
class Problem:
    """−ln p = ½ Σ (ν²/S + ln 2πS) + prior of the innovations ν of logs, with variances S, at coordinates z.

    The prediction-error method (Ljung, System Identification, 1999, ch. 7; Åström, Automatica 16, 1980): hidden states,
    missing samples and sensor noise are treated as in use, because it is the filter that is used.

    Args:
        filter: with what is free as inputs.
        free: what is varied; coordinates are those that logs share, then each log's own.
        data: of the logs.
        homing: for how long the reference is used [s], None for never; with it only what comes after counts.
        aided: without homing, use the reference wherever it is as one more sensor, which tells more where the model is
            right, and hides what the angle errs by where it is not.
        workers: threads; the numbers do not depend on them.
    """

    filter: FitFilter
    free: tuple[Free, ...]
    data: tuple[Data, ...]
    homing: float | None = None
    aided: bool = False
    workers: int = 2

    def beginning(self, share: float, least: int) -> Problem:
        """Return the same for the beginnings of the logs.

        Args:
            share: of each log.
            least: samples of a log, at least.
        """
        return replace(self, data=tuple(one.beginning(max(least, round(share * len(one.last)))) for one in self.data))

    def of(self, log: int) -> Problem:
        """Return the problem of one log alone.

        Args:
            log: its index.
        """
        return replace(self, data=(self.data[log],))

    @property
    def measured(self) -> tuple[str, ...]:
        """Names of the channels that are compared, (m,)."""
        return self.filter.runner.measured

    @cached_property
    def _is_reference(self) -> NDArray[np.bool_]:
        names = {sensor.name for sensor in self.filter.references}
        return np.array([name in names for name in self.measured])

    @cached_property
    def parts(self) -> tuple[tuple[Free, int | None], ...]:
        """The free number behind each coordinate, and the log where it is one log's own, (size,)."""
        shared: list[tuple[Free, int | None]] = [(part, None) for part in self.free if not part.per_log]
        own = [part for part in self.free if part.per_log]
        return (*shared, *((part, j) for j in range(len(self.data)) for part in own))

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
        """Return for each free number the coordinate that holds it in a log.

        Args:
            log: its index.
        """
        places = {(id(part), own): k for k, (part, own) in enumerate(self.parts)}
        return [places[id(part), log if part.per_log else None] for part in self.free]

    def run(self, tasks: Sequence[tuple[int, Floats]]) -> list[Innovations]:
        """Return the innovations of some runs, side by side in vector lanes, on all workers.

        Args:
            tasks: of each run the log's index and that log's coordinates, one for each free number.
        """
        lanes = self.filter.lanes
        size = lanes.lanes if lanes is not None else 1
        # runs of one length go together, since those that end early leave their lanes idle
        order = sorted(range(len(tasks)), key=lambda k: (len(self.data[tasks[k][0]].rows), tasks[k][0]))
        groups = [order[i : i + size] for i in range(0, len(order), size)]

        def work(group: list[int]) -> list[Innovations]:
            return self._scan([tasks[k] for k in group])

        if self.workers < 2 or len(groups) < 2:
            done = [work(group) for group in groups]
        else:
            with ThreadPoolExecutor(self.workers) as pool:
                done = list(pool.map(work, groups))
        found = {k: one for group, ones in zip(groups, done) for k, one in zip(group, ones)}
        return [found[k] for k in range(len(tasks))]

    def _scan(self, tasks: Sequence[tuple[int, Floats]]) -> list[Innovations]:
        runner, lanes = self.filter.runner, self.filter.lanes
        starts = [self._begin(self.data[log], z) for log, z in tasks]
        rows = [self._rows[log] for log, _ in tasks]
        if lanes is None:
            outputs = [runner.kernel.scan(carry, own, p)[1] for (carry, p), own in zip(starts, rows)]
        else:
            outputs = [y for _, y in lanes.scan([carry for carry, _ in starts], rows, [p for _, p in starts], ())]
        return [self._compared(self.data[log], y) for (log, _), y in zip(tasks, outputs)]

    def _begin(self, data: Data, z: Floats) -> tuple[Floats, Floats]:
        """Return the carry before the first sample and the kernel's parameters at a log's coordinates."""
        p = self.numbers(z)
        mean, covariance, memory = self.filter.runner.prior(first_values(data.samples), p)
        return np.concatenate([mean, covariance.ravel(), memory]), p

    def numbers(self, z: Floats) -> Floats:
        """Return the kernel's parameters at a log's coordinates, (n_p,).

        Args:
            z: one for each free number.
        """
        p = np.array(self.filter.runner.numbers)
        for part, places, coordinate in zip(self.free, self.filter.places, z):
            p[places] = part.values(float(coordinate))
        return p

    @cached_property
    def _rows(self) -> tuple[Floats, ...]:
        """Return the kernel's rows of each log; where a reference is not used it is compared only."""
        if self.aided and self.homing is None:
            return tuple(data.rows for data in self.data)
        masked = []
        for data in self.data:
            rows, times = data.rows.copy(), data.log.time
            late = data.last[times - times[0] >= (0.0 if self.homing is None else self.homing)]
            rows[late, -len(self.filter.references) :] *= COMPARED_ONLY
            masked.append(rows)
        return tuple(masked)

    def _compared(self, data: Data, ys: Floats) -> Innovations:
        values, variances = self.filter.runner.innovations_of(ys[data.last], data.samples)
        if self.homing is not None:
            values = values.copy()
            values[:, ~self._is_reference] = np.nan
            values[data.log.time - data.log.time[0] < self.homing] = np.nan
        return Innovations(values, variances)

    def _weighing(self, log: int) -> Weighing:
        """Return how channels count: a reference is never wild, and one that is only compared counts once in a while."""
        times = self.data[log].log.time
        rate = 1.0 / float(np.median(np.diff(times)))
        share = 1.0 if self.homing is not None or self.aided else min(1.0, 1.0 / (ERROR_LASTS * rate))
        return Weighing(
            np.where(self._is_reference, np.inf, Robustness().wild_force),
            np.where(self._is_reference, share, 1.0),
            times,
            self._counts[log],
        )

    @cached_property
    def _counts(self) -> tuple[Floats, ...]:
        """Return how many values of each channel are compared where the search begins, for each log."""
        return tuple(np.isfinite(run.values).sum(axis=0).astype(np.float64) for run in self.at(np.zeros(self.size)))

    def at(self, z: Floats) -> list[Innovations]:
        """Return the innovations of every log.

        Args:
            z: all coordinates, (size,).
        """
        return self.run([(j, z[self.columns(j)]) for j in range(len(self.data))])

    def costs(self, points: Sequence[Floats]) -> Floats:
        """Return −ln p of all logs and the prior at some points, infinite where the filter left all bounds.

        Args:
            points: coordinates, (size,) each.
        """
        logs = range(len(self.data))
        runs = self.run([(j, z[self.columns(j)]) for j in logs for z in points])
        weighings = [self._weighing(j) for j in logs]
        of_logs = [sum(cost_of(runs[j * len(points) + k], weighings[j]) for j in logs) for k in range(len(points))]
        return np.array([cost + self._prior(z) for cost, z in zip(of_logs, points)])

    def _prior(self, z: Floats) -> float:
        return 0.5 * float(np.sum((z / self.prior_stds) ** 2))

    def of_logs(self, z: Floats, widths: Floats, central: bool = True) -> list[Derivatives]:
        """Return what each log tells at a point, by differences of ν and ln S, without the prior.

        Args:
            z: all coordinates, (size,).
            widths: over how much slopes are taken on a side, 0 for a coordinate that is not varied, (size,).
            central: take them on both sides; else on one, for half of the time.
        """
        tasks, spans = list[tuple[int, Floats]](), list[Floats]()
        for j in range(len(self.data)):
            places = self.columns(j)
            own, steps = z[places], widths[places]
            tasks.append((j, own))
            distance = np.zeros(len(own))
            for k, part in enumerate(self.free):
                if steps[k] > 0.0:
                    low, high = part.bounds
                    up, down = min(own[k] + steps[k], high), max(own[k] - steps[k], low)
                    if not central:
                        up, down = (up, own[k]) if up > own[k] else (down, own[k])
                    distance[k] = up - down
                    ends = (up, down) if central else (up,)
                    tasks += [(j, np.where(np.arange(len(own)) == k, end, own)) for end in ends]
            spans.append(distance)
        runs = iter(self.run(tasks))
        found = []
        for j, distance in enumerate(spans):
            base = next(runs)
            pairs = [
                (base, base) if width == 0.0 else (next(runs), next(runs) if central else base) for width in distance
            ]
            found.append(derivatives_of(base, pairs, distance, self._weighing(j)))
        return found

    def derivatives(self, z: Floats, widths: Floats, central: bool = True) -> Derivatives:
        """Return −ln p of all logs and the prior, with its gradient, and the logs' information at a point.

        Args:
            z: all coordinates, (size,).
            widths: see `of_logs`.
            central: see `of_logs`.
        """
        return self.summed(self.of_logs(z, widths, central), z)

    def summed(self, of_logs: Sequence[Derivatives], z: Floats) -> Derivatives:
        """Return the derivatives of all logs and the prior, from those of each log.

        Args:
            of_logs: at the point, of each log.
            z: all coordinates, (size,).
        """
        n = self.size
        gradient, information, meat = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
        for j, part in enumerate(of_logs):
            square = np.ix_(self.columns(j), self.columns(j))
            gradient[self.columns(j)] += part.gradient
            information[square] += part.information
            meat[square] += part.meat
        cost, spans = sum(part.cost for part in of_logs) + self._prior(z), sum(part.spans for part in of_logs)
        return Derivatives(cost, gradient + z / self.prior_stds**2, information, meat, spans, tuple(of_logs))

    def states(self, log: int, z: Floats) -> tuple[Floats, Floats]:
        """Return mean (n,) and covariance (n, n) of the filter's states at the end of a log.

        Args:
            log: its index.
            z: all coordinates, (size,).
        """
        data, runner, n = self.data[log], self.filter.runner, len(self.filter.runner.state_names)
        carry, p = self._begin(data, z[self.columns(log)])
        end = runner.kernel.scan(carry, self._rows[log], p)[0][-1]
        return mean_of(end, n), covariance_of(end, n)
