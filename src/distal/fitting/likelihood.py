"""The likelihood of innovations of many logs, as a function of a rig's parameters, and its derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Lock
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from distal.estimators import AdaptiveFilter, Robustness
from distal.fitting.free import Free, prior_changes
from distal.fitting.resampling import refined, steps_per_sample
from distal.logs import Log, true_angles
from distal.rig import Rig, Sensor
from distal.run import first_values, samples_of
from distal.sensors import variance

Floats = NDArray[np.float64]
Result = TypeVar("Result")

STEP = 1e-3
"""Step of the central differences, as a share of the value, or of the scale of what may be zero.

Friction has kinks: a step that is too small sees one side of them only. See docs/identification.md for the table.
"""


FINE = 0.2
"""Largest product of sub-step and a joint's own frequency in a fit: its errors must not look like parameters."""


LASTING = 0.5
"""What the unaided angle errs by lasts about so long [s]: samples within it tell as much as one."""


@dataclass(frozen=True)
class Data:
    """A log, ready for the filter.

    Args:
        log: as read.
        samples: values of the filter's channels, (k, n_channels); references are the last.
        first: the first value of each channel.
        rows: what the kernel takes.
        last: index of each sample's own row.
    """

    log: Log
    samples: Floats
    first: Floats
    rows: Floats
    last: NDArray[np.intp]


class Likelihood:
    """Innovations ν and their variances S of logs at parameters z: −ln p = ½ Σ (ν²/S + ln 2πS) + prior.

    The prediction-error method (Ljung, System Identification, 1999, ch. 7; Åström, Automatica 16, 1980): hidden states,
    missing samples and sensor noise are treated as in use, because it is the filter that is used. An outlier
    counts as in the filter: beyond ν² = 9 S its variance grows with it.

    Args:
        rig: the description at which the fit starts.
        references: the sensors of joints' angles.
        free: what is varied.
        logs: with the reference as truth, NaN or absent where it is not known.
        homing: for how long the reference is used [s], None for never. Where it is not used it is compared with what the
            filter makes of the other sensors: it is the truth to predict. With homing only that counts: the fit is to
            the use.
        compiled: compile the kernel where possible.
        workers: threads.
        aided: without homing, use the reference wherever it is as one more sensor, which tells more where the model is
            right, and hides what the angle errs by where it is not.
    """

    def __init__(
        self,
        rig: Rig,
        references: Sequence[Sensor],
        free: Sequence[Free],
        logs: Sequence[Log],
        homing: float | None = None,
        compiled: bool = True,
        workers: int = 2,
        aided: bool = False,
    ) -> None:
        self.rig, self.references, self.free = rig, tuple(references), tuple(free)
        given = [path for part in self.free for path in part.paths]
        self._filter = AdaptiveFilter(
            rig,
            compiled,
            Robustness.fitting(),
            name="fit",
            references=self.references,
            given=given,
            resolution=FINE,
        )
        names = self._filter.parameter_names
        self._index = [[names.index(path) for path in part.paths] for part in self.free]
        self._base = np.array(self._filter.numbers)
        self.measured = self._filter.measured
        self.state_names = self._filter.state_names
        self._homing, self._aided = homing, aided and homing is None
        self.data = tuple(self._prepared(log) for log in logs)
        self._workers = workers
        self._building = Lock()
        self._per_log = [k for k, part in enumerate(self.free) if part.per_log]
        self._shared = [k for k, part in enumerate(self.free) if not part.per_log]
        self.evaluations = 0

    def _prepared(self, log: Log) -> Data:
        runner = self._filter
        proximal = samples_of(log, runner.channels[: -len(self.references)], "fit")
        joints = [joint.name for joint in self.rig.joints]
        known = true_angles(log, joints)
        truth = np.full((len(log), len(joints)), np.nan) if known is None else known
        samples = np.column_stack([proximal, truth[:, [joints.index(sensor.of) for sensor in self.references]]])
        positions = [sensor for sensor in self.rig.sensors if sensor.name in runner.channels[: runner.bridged]]
        noise = np.sqrt([variance(sensor) for sensor in positions])
        steps = steps_per_sample(samples[:, : runner.bridged], noise)
        times, fine, own = refined(log.time, samples, runner.bridged, steps)
        rows, last = runner.rows(np.diff(times, prepend=times[0]), fine)
        last = last[own]
        if not self._aided:
            late = last[log.time - log.time[0] >= (0.0 if self._homing is None else self._homing)]
            rows[late, -len(self.references) :] *= -1.0  # a mask of −1: compared, but not used
        return Data(log, samples, first_values(samples), rows, last)

    @property
    def tolerance(self) -> Floats:
        """ν²/S of each channel beyond which an innovation is an outlier, (m,): as in the filter, never for a reference."""
        references = {sensor.name for sensor in self.references}
        return np.array([np.inf if name in references else Robustness().wild_force for name in self.measured])

    def weights(self, log: int) -> Floats:
        """Return how much a value of each channel counts, (m,): 1, but for a truth that is only compared with.

        Args:
            log: its index.
        """
        references = {sensor.name for sensor in self.references}
        share = 1.0 if self._homing is not None or self._aided else min(1.0, 1.0 / (LASTING * self.data[log].log.rate))
        return np.array([share if name in references else 1.0 for name in self.measured])

    @property
    def size(self) -> int:
        """Number of coordinates: shared ones, then those of each log."""
        return len(self._shared) + len(self._per_log) * len(self.data)

    def columns(self, log: int) -> list[int]:
        """Return for each free parameter the coordinate that holds it in a log.

        Args:
            log: its index.
        """
        places = [0] * len(self.free)
        for i, k in enumerate(self._shared):
            places[k] = i
        start = len(self._shared) + log * len(self._per_log)
        for i, k in enumerate(self._per_log):
            places[k] = start + i
        return places

    def parts(self) -> list[tuple[Free, int | None]]:
        """Return the free parameter, and the log where it is one log's own, of each coordinate."""
        shared: list[tuple[Free, int | None]] = [(self.free[k], None) for k in self._shared]
        return shared + [(self.free[k], j) for j in range(len(self.data)) for k in self._per_log]

    def run(self, log: int, z: Floats) -> tuple[Floats, Floats]:
        """Return innovations and variances of one log, (k, m) each, NaN where nothing was compared.

        Args:
            log: its index.
            z: that log's coordinates, one for each free parameter.
        """
        values, variances, _ = self._scan(log, z)
        return values, variances

    def _scan(self, log: int, z: Floats) -> tuple[Floats, Floats, Floats]:
        data, p = self.data[log], self._base.copy()
        changed = {}
        for part, places, coordinate in zip(self.free, self._index, z):
            for place, path, value in zip(places, part.paths, part.values(float(coordinate))):
                p[place] = value
                if prior_changes(path):
                    changed[path] = value
        carry = self._first_carry(data, changed)
        carries, ys = self._filter.kernel.scan(carry, data.rows, p)
        values, variances = self._filter.innovations_of(ys[data.last], data.samples)
        if self._homing is not None:
            values = values.copy()
            values[:, : -len(self.references)] = np.nan
            values[data.log.time - data.log.time[0] < self._homing] = np.nan
        return values, variances, carries[data.last]

    def _first_carry(self, data: Data, changed: dict[str, float]) -> Floats:
        # A filter of another prior is built, used and dropped within the lock: CasADi's symbols are counted without one,
        # and two threads that make or drop them at once end the process.
        with self._building:
            runner = self._filter if not changed else self._filter.with_prior(changed)
            carry = runner.initial(data.log.time[0], data.first).carry
            del runner
        return carry

    def estimates(self, log: int, z: Floats) -> tuple[Floats, Floats]:
        """Return means (k, n) and covariances (k, n, n) of the filter's states along a log.

        Args:
            log: its index.
            z: that log's coordinates.
        """
        _, _, carries = self._scan(log, z)
        n = len(self.state_names)
        return carries[:, :n], carries[:, n : n + n * n].reshape(-1, n, n)

    def prior_state(self) -> tuple[Floats, Floats]:
        """Return mean and std of the filter's states before the first sample, (n,) each."""
        return self._filter.states.means, self._filter.states.stds

    def each(self, z: Floats, job: Callable[[int, Floats], Result]) -> list[Result]:
        """Return job(log, its coordinates) of all logs, in threads: kernels run without the interpreter's lock.

        Args:
            z: all coordinates, (size,).
            job: what to do.
        """
        tasks = [(j, z[self.columns(j)]) for j in range(len(self.data))]
        if self._workers < 2 or len(tasks) < 2:
            return [job(*task) for task in tasks]
        with ThreadPoolExecutor(self._workers) as pool:
            return list(pool.map(lambda task: job(*task), tasks))

    def cost(self, z: Floats) -> float:
        """Return −ln p of all logs and of the prior, less constants; infinite where the filter left all bounds.

        Args:
            z: all coordinates, (size,).
        """
        self.evaluations += 1
        costs = self.each(z, lambda j, own: cost_of(*self.run(j, own), self.tolerance, self.weights(j)))
        return float(np.sum(costs)) + 0.5 * float(np.sum(self.prior_residuals(z) ** 2))

    def prior_residuals(self, z: Floats) -> Floats:
        """Return z/σ of each coordinate, 0 where it has no prior, (size,).

        Args:
            z: all coordinates, (size,).
        """
        return np.array([part.prior_residual(float(value)) for (part, _), value in zip(self.parts(), z)])

    def derivatives(self, z: Floats) -> Derivatives:
        """Return cost, gradient and Fisher information at z, by central differences of ν and ln S.

        Args:
            z: all coordinates, (size,).
        """
        self.evaluations += 1 + 2 * len(self.free)
        of_logs = self.each(z, self._log_derivatives)
        n = self.size
        cost, gradient, information, meat, spans = 0.0, np.zeros(n), np.zeros((n, n)), np.zeros((n, n)), 0
        for j, part in enumerate(of_logs):
            places = self.columns(j)
            cost += part.cost
            gradient[places] += part.gradient
            information[np.ix_(places, places)] += part.information
            meat[np.ix_(places, places)] += part.meat
            spans += part.spans
        residuals = self.prior_residuals(z)
        weights = np.array([1.0 / part.spread if part.has_prior else 0.0 for part, _ in self.parts()])
        cost += 0.5 * float(np.sum(residuals**2))
        return Derivatives(cost, gradient + weights * residuals, information, np.diag(weights**2), meat, spans)

    def _log_derivatives(self, log: int, z: Floats) -> LogDerivatives:
        values, variances = self.run(log, z)
        there = np.isfinite(values)
        nu, spread = values[there], variances[there]
        slopes, log_slopes = np.zeros((len(z), len(nu))), np.zeros((len(z), len(nu)))
        for k, part in enumerate(self.free):
            up, down, width = part.neighbours(float(z[k]), STEP)
            ends = []
            for coordinate in (up, down):
                moved = z.copy()
                moved[k] = coordinate
                ends.append([each[there] for each in self.run(log, moved)])
            slopes[k] = (ends[0][0] - ends[1][0]) / width
            log_slopes[k] = np.log(ends[0][1] / ends[1][1]) / width
        # what is compared may change at the ends (a slider at a stop): such a sample has no slope
        slopes[~np.isfinite(slopes)] = 0.0
        log_slopes[~np.isfinite(log_slopes)] = 0.0
        ratio = nu * nu / spread
        inflation = np.maximum(1.0, ratio / np.broadcast_to(self.tolerance, values.shape)[there])
        # with S' = S · inflation the terms beyond 9 S are ln ν²: no slope in S, a bounded one in ν
        inlier = inflation <= 1.0
        # score of each sample, inlier: ν ν'/S + ½ (ln S)' (1 − ν²/S); outlier: ν'/ν
        weight = np.broadcast_to(self.weights(log), values.shape)[there]
        influence = np.where(inlier, nu / spread, 1.0 / np.where(nu == 0.0, 1.0, nu))
        scores = weight * (slopes * influence + 0.5 * log_slopes * np.where(inlier, 1.0 - ratio, 0.0))
        root = slopes * np.sqrt(weight / (spread * inflation))
        spreads = np.sqrt(0.5 * weight) * log_slopes * inlier
        information = root @ root.T + spreads @ spreads.T
        times = np.broadcast_to(self.data[log].log.time[:, None], values.shape)[there]
        return LogDerivatives(
            cost_of(values, variances, self.tolerance, self.weights(log)),
            scores.sum(axis=1),
            information,
            *long_run_covariance(scores, times),
        )


@dataclass(frozen=True)
class LogDerivatives:
    """What one log tells; see `Derivatives`.

    Args:
        cost: −ln p.
        gradient: of it, (n,).
        information: Fisher information, (n, n).
        meat: long-run covariance of the scores, (n, n).
        spans: how many spans of time it is the sum of.
    """

    cost: float
    gradient: Floats
    information: Floats
    meat: Floats
    spans: int


@dataclass(frozen=True)
class Derivatives:
    """Cost and its derivatives at a point.

    Args:
        cost: −ln p.
        gradient: of it, (n,).
        information: Fisher information of the logs, (n, n).
        prior: information of the prior, (n, n).
        meat: long-run covariance of the scores, (n, n): equal to the information where the model is right.
        spans: how many spans of time it is the sum of.
    """

    cost: float
    gradient: Floats
    information: Floats
    prior: Floats
    meat: Floats
    spans: int


def cost_of(values: Floats, variances: Floats, tolerance: Floats, weights: Floats | None = None) -> float:
    """Return ½ Σ w (ν²/S + ln S) over what was compared, with S grown for outliers.

    Args:
        values: innovations ν, NaN where nothing was compared.
        variances: S.
        tolerance: ν²/S of each channel beyond which an innovation is an outlier, (m,).
        weights: w of each channel, (m,); default 1.
    """
    there = np.isfinite(values)
    nu, spread = values[there], variances[there]
    if not np.all(np.isfinite(spread)) or np.any(spread <= 0.0):
        return float("inf")
    ratio = nu * nu / spread
    inflation = np.maximum(1.0, ratio / np.broadcast_to(tolerance, values.shape)[there])
    weight = np.ones(len(nu)) if weights is None else np.broadcast_to(weights, values.shape)[there]
    return 0.5 * float(np.sum(weight * (ratio / inflation + np.log(spread * inflation))))


CORRELATED = 2.0
"""Scores that are this far apart in time are taken as independent [s]: sensors' curves last for a stroke."""


def long_run_covariance(scores: Floats, times: Floats) -> tuple[Floats, int]:
    """Return Σ s sᵀ of scores summed over spans of `CORRELATED` s, and the number of spans.

    It is their covariance with what is correlated in time.

    Where the model is wrong, innovations are correlated and Fisher's information is too large; what the scores really
    do is in this matrix (White, Econometrica 50, 1982; Newey and West, Econometrica 55, 1987).

    Args:
        scores: of each sample, (n, k).
        times: of the samples [s], (k,).
    """
    spans = np.floor((times - times.min()) / CORRELATED).astype(int)
    sums = np.zeros((scores.shape[0], int(spans.max()) + 1))
    for k in range(scores.shape[0]):
        sums[k] = np.bincount(spans, scores[k], minlength=sums.shape[1])
    return sums @ sums.T, sums.shape[1]
