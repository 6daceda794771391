"""What all estimators share. Their base: a log or a part of it in, means, covariances and
innovations out, no hidden state; the sensors that one reads, by their role; its belief at a
time; the kind of each state; the checks of a sample; and gaps between samples, which several
predictions bridge.

A row of a kernel's input is x = (dt, values, mask), see `distal.kernels.layout`. A row that
bridges a gap has no sample of its own: nothing is read in it, and displacements are interpolated
along a straight line to the reading that ends the gap.
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from math import ceil

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from distal.arrays import Bools, Floats
from distal.errors import DistalWarning, EstimationError
from distal.expressions import Vector, symbols
from distal.kernels import (
    Advanced,
    Evaluation,
    Feed,
    Kernel,
    Layout,
    advance,
    advance_all,
    at_samples,
    covariance_of,
    mean_of,
    variances_of,
)
from distal.kernels.layout import MISSING, bridge
from distal.logs import LARGEST_READING, frozen
from distal.rig import (
    Rig,
    Role,
    Sensor,
    effort_unit,
    measurand_of,
    number,
    position_unit,
    tendon_angle_name,
)
from distal.sensor_models import variance


@dataclass(frozen=True)
class Channels:
    """The sensors of a rig by role.

    Args:
        positions: sensors of drives' positions.
        forces: sensors of drives' forces or torques.
        tensions: sensors of tendons' tensions.
        angles: sensors of joints' angles, only while a reference is known (homing, fitting).
        interval: nominal, that of the fastest sensor [s], angles left out.
    """

    positions: tuple[Sensor, ...]
    forces: tuple[Sensor, ...]
    tensions: tuple[Sensor, ...]
    angles: tuple[Sensor, ...]
    interval: float

    @property
    def proximal(self) -> tuple[Sensor, ...]:
        """The sensors at the proximal end, from which maps learn: positions, tensions, forces."""
        return (*self.positions, *self.tensions, *self.forces)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sensors in the order in which estimators read them: positions, tensions,
        forces, angles.
        """
        return tuple(sensor.name for sensor in (*self.proximal, *self.angles))

    @property
    def row(self) -> Layout:
        """Layout of a sample x = (dt, values, mask)."""
        n = len(self.names)
        return Layout(dt=1, values=n, mask=n)

    def of_message(self, position: int) -> list[int]:
        """Return the indices of a position and of what its drive's motor reads with it."""
        drive = self.positions[position].of
        at_motors = [*self.positions, *self.forces]
        return [k for k, s in enumerate(self.proximal) if s in at_motors and s.of == drive]

    @property
    def compared(self) -> tuple[Sensor, ...]:
        """The sensors whose values `adaptive` compares with predictions: forces, tensions and
        angles.
        """
        return (*self.forces, *self.tensions, *self.angles)


def channels_of(rig: Rig, name: str, references: Sequence[Sensor] = ()) -> Channels:
    """Return the sensors of a rig that an estimator reads.

    Args:
        name: of the estimator, for messages.
        references: sensors of joints' angles that are read too, while they are known.

    Raises:
        EstimationError: no drive's position is measured, two sensors measure the same, or a sensor
            has zero noise.
    """
    positions, forces, tensions = (
        tuple(sensor for sensor in rig.sensors if measurand_of(sensor).role is role)
        for role in (Role.POSITION, Role.EFFORT, Role.TENSION)
    )
    if not positions:
        raise EstimationError(
            f"{name}: the rig '{rig.name}' has no sensor that measures the position of a drive; "
            "add one to [[sensors]]"
        )
    interval = 1.0 / max(sensor.rate for sensor in (*positions, *forces, *tensions))
    channels = Channels(positions, forces, tensions, tuple(references), interval)
    for sensors in (channels.positions, channels.forces, channels.tensions, channels.angles):
        seen: dict[str, str] = {}
        for sensor in sensors:
            if sensor.of in seen:
                raise EstimationError(
                    f"{name}: sensors '{seen[sensor.of]}' and '{sensor.name}' both measure the "
                    f"{sensor.measures} "
                    f"of '{sensor.of}'; one is allowed"
                )
            seen[sensor.of] = sensor.name
            if sensor.delay > 0.0 and sensors is not channels.angles:
                warnings.warn(
                    f"{name}: sensor '{sensor.name}' is late by {sensor.delay:g} s; estimators "
                    "take its values as of "
                    "their stamps, so shift the column of the log by that",
                    DistalWarning,
                    stacklevel=2,
                )
    for sensor in (*channels.proximal, *channels.angles):
        if variance(sensor) == 0.0:
            raise EstimationError(
                f"{name}: sensor '{sensor.name}' has zero noise (and resolution); an estimator "
                "needs its standard "
                f"deviation, e.g. --set sensors.{sensor.name}.noise=…"
            )
    return channels


def sensor_for(sensors: tuple[Sensor, ...], part: str) -> Sensor | None:
    """Return the sensor of the drive or tendon called `part`, or None."""
    return next((sensor for sensor in sensors if sensor.of == part), None)


UNKNOWN_POSITION = {"slider": 0.01, "capstan": 1.0}
"""Kind of drive → standard deviation of its position where nothing measures it and no stop bounds
it [m, rad]. Source: judgement.
"""


DEAD = 0.5
"""Shortest time without a value after which a sensor is dead [s]: it may not come back. Source:
judgement.
"""

DEAD_INTERVALS = 5.0
"""Smallest number of its own intervals without a value after which a sensor is dead [1]. Source:
judgement.
"""


def dead_after(sensor: Sensor) -> float:
    """Return the time without a value after which a sensor is dead [s]: `DEAD`, or `DEAD_INTERVALS`
    of its own intervals where that is longer.
    """
    return max(DEAD, DEAD_INTERVALS / sensor.rate)


MOST_BRIDGES = 100_000
"""Largest number of predictions that bridge one gap [1]. Source: judgement."""

SPLIT = 1.25
"""An interval longer than this times the nominal one is bridged by several predictions [1]. Source:
judgement.
"""

STAMP_ROUNDING = 1e-9
"""Share of an interval by which a stamp may be off without another prediction [1]. Source: rounding
(of stamps).
"""


def first_values(samples: Floats) -> Floats:
    """Return the first finite value of each channel, (n_channels,), NaN for a channel that has
    none.
    """
    firsts: Floats = samples[np.isfinite(samples).argmax(axis=0), np.arange(samples.shape[1])]
    return firsts


def predictions(dt: float, interval: float) -> int:
    """Return the number of predictions for an interval `dt` [s] where samples are nominally an
    `interval` [s] apart.

    It is at most twice `MOST_BRIDGES`, also for an infinite `dt`.
    """
    parts = dt / (SPLIT * interval) - STAMP_ROUNDING
    return max(1, ceil(min(2 * MOST_BRIDGES, parts)))


def fill(
    values: Floats,
    mask: Floats,
    sample: Floats,
    is_finite: Bools,
    rows_after: int = 0,
    bridged: int = 0,
) -> None:
    """Write `values` and `mask` of one input row, (n_channels,) each, from the `sample` that ends
    the interval.

    Args:
        values: of the row, changed in place.
        mask: of the row, changed in place.
        sample: value where `is_finite`, else 0.
        is_finite: where the sample has a value.
        rows_after: number of rows that follow in the same interval; 0 for the sample's own row.
        bridged: number of leading channels that are interpolated along a straight line.
    """
    if rows_after == 0:
        values[:] = sample
        mask[:] = is_finite
        return
    values[:] = 0.0
    mask[:] = MISSING
    values[:bridged] = sample[:bridged]
    np.multiply(is_finite[:bridged], bridge(rows_after + 1), out=mask[:bridged])


@dataclass(frozen=True)
class Report:
    """Indices in a kernel's output y of the reported values, gains and variances of some states.

    A state x_i with error e_i is reported as a value v_i with the error g_i e_i + n_i, where n_i
    has the variance u_i, is correlated by R with those of the other states of its map, and is
    independent of everything else. With G the diagonal of the gains, 1 where nothing is reported,
    the covariance P becomes G P Gᵀ + diag(√u) R diag(√u), which is positive semidefinite as P and
    R are.

    Args:
        states: indices i of the states.
        values: indices of v in y.
        gains: indices of g in y.
        variances: indices of u in y.
        correlation: R, a row for each of the states.
    """

    states: tuple[int, ...] = ()
    values: tuple[int, ...] = ()
    gains: tuple[int, ...] = ()
    variances: tuple[int, ...] = ()
    correlation: tuple[tuple[float, ...], ...] = ()

    @classmethod
    def behind(
        cls, start: int, groups: Sequence[Sequence[int]], correlations: Sequence[Floats]
    ) -> Report:
        """Return the report of several maps, each of which corrects one of the `groups` of states,
        whose errors have such `correlations`.

        For one map after the other, its values, gains and variances stand in y from the index
        `start` on.
        """
        columns = list[tuple[int, int, int, int]]()
        for group in groups:
            n = len(group)
            columns += zip(group, *(range(start + k * n, start + k * n + n) for k in range(3)))
            start += 3 * n
        states, values, gains, variances = zip(*columns) if columns else 4 * ((),)
        rows = block_diag(np.zeros((0, 0)), *correlations).tolist()
        return cls(states, values, gains, variances, tuple(map(tuple, rows)))

    def means(self, means: Floats, ys: Floats) -> Floats:
        """Return the states as they are reported, (k, n), from the filter's own `means`, (k, n),
        and the kernel's outputs `ys`, (k, n_y).
        """
        if not self.states:
            return means
        reported = means.copy()
        reported[:, self.states] = ys[:, self.values]
        return reported

    def variances_of(self, variances: Floats, ys: Floats) -> Floats:
        """Return the filter's own `variances` as they are reported, (k, n); see `means`
        for `ys`.
        """
        if not self.states:
            return variances
        reported = variances.copy()
        gains = ys[:, self.gains]  # in the order in which `covariances` multiplies, to the last bit
        reported[:, self.states] = reported[:, self.states] * gains * gains + ys[:, self.variances]
        return reported

    def covariances(self, covariances: Floats, ys: Floats) -> Floats:
        """Return the filter's own `covariances` as they are reported, (k, n, n); see `means` for
        `ys`.
        """
        if not self.states:
            return covariances
        gains = np.ones(covariances.shape[:2])
        gains[:, self.states] = ys[:, self.gains]
        reported: Floats = covariances * gains[:, :, None] * gains[:, None, :]
        stds = np.sqrt(ys[:, self.variances])
        added = np.array(self.correlation) * stds[:, :, None] * stds[:, None, :]
        diagonal = np.arange(len(self.states))
        added[:, diagonal, diagonal] = ys[:, self.variances]
        reported[np.ix_(range(len(ys)), self.states, self.states)] += added
        return reported


NOTHING_REPORTED = Report()
"""The report that leaves all states unchanged."""


@dataclass(frozen=True)
class Belief:
    """The mean and covariance that an estimator believes at a time; immutable.

    Args:
        time: stamp of the last sample [s].
        kernel_state: mean (n,), covariance (n, n) row by row, and what the estimator remembers of
            its inputs.
        size: number of states n.
        samples: number of samples taken in; the first one may have the belief's own stamp.
    """

    time: float
    kernel_state: Floats
    size: int
    samples: int = 0

    @property
    def mean(self) -> Floats:
        """The filter's own estimate of the states, (n,)."""
        return mean_of(self.kernel_state, self.size)

    @property
    def covariance(self) -> Floats:
        """The covariance of its error, (n, n)."""
        return covariance_of(self.kernel_state, self.size)


WILD = f"beyond {LARGEST_READING:g} in SI; NaN stands for a missing value"
"""The words of a message on a wild value."""


def sample_problem(sample: object, channels: Sequence[str]) -> str | None:
    """Return why `sample` is no sample of `channels`, or None where it is an array with one number
    for each of them.
    """
    if not isinstance(sample, np.ndarray) or sample.dtype.kind not in "fiu":
        return (
            f"a sample is an array of {len(channels)} numbers for {tuple(channels)}, "
            f"{type(sample).__name__} came"
        )
    if sample.shape != (len(channels),):
        return (
            f"a sample must have shape ({len(channels)},) for {tuple(channels)}, "
            f"{sample.shape} came"
        )
    return None


def wild_problem(sample: Floats) -> str | None:
    """Return a message if a value of a sample, (n_channels,) [SI], is wild, None where none is."""
    for value in sample.tolist():  # of a few numbers this is faster than arrays
        if value > LARGEST_READING or value < -LARGEST_READING:
            return f"the sample {sample} is wild ({WILD})"
    return None


TOUCHED = 0.5
"""Probability of a touch beyond which a joint counts as touched [1]. Source: definition (rather
touched than not).
"""

LARGEST_ANGLE = 50.0
"""A joint angle beyond this means that the filter diverged [rad]. Source: judgement."""

SHORTEST = 1e-9
"""Two stamps closer to each other than this count as the same [s]. Source: rounding (of stamps)."""

_BUILDING = threading.Lock()


class StateKind(Enum):
    """The kind of a state. Programs use this; the name of a state is for people."""

    ANGLE = "angle of a joint"
    SPEED = "speed of a joint"
    EXTERNAL_TORQUE = "torque on a joint from outside"
    PARAMETER = "number of the rig, or what several err by together"
    LINEARITY = "weight of the curve of a position sensor's error"
    POSITION = "place of a drive that nothing measures"
    FRICTION = "friction at a drive that the rig does not declare"
    TRANSMITTED = "effort that a drive's play passes on"
    TRANSMISSION_ERROR = "what one play leaves out of a transmission"
    BACKLASH = "far side of a backlash"
    SHEATH = "point of a cable in its sheath"
    CREEP = "slow part of a tendon's stretch"
    SENSOR_BIAS = "offset of a sensor of force, tension or angle"
    SENSOR_GAIN = "share by which such a sensor reads too much"
    OTHER = "anything else"


class KernelEstimator:
    """The base of all estimators that are one kernel (kernel_state, x, p) → (kernel_state⁺, y).

    x = (dt, values of the channels, mask of the channels); y = (innovations, variances) of the
    measured channels; p are the kernel's parameters. The first states are the joints' angles. A
    missing value (NaN) becomes a zero in the mask; long intervals are bridged, see
    `rows`. The `kernel` is None for an estimator that gets one later.
    """

    def __init__(
        self,
        name: str,
        rig: Rig,
        kernel: Kernel | None,
        p: Floats,
        *,
        channels: Channels,
        state_names: tuple[str, ...],
        measured: tuple[str, ...] = (),
        bridged: int = 0,
    ) -> None:
        self.name = name
        self.rig = rig
        self._kernel = kernel
        self.channels = channels.names
        self.measured = measured
        self.state_names = state_names
        joints = tuple(rig.joint_names)
        others = state_names[len(joints) :]
        # the kind of each state, (n,), and the component of the rig that it belongs to
        self.state_kinds = (StateKind.ANGLE,) * len(joints) + (StateKind.OTHER,) * len(others)
        self.state_parts = joints + others
        # leading channels that are interpolated along a straight line over a gap
        self.bridged = bridged
        self._p = frozen(p)
        self.interval = channels.interval  # nominal, between samples [s]
        self._begin: Evaluation | None = None
        self.report = NOTHING_REPORTED

    @property
    def has_kernel(self) -> bool:
        """Whether the estimator has its kernel; `regression` without a learned map has none before
        its homing move.
        """
        return self._kernel is not None

    @property
    def kernel(self) -> Kernel:
        """The estimator's function (kernel_state, x, p) → (kernel_state⁺, y).

        Raises:
            EstimationError: there is none yet; see `has_kernel`.
        """
        if self._kernel is None:
            raise EstimationError(f"{self.name} has no kernel before its homing move")
        return self._kernel

    def initial(self, time: float, sample: Floats) -> Belief:
        """Return the belief before the first sample, which comes at a `time` [s]; `sample` are its
        values, (n_channels,), SI, NaN where missing.

        Raises:
            EstimationError: the stamp is not finite, or the sample has the wrong shape or is wild.
        """
        try:
            time = float(time)
        except (TypeError, ValueError):
            raise EstimationError(
                f"{self.name}: a stamp is a number of seconds, {time!r} came"
            ) from None
        check_time(self.name, time, time, True)
        with suppress(TypeError, ValueError):
            sample = np.asarray(sample, dtype=np.float64)
        problem = sample_problem(sample, self.channels) or wild_problem(sample)
        if problem is not None:
            raise EstimationError(f"{self.name}: {problem}")
        mean, covariance, memory = self.prior(sample, self._p)
        kernel_state = np.concatenate([mean, covariance.ravel(), memory])
        return Belief(time, frozen(kernel_state), len(mean))

    def beginning(self, times: Floats, samples: Floats) -> Belief:
        """Return the belief before the first sample of a whole log.

        Args:
            times: stamps [s], (k,).
            samples: values of the channels, (k, n_channels), NaN where missing.
        """
        return self.initial(times[0], first_values(samples))

    def prior(self, sample: Floats, p: Floats) -> tuple[Floats, Floats, Floats]:
        """Return mean, (n,), covariance, (n, n), and remembered inputs before the first sample.

        Args:
            sample: values of the first sample, (n_channels,), NaN where missing; they give the
                states and the memory that the rig has no prior for.
            p: the kernel's parameters, (n_p,).
        """
        with _BUILDING:
            # the threads of a batch share a filter, and CasADi's symbols are not counted safely
            if self._begin is None:
                self._begin = Evaluation(self.prior_function())
        is_finite = np.isfinite(sample)
        mean, spread, memory = self._begin(np.where(is_finite, sample, 0.0), is_finite, p)
        n = len(mean)
        return mean, np.diag(spread) if len(spread) == n > 1 else spread.reshape(n, n), memory

    def prior_function(self) -> ca.Function:
        """Return the function (values, mask, p) → (mean, covariance or its diagonal, memory) before
        the first sample.

        Raises:
            EstimationError: this estimator has no such function and cannot be exported.
        """
        raise EstimationError(
            f"{self.name} cannot be exported; adaptive, inextensible and elastic can"
        )

    def _first_sample(self) -> list[Vector]:
        """Return the symbols values, mask and p of `prior_function`."""
        n = len(self.channels)
        return symbols(ca.SX, values=n, mask=n, p=len(self._p))

    def scan(
        self, belief: Belief, times: Floats, samples: Floats
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Return means (k, n), covariances (k, n, n), innovations (k, m) and their variances (k, m)
        over a whole log.

        The `belief`, `times` and `samples` are as for `checked_rows`.

        Raises:
            EstimationError: stamps do not rise, or a value is wild: beyond `LARGEST_READING`.
        """
        kernel_states, ys = self.advanced(belief, times, samples)
        n = belief.size
        values, variances = self.innovations_of(ys, np.asarray(samples, dtype=np.float64))
        means = self.report.means(mean_of(kernel_states, n).copy(), ys)
        covariances = self.report.covariances(covariance_of(kernel_states, n).copy(), ys)
        return means, covariances, values, variances

    def pieces(
        self, belief: Belief, parts: Iterable[tuple[Floats, Floats]]
    ) -> Iterator[tuple[Floats, ...]]:
        """Yield means (k, n), variances of the states (k, n), innovations (k, m) and their
        variances (k, m) of one part of a log after the other, so that only one part's covariances
        are in memory.

        Args:
            belief: before the first sample.
            parts: stamps [s], (k,), and values of the channels, (k, n_channels).

        Raises:
            EstimationError: as `checked_rows`.
        """
        for times, samples in parts:
            n = belief.size
            kernel_states, ys = self.advanced(belief, times, samples)
            means = mean_of(kernel_states, n).copy()
            yield self.reported(means, variances_of(kernel_states, n).copy(), ys, samples)
            last = frozen(kernel_states[-1].copy())
            belief = Belief(float(times[-1]), last, n, belief.samples + len(times))

    def reported(
        self, means: Floats, variances: Floats, ys: Floats, samples: Floats
    ) -> tuple[Floats, ...]:
        """Return what `pieces` yields, from the filter's own `means` and `variances`, (k, n), the
        kernel's outputs `ys`, (k, n_y), and the `samples`, (k, n_channels).
        """
        return (
            self.report.means(means, ys),
            self.report.variances_of(variances, ys),
            *self.innovations_of(ys, samples),
        )

    def scan_all(
        self,
        beliefs: Sequence[Belief],
        times: Sequence[Floats],
        samples: Sequence[Floats],
        parameters: Sequence[Floats],
    ) -> list[tuple[Floats, Floats, Floats]]:
        """Return means (k, n), variances of the states (k, n) and outputs (k, n_y) of several runs.

        They are the filter's own, before learned maps correct them (`report`). The runs are
        computed side by side where the processor has vector lanes for that. For each run there are
        a belief, `times` and `samples` as for `checked_rows`, and its kernel's parameters, (n_p,).

        Raises:
            EstimationError: as `checked_rows`.
        """
        rows = [self.checked_rows(*run) for run in zip(beliefs, times, samples)]
        n = beliefs[0].size
        keep = [
            *range(n),
            *variances_of(np.arange(n + n * n), n),
        ]  # of each kernel state the mean and the variances
        feeds = [
            Feed(belief.kernel_state, xs, p)
            for belief, (xs, _), p in zip(beliefs, rows, parameters)
        ]
        driven = (
            at_samples(run, last)
            for run, (_, last) in zip(advance_all(self.kernel, feeds, keep), rows)
        )
        return [(kept[:, :n], kept[:, n:], ys) for kept, ys in driven]

    def advanced(self, belief: Belief, times: Floats, samples: Floats) -> Advanced:
        """Return the kernel states and outputs at each sample of a log.

        The `belief`, `times` and `samples` are as for `checked_rows`.

        Raises:
            EstimationError: as `checked_rows`.
        """
        rows, last = self.checked_rows(belief, times, samples)
        return at_samples(advance(self.kernel, Feed(belief.kernel_state, rows, self._p)), last)

    def checked_rows(
        self, belief: Belief, times: Floats, samples: Floats
    ) -> tuple[Floats, NDArray[np.intp]]:
        """Return the kernel's input rows for a whole log, and the index of each sample's own row
        among them.

        Args:
            belief: before the first sample.
            times: stamps [s], rising, (k,).
            samples: values of the channels, (k, n_channels).

        Raises:
            EstimationError: stamps do not rise, or a value is wild: beyond `LARGEST_READING`.
        """
        times = np.asarray(times, dtype=np.float64)
        samples = np.asarray(samples, dtype=np.float64)
        if samples.shape != (len(times), len(self.channels)):
            raise EstimationError(
                f"{self.name}: samples must have shape ({len(times)}, {len(self.channels)}) for "
                f"{self.channels}, "
                f"{samples.shape} came"
            )
        if np.any(np.abs(samples) > LARGEST_READING):
            raise EstimationError(f"{self.name}: a sample is wild ({WILD})")
        steps = np.diff(times, prepend=belief.time)
        for i in np.flatnonzero(~(steps >= SHORTEST)):
            check_time(
                self.name, times[i] - steps[i], times[i], bool(i == 0 and belief.samples == 0)
            )
        return self.rows(steps, samples)

    @property
    def angles(self) -> slice:
        """The indices of the joints' angles in the state vector."""
        return slice(0, len(self.rig.joints))

    @property
    def unseen(self) -> str | None:
        """A sentence on the directions of joint space that the sensors do not see, if it is known
        that there are any.
        """
        return None

    @property
    def contacts(self) -> dict[str, list[int]]:
        """Joint → indices in the kernel state of the probability of a touch, and of the time for
        which it has lasted [s], of each joint that may be touched.
        """
        return {}

    @property
    def touched(self) -> tuple[int, ...]:
        """Indices in the kernel state of the probability that something touches a joint, of each
        joint that may be touched; empty where the estimator looks for no touch.
        """
        return tuple(probability for probability, _ in self.contacts.values())

    @property
    def parameters(self) -> Floats:
        """The kernel's parameters, (n_p,)."""
        return self._p

    def innovations_of(self, ys: Floats, samples: Floats) -> tuple[Floats, Floats]:
        """Return innovations, NaN where the value was missing, and their variances, (k, m) each.

        Args:
            ys: the kernel's outputs, (k, n_y).
            samples: values of the channels, (k, n_channels).
        """
        m = len(self.measured)
        columns = [self.channels.index(name) for name in self.measured]
        return np.where(np.isnan(samples[:, columns]), np.nan, ys[:, :m]), ys[:, m : 2 * m].copy()

    def rows(self, steps: Floats, samples: Floats) -> tuple[Floats, NDArray[np.intp]]:
        """Return the kernel's input rows (dt, values, mask) with those that bridge gaps, and the
        index of each sample's own row among them.

        Args:
            steps: intervals before the samples [s], (k,).
            samples: values of the channels, NaN where missing, (k, n_channels).

        Raises:
            EstimationError: a gap is too long.
        """
        is_finite = np.isfinite(samples)
        filled = np.where(is_finite, samples, 0.0)
        parts = np.maximum(1.0, np.ceil(steps / (SPLIT * self.interval) - STAMP_ROUNDING))
        if parts.max(initial=1.0) > MOST_BRIDGES:
            raise EstimationError(
                f"{self.name}: a gap of {steps.max():g} s is too long to bridge "
                f"(at most {MOST_BRIDGES * SPLIT * self.interval:g} s); split the log there"
            )
        if parts.sum() > 4 * MOST_BRIDGES + 4 * len(steps):
            raise EstimationError(
                f"{self.name}: the stamps are {np.median(steps):g} s apart, the rig's sensors give "
                f"a value every {self.interval:g} s: {parts.sum():.3g} predictions would be "
                "needed; set the sensors' rate to the log's"
            )
        counts = parts.astype(np.int64)
        last = np.cumsum(counts) - 1
        lengths, values, masks = (
            np.repeat(of, counts, axis=0) for of in (steps / parts, filled, is_finite.astype(float))
        )
        for i in np.flatnonzero(counts > 1):
            for after in range(1, int(counts[i])):
                row = last[i] - after
                fill(values[row], masks[row], filled[i], is_finite[i], after, self.bridged)
        return np.column_stack([lengths, values, masks]), last


def check_time(name: str, before: float, now: float, first: bool) -> None:
    """Raise an error unless the stamp `now` [s] is later than the stamp `before` [s].

    Where `first`, both may be the same: the first sample may have the belief's own stamp.

    Raises:
        EstimationError: the stamp is not finite, is late or repeats.
    """
    if not np.isfinite(now):
        raise EstimationError(f"{name}: the stamp {now} is not a finite time")
    if now < before or (now - before < SHORTEST and not first):
        what = "is late" if now < before else "repeats"
        raise EstimationError(
            f"{name}: the stamp {now:.15g} s {what} (the belief is at {before:.15g} s); stamps "
            "must rise"
        )


_UNITS = {
    StateKind.ANGLE: "rad",
    StateKind.SPEED: "rad/s",
    StateKind.EXTERNAL_TORQUE: "N m",
    StateKind.SHEATH: "m",
    StateKind.CREEP: "m",
    StateKind.SENSOR_GAIN: "1",
}
"""Kind of a state → its unit."""

_OF_DRIVE = {
    StateKind.POSITION: position_unit,
    StateKind.BACKLASH: position_unit,
    StateKind.FRICTION: effort_unit,
    StateKind.TRANSMITTED: effort_unit,
    StateKind.TRANSMISSION_ERROR: effort_unit,
}
"""Kind of a drive's state → function that returns its unit."""


def state_units(estimator: KernelEstimator) -> tuple[str, ...]:
    """Return the SI units of an estimator's states, (n,): ``1`` for a plain number, empty where the
    unit is not known.
    """
    rig: Rig = estimator.rig
    by_name = dict.fromkeys((tendon_angle_name(tendon.name) for tendon in rig.tendons), "rad")
    sensors = {sensor.name: sensor for sensor in rig.sensors}

    def unit(name: str, kind: StateKind, part: str) -> str:
        if kind is StateKind.PARAMETER:
            return (
                "1"
                if part.endswith(".factor")
                else number(rig, part.removesuffix(".deviation")).quantity.si or "1"
            )
        if kind in (StateKind.LINEARITY, StateKind.SENSOR_BIAS):
            return str(sensors[part].si)
        if kind in _OF_DRIVE:
            return _OF_DRIVE[kind](rig.drive(part))
        return _UNITS.get(kind) or by_name.get(name, "")

    states = estimator.state_names, estimator.state_kinds, estimator.state_parts
    return tuple(unit(*state) for state in zip(*states))


def states_of(
    kind: StateKind,
    parts: Sequence[str],
    state_kinds: Sequence[StateKind],
    state_parts: Sequence[str],
) -> dict[str, int]:
    """Return component → index of its state of one kind, in the order of `parts`; components
    without such a state are left out.

    Args:
        parts: names of the components.
        state_kinds: kind of each state, (n,).
        state_parts: component of each state, (n,).
    """
    indices = {
        part: i
        for i, (state_kind, part) in enumerate(zip(state_kinds, state_parts))
        if state_kind is kind
    }
    return {part: indices[part] for part in parts if part in indices}


def external_torques_of(estimator: KernelEstimator) -> dict[str, int]:
    """Return joint → index of the state that is the external torque on it, in the order of the
    joints.
    """
    kinds = estimator.state_kinds, estimator.state_parts
    return states_of(StateKind.EXTERNAL_TORQUE, estimator.rig.joint_names, *kinds)
