"""An estimator in a control loop: one belief, one call per sample; all arrays are made before the
first sample. Logged values, such as counts, milliamperes or degrees, become samples in SI live.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import inf, nan
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from distal.arrays import Floats
from distal.errors import EstimationError, did_you_mean
from distal.estimators import (
    LARGEST_ANGLE,
    SHORTEST,
    KernelEstimator,
    channels_of,
    check_time,
    external_torques_of,
    make_estimator,
    sample_problem,
    wild_problem,
)
from distal.estimators.estimator_protocol import MOST_BRIDGES, fill, predictions
from distal.kernels import covariance_of, mean_of
from distal.kernels.layout import MISSING, READ
from distal.logs import LARGEST_READING, RawToSI, Remark
from distal.results.estimate import only_joint
from distal.rig import Rig, as_rig, log_factor

LATEST = 1e300
"""Largest stamp that is accepted [s]. Source: rounding (differences of stamps stay finite)."""


@dataclass(frozen=True)
class JointContact:
    """Whether something touches a joint.

    Args:
        joint: name of the joint.
        probability: that something touches it, 0 to 1; a touch begins above one half.
        torque: external torque on the joint [N m].
        torque_std: standard deviation of the torque's error [N m].
        since: for how long the joint has been touched [s]; 0 where it is not.
    """

    joint: str
    probability: float
    torque: float
    torque_std: float
    since: float


class OfJoints(Protocol):
    """What has angles of joints and their standard deviations, (n_joints,) each [rad]."""

    @property
    def angles(self) -> Floats | tuple[float, ...]:
        """Angles of the joints."""

    @property
    def angle_stds(self) -> Floats | tuple[float, ...]:
        """Standard deviations of their errors."""


class JointAngles:
    """The angle of the only joint, and its standard deviation."""

    @property
    def angle(self: OfJoints) -> float:
        """Angle of the joint [rad].

        Raises:
            EstimationError: there are several joints.
        """
        return float(only_joint(np.asarray(self.angles), "angle", "angles"))

    @property
    def angle_std(self: OfJoints) -> float:
        """Standard deviation of the error of the joint's angle [rad].

        Raises:
            EstimationError: there are several joints.
        """
        return float(only_joint(np.asarray(self.angle_stds), "angle_std", "angle_stds"))


class Remembered(NamedTuple):
    """What a live estimator believes: its arrays, the angles and the std that `reset` was given,
    the stamp of the last sample [s], and the number of samples.
    """

    arrays: list[Floats]
    begin: tuple[Floats | None, float]
    time: float
    samples: int


class LiveEstimator(JointAngles):
    """An estimator that takes one sample after the other, with the same values as `estimate` over
    the whole log.

    ```python
    live = distal.LiveEstimator("paper-2008")
    angle = live.step(time, sample)  # sample: values of live.channels, SI, NaN where missing
    print(live.angle_std, live.innovations)
    ```

    Args:
        rig: the description, or a shipped rig's name, or a path.
        estimator: a name (see `ESTIMATORS`), or an estimator with a kernel; None: the rig's usual
            one.
        compiled: compile the kernel where possible.

    Raises:
        EstimationError: the estimator cannot run on this rig, or has no kernel.
    """

    def __init__(
        self,
        rig: Rig | str | Path,
        estimator: str | KernelEstimator | None = None,
        compiled: bool = True,
    ) -> None:
        rig = as_rig(rig)
        chosen = (
            estimator
            if isinstance(estimator, KernelEstimator)
            else make_estimator(estimator, rig, compiled)
        )
        if not chosen.has_kernel:
            raise EstimationError(
                f"{chosen.name} is for logs; live, use adaptive or another one with a kernel"
            )
        self._made_of = rig, estimator, compiled
        self._estimator = chosen
        self._time = nan
        self._samples = 0
        self._n = len(self.state_names)
        m = len(self.measured)
        self._loop = chosen.kernel.loop(chosen.parameters)
        self._kernel_state = self._loop.kernel_state
        self._x = self._loop.x
        self._y = self._loop.y
        self._finite = np.ones(len(self._kernel_state), dtype=bool)
        self._width = len(self.channels)
        self._joint_states = chosen.angles
        self._row = memoryview(self._x.data).cast("B").cast("d")
        # where the masks of what is compared stand in a row
        self._read = [1 + self._width + self.channels.index(name) for name in self.measured]
        self._innovations = np.full(m, np.nan)
        self._innovation_view = _view(self._innovations)
        self._innovation_variances = _view(self._y[m : 2 * m])
        self._begin: tuple[Floats | None, float] = (None, 0.0)
        mean = mean_of(self._kernel_state, self._n)
        covariance = covariance_of(self._kernel_state, self._n)
        # reported is the filter's own state, or a copy of it in which maps correct some values
        has_map = bool(chosen.report.states)
        self._state, self._spread = (
            (mean.copy(), covariance.copy()) if has_map else (mean, covariance)
        )
        # in which it differs from a new one
        self._arrays = [self._kernel_state, self._state, self._spread, self._innovations]
        self._mean = _view(self._state)
        self._covariance = _view(self._spread)
        self._angles = self._mean[chosen.angles]
        # a strided view of the covariance's diagonal, which can be written
        self._diagonal = self._kernel_state[self._n : self._n * (self._n + 1) : self._n + 1]
        self._touched = list(chosen.touched)
        torques = external_torques_of(chosen)
        self._touchable = list(torques)
        self._torques = list(torques.values())
        self._torque_names = tuple(self.state_names[i] for i in self._torques)
        self._warm()

    def _warm(self) -> None:
        """Take two samples and forget them, so that the first real ones do not wait for what is
        built on first use.
        """
        with suppress(EstimationError):
            for time in (0.0, self.interval):
                self.step(time, np.zeros(self._width))
        for array in (self._kernel_state, self._x, self._y):
            array[:] = 0.0
        self.reset()

    def step(self, time: float, sample: Floats) -> float | Floats:
        """Take in a sample and return the joint angle [rad], of several joints their `angles`.

        Args:
            time: stamp of the sample [s], later than the last one's.
            sample: values of `channels`, SI, NaN where missing, (n_channels,).

        Raises:
            EstimationError: the stamp is late, repeats or follows a gap that is too long; or the
                sample has a wrong shape or a wild value: the state is then unchanged. Or the filter
                diverged: call `reset`.
        """
        name = self._estimator.name
        problem = sample_problem(sample, self.channels)
        if problem is not None:
            raise EstimationError(f"{name}: {problem}")
        if type(time) is not float:
            time = _seconds(name, time)
        if not -LATEST <= time <= LATEST:
            raise EstimationError(f"{name}: the stamp is no time: give a finite number of seconds")
        # of a few numbers Python's own are faster than arrays
        x = self._row
        width = self._width
        for i, reading in enumerate(sample.tolist(), 1):
            if -LARGEST_READING <= reading <= LARGEST_READING:
                x[i] = reading
                x[i + width] = READ
            elif reading != reading:
                x[i] = 0.0
                x[i + width] = MISSING
            else:
                raise EstimationError(f"{name}: {wild_problem(sample)}")
        if self._samples == 0:
            self._start(time, sample)
            x[0] = 0.0
            parts = 1
        else:
            dt = time - self._time
            if dt < SHORTEST:
                check_time(name, self._time, time, False)
            parts = predictions(dt, self.interval)
            if parts > MOST_BRIDGES:
                raise EstimationError(
                    f"{name}: a gap of {dt:g} s is too long to bridge; call reset"
                )
            x[0] = dt / parts
        if parts > 1:
            self._bridge(parts)
        self._loop.step()
        self._time = time
        self._samples = self._samples + 1
        for i, mask in enumerate(self._read):
            self._innovations[i] = self._y[i] if x[mask] else nan
        if self._estimator.report.states:
            self._report()
        angles = self._angles.tolist()
        # a sum would warn of infinite terms; bytes are searched faster than an array is reduced
        bounded = b"\0" not in np.isfinite(self._kernel_state, out=self._finite).tobytes()
        for angle in angles:
            bounded = bounded and abs(angle) <= LARGEST_ANGLE
        if not bounded:
            raise EstimationError(f"{name}: left all bounds at {time:g} s; call reset")
        return angles[0] if len(angles) == 1 else self._angles

    def _bridge(self, parts: int) -> None:
        """Cross a gap by all but the last of its predictions; the row of the sample itself stands
        in x after it.
        """
        values = self._x[1 : 1 + self._width]
        mask = self._x[1 + self._width :]
        sample = values.copy()
        is_read = mask == READ
        for rows_after in range(parts - 1, 0, -1):
            fill(values, mask, sample, is_read, rows_after, self._estimator.bridged)
            self._loop.step()
        fill(values, mask, sample, is_read)

    def _report(self) -> None:
        """Write the reported mean and covariance, with the learned maps, from the filter's own."""
        report = self._estimator.report
        y = self._y[None]
        n = self._n
        self._state[:] = report.means(self._kernel_state[None, :n], y)[0]
        self._spread[:] = report.covariances(
            self._kernel_state[n : n * (n + 1)].reshape(1, n, n), y
        )[0]

    def _start(self, time: float, sample: Floats) -> None:
        """Begin with the prior, at the angles and with the std that `reset` was given."""
        self._kernel_state[:] = self._estimator.initial(time, sample).kernel_state
        angles, std = self._begin
        if angles is not None:
            self._kernel_state[self._joint_states] = angles
        joints = np.arange(self._joint_states.stop)
        self._diagonal[joints] = np.maximum(self._diagonal[joints], std * std)

    def reset(self, angle: float | Sequence[float] | None = None, angle_std: float = 0.0) -> None:
        """Forget everything: the next sample is the first.

        Args:
            angle: probable joint angle at that sample [rad], one number for each joint; default the
                rig's `initial`.
            angle_std: smallest standard deviation of that angle [rad]; the rig's own counts where
                it is larger.

        Raises:
            EstimationError: there are more or fewer angles than joints.
        """
        angles = None if angle is None else np.atleast_1d(np.asarray(angle, dtype=np.float64))
        if angles is not None and angles.shape != (self._joint_states.stop,):
            raise EstimationError(
                f"reset takes {self._joint_states.stop} angles, one for each joint, {angle!r} came"
            )
        self._begin = (angles, angle_std)
        self._samples = 0
        self._time = nan
        self._innovations[:] = np.nan

    def clone(self) -> LiveEstimator:
        """Return a live estimator at the same belief, with arrays of its own, so that both go on
        independently, also in different threads.
        """
        return LiveEstimator(self.rig, self._estimator).resumed(self.belief())

    __copy__ = clone
    """Arrays are never shared."""

    def __deepcopy__(self, memo: object) -> LiveEstimator:
        """Return a clone."""
        return self.clone()

    def __reduce__(self) -> tuple[object, ...]:
        """Return how to make this live estimator again in another process: its rig, its estimator
        by name, and its belief.
        """
        return LiveEstimator, self._made_of, self.belief()

    def belief(self) -> Remembered:
        """Return a copy of all that the next sample changes, for `resumed`."""
        arrays = [array.copy() for array in self._arrays]
        return Remembered(arrays, self._begin, self._time, self._samples)

    def resumed(self, belief: Remembered) -> LiveEstimator:
        """Return this live estimator, put back to a `belief`: the next sample is the one after."""
        for array, values in zip(self._arrays, belief.arrays):
            array[:] = values
        _, self._begin, self._time, self._samples = belief
        return self

    __setstate__ = resumed

    @property
    def estimator(self) -> KernelEstimator:
        """The estimator that takes in the samples."""
        return self._estimator

    @property
    def rig(self) -> Rig:
        """The description of the rig that the estimator runs on."""
        return self._estimator.rig

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the sensors in a sample."""
        return self._estimator.channels

    @property
    def measured(self) -> tuple[str, ...]:
        """Names of the sensors that have an innovation."""
        return self._estimator.measured

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the estimator's states, (n,)."""
        return self._estimator.state_names

    @property
    def interval(self) -> float:
        """Nominal time between samples [s]."""
        return self._estimator.interval

    @property
    def time(self) -> float:
        """Stamp of the last sample [s]; NaN before the first."""
        return self._time

    @property
    def samples(self) -> int:
        """Number of samples taken in since the beginning or the last `reset`."""
        return self._samples

    @property
    def innovations(self) -> Floats:
        """Innovations of the last sample, measured minus predicted, (m,), NaN where nothing was
        compared; a view that changes with each step.
        """
        return self._innovation_view

    @property
    def innovation_variances(self) -> Floats:
        """Variances of the innovations, (m,), a view that changes with each step."""
        return self._innovation_variances

    @property
    def mean(self) -> Floats:
        """Reported estimate of the states, (n,), a read-only view that changes with each step."""
        return self._mean

    @property
    def covariance(self) -> Floats:
        """Reported covariance of the estimate's error, (n, n), a read-only view that changes with
        each step.
        """
        return self._covariance

    @property
    def angles(self) -> Floats:
        """Angles of the joints [rad], (n_joints,), a read-only view that changes with each step."""
        return self._angles

    @property
    def torque_names(self) -> tuple[str, ...]:
        """Names of the estimated external torques, one for each joint that may be touched."""
        return self._torque_names

    @property
    def angle_stds(self) -> Floats:
        """Standard deviations of the errors of the joints' angles [rad], (n_joints,)."""
        return self._stds(self._joint_states)

    def _stds(self, states: slice | list[int]) -> Floats:
        stds: Floats = np.sqrt(np.maximum(np.diagonal(self._spread)[states], 0.0))
        return stds

    @property
    def added_by_maps(self) -> Floats:
        """Angles that learned maps add to the filter's own [rad], (n_joints,)."""
        added: Floats = self._angles - self._kernel_state[self._joint_states]
        return added

    @property
    def contacts(self) -> tuple[JointContact, ...]:
        """Whether something touches each joint that may be touched, one entry for each."""
        torques = zip(self.external_torques.tolist(), self.external_torque_stds.tolist())
        felt = dict(zip(self._touchable, torques))
        contacts = list[JointContact]()
        for joint, at in self._estimator.contacts.items():
            probability, since = self._kernel_state[at].tolist()
            contacts.append(JointContact(joint, probability, *felt[joint], since))
        return tuple(contacts)

    @property
    def touched(self) -> float:
        """The largest probability that something touches a joint."""
        return float(self._kernel_state[self._touched].max(initial=0.0))

    @property
    def external_torques(self) -> Floats:
        """External torques on the joints that may be touched [N m], in the order of
        `torque_names`.
        """
        torques: Floats = self._state[self._torques]
        return torques

    @property
    def external_torque_stds(self) -> Floats:
        """Standard deviations of the errors of the external torques [N m]."""
        return self._stds(self._torques)


def _seconds(name: str, time: object) -> float:
    """Return a stamp as a float; one that is too large becomes infinite."""
    if not isinstance(time, (float, int, np.floating, np.integer)):
        raise EstimationError(f"{name}: the stamp is no time: give a finite number of seconds")
    try:
        return float(time)
    except OverflowError:
        return inf


def _view(array: Floats) -> Floats:
    view = array.view()
    view.flags.writeable = False
    return view


TEMPERATURE_SLOPE = -0.0011
"""Relative change of a motor's torque constant per kelvin [1/K]. Source: physics (remanence of
Nd-Fe-B magnets, −0.11 %/K).
"""

REFERENCE = 25.0
"""Temperature for which a torque constant holds [°C]. Source: definition (catalogue values)."""

HOTTEST = 200.0
"""Highest temperature of a motor that still turns [°C]; minus this is the lowest. Source:
judgement.
"""

Values = Mapping[str, object] | Sequence[object] | Floats


class LogUnits:
    """A converter from logged values to samples of an estimator, by the columns and units of the
    rig.

    ```python
    units = distal.LogUnits(rig)
    # SI, in the order of `channels`, which is that of `LiveEstimator`
    sample = units.sample(time, {"m1_position": 2048, "m1_current": 35})
    ```

    Values pass through the `RawToSI`: encoders that wrap are followed, registers are decoded, and
    wrong or old readings are missing; `remarks` says so, and a `Monitor` takes them, too.
    A motor whose turn is not known is in `in_doubt` until it has moved so far that only one turn is
    left.

    Args:
        rig: the description, or a shipped rig's name, or a path.
        channels: sensors in a sample; default those of `LiveEstimator(rig)`, in its order.
        ranged: whether the ranges of the joints say in which turn a motor is; before a power-on
            routine they do not.
        doubting: whether readings that may be old are missing, see `RawToSI`.
    """

    def __init__(
        self,
        rig: Rig | str | Path,
        channels: Sequence[str] | None = None,
        *,
        ranged: bool = True,
        doubting: bool = True,
    ) -> None:
        self.rig = rig = as_rig(rig)
        names = channels_of(rig, "LogUnits").names if channels is None else channels
        by_name = {sensor.name: sensor for sensor in rig.sensors}
        self._sensors = [by_name[name] for name in names]
        self.channels = tuple(names)
        self.columns = tuple(sensor.log_column for sensor in self._sensors)
        self._factors = np.array([sensor.sign * log_factor(sensor) for sensor in self._sensors])
        self._at = {
            name: i for names in (self.channels, self.columns) for i, name in enumerate(names)
        }
        self._ways = {"ranged": ranged, "doubting": doubting}
        self.reset()

    def reset(self) -> None:
        """Forget in which turns the encoders are, and all else that was learned from readings."""
        self._to_si = RawToSI(self.rig, self._sensors, self._factors, **self._ways)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What was done with the readings of the last sample."""
        return self._to_si.remarks

    @property
    def restarts(self) -> tuple[str, ...]:
        """Motors that, at the last sample, count from another turn than before; the sample is
        corrected for that.
        """
        return tuple(
            self._sensors[self._index(remark.sensor)].of
            for remark in self.remarks
            if remark.kind == "restarted"
        )

    @property
    def in_doubt(self) -> tuple[str, ...]:
        """Motors that may be in several turns."""
        return self._to_si.in_doubt

    def followed_by(self, rig: Rig) -> LogUnits:
        """Return a converter for another description of the same motors, in the turns in which they
        are now.

        Turns are kept for encoders that wrap, not for motors that count their turns.
        """
        other = LogUnits(rig, self.channels, doubting=self._ways["doubting"])
        other._to_si.follow(self._to_si)
        return other

    def _index(self, name: str) -> int:
        if name not in self._at:
            raise EstimationError(
                f"there is no '{name}' among the sensors{did_you_mean(name, self.columns)}"
            )
        return self._at[name]

    def sample(
        self, time: float, values: Values, temperatures: Mapping[str, float] | None = None
    ) -> Floats:
        """Return a sample in SI, (n_channels,), NaN where a value is missing.

        Args:
            time: stamp [s].
            values: by column or sensor, where one left out is missing, or in the order of
                `columns`.
            temperatures: motor → its temperature [°C], to which its torque constant is corrected.

        Raises:
            EstimationError: a value is no number, infinite or beyond all sensors, or has an unknown
                name.
        """
        logged = self._logged(values)
        wild = np.abs(logged * self._factors) > LARGEST_READING
        if wild.any():
            at = int(np.argmax(wild))
            raise EstimationError(f"'{self.columns[at]}' cannot be {logged[at]:g}")
        sample = self._to_si.take(time, logged.tolist())
        for name, temperature in (temperatures or {}).items():
            if not abs(_number(name, temperature)) <= HOTTEST:
                raise EstimationError(f"temperatures: '{name}' cannot have {temperature!r} °C")
            for i in self._torques_of(name):
                sample[i] *= 1.0 + TEMPERATURE_SLOPE * (temperature - REFERENCE)
        return sample

    def _logged(self, values: Values) -> Floats:
        if isinstance(values, Mapping):
            logged = np.full(len(self._sensors), nan)
            for name, value in values.items():
                logged[self._index(name)] = _number(name, value)
            return logged
        if len(values) != len(self._sensors):
            raise EstimationError(
                f"a sample has {len(self._sensors)} values ({', '.join(self.columns)}), "
                f"{len(values)} came"
            )
        return np.array([_number(name, value) for name, value in zip(self.columns, values)])

    def logged(self, channel: str, value: float) -> float:
        """Return the logged number for a channel's value in SI, in the current turn of its encoder,
        such as a goal for a motor.
        """
        i = self._index(channel)
        return (value - self._to_si.ahead(i)) / float(self._factors[i])

    def _torques_of(self, motor: str) -> list[int]:
        drives = self.rig.drive_names
        if motor not in drives:
            raise EstimationError(
                f"temperatures: there is no motor '{motor}'{did_you_mean(motor, drives)}"
            )
        return [
            i
            for i, sensor in enumerate(self._sensors)
            if sensor.of == motor and sensor.measures == "force"
        ]


def _number(name: str, value: object) -> float:
    """Return a value as a number, NaN where it is missing."""
    if value is None:
        return nan
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        raise EstimationError(f"'{name}' must be a number, {value!r} came")
    number = float(value)
    if number in (inf, -inf):
        raise EstimationError(f"'{name}' is infinite")
    return number
