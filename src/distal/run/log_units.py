"""Logged values, such as counts, milliamperes or degrees, as samples in SI; encoders that wrap
after a turn are unwrapped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from math import ceil, degrees, floor, inf, isfinite, nan, pi
from pathlib import Path
from typing import Literal

import numpy as np

from distal.arrays import Floats
from distal.errors import EstimationError
from distal.estimators import channels_of
from distal.logs import LARGEST_READING
from distal.rig import Rig, Sensor, as_rig, log_factor
from distal.rig.sensors.motions import AngleSensor
from distal.run.drive_range import motor_range
from distal.run.live_estimator import LiveEstimator
from distal.run.monitor import Monitor, Reading
from distal.suggestions import did_you_mean

FASTEST = 10.0
"""Largest speed of a motor whose rig does not give one (`servo.fastest`) [rad/s, m/s]. Source:
judgement.
"""

TEMPERATURE_SLOPE = -0.0011
"""Relative change of a motor's torque constant per kelvin [1/K]. Source: physics (remanence of
Nd-Fe-B magnets, −0.11 %/K).
"""

REFERENCE = 25.0
"""Temperature for which a torque constant holds [°C]. Source: definition (catalogue values)."""

TURN = 2 * pi
"""One turn of a motor that is read in radians or degrees [rad]. Source: definition (full angle)."""

BOOTS = 0.05
"""Shortest time in which a motor restarts and answers again [s]; a position that jumps sooner is a
wrong reading. Source: judgement.
"""

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

    An encoder that wraps is followed beyond its turn in both directions: of all positions that its
    reading may mean, the one nearest to the last is taken. This does not work at the first value,
    nor after a silence in which the motor may have gone half a turn. Then the motor is in the only
    turn that its joint's range allows. If several are possible, `doubts` says so, and the motor is
    in `in_doubt` until it has moved so far that only one is left.

    A motor that counts its turns may count from another one after a restart; it is then set to the
    turn that its joint's range allows.

    Args:
        rig: the description, or a shipped rig's name, or a path.
        channels: sensors in a sample; default those of `LiveEstimator(rig)`, in its order.
        turns: column or sensor → the logged number of one turn, at which it wraps, 0 for one that
            does not; default `counts_per_turn` of those that are logged in counts.
        temperature_slope: relative change of torque constants with temperature [1/K], used where
            `sample` is given temperatures.
        ranged: whether the ranges of the joints say in which turn a motor is; before a power-on
            routine they do not.

    Raises:
        EstimationError: a name in `turns` is no position of the rig, or a turn is no number.
    """

    def __init__(
        self,
        rig: Rig | str | Path,
        channels: Sequence[str] | None = None,
        turns: Mapping[str, float] | None = None,
        temperature_slope: float = TEMPERATURE_SLOPE,
        *,
        ranged: bool = True,
    ) -> None:
        self.rig = rig = as_rig(rig)
        names = channels_of(rig, "LogUnits", others=True).names if channels is None else channels
        by_name = {sensor.name: sensor for sensor in rig.sensors}
        self._sensors = [by_name[name] for name in names]
        self.channels = tuple(names)
        self.columns = tuple(sensor.log_column for sensor in self._sensors)
        self._factors = np.array([sensor.sign * log_factor(sensor) for sensor in self._sensors])
        self._at = {
            name: i for names in (self.channels, self.columns) for i, name in enumerate(names)
        }
        self._slope = temperature_slope
        self._turns = self._turn_sizes({} if turns is None else turns)
        anywhere = (-inf, inf)
        self._ranges = [motor_range(rig, s) if ranged else anywhere for s in self._sensors]
        self._counted = [
            i
            for i, (sensor, (low, high)) in enumerate(zip(self._sensors, self._ranges))
            if isinstance(sensor, AngleSensor)
            and high - low < TURN
            and not isfinite(self._turns[i])
        ]
        self._fastest = [_fastest(rig, sensor) for sensor in self._sensors]
        self.reset()

    def reset(self) -> None:
        """Forget in which turns the encoders are."""
        self._last, self._seen, self._ahead = (np.full(len(self._sensors), nan) for _ in range(3))
        self._ahead[:] = 0.0
        self._doubts: tuple[str, ...] = ()
        self._restarts: tuple[str, ...] = ()
        # least and largest position of those whose turn is a guess, in the turn that was guessed
        self._guessed = dict[int, tuple[float, float]]()

    @property
    def doubts(self) -> tuple[str, ...]:
        """Sentences on the encoders that may have turned without a value before the last sample."""
        return self._doubts

    @property
    def restarts(self) -> tuple[str, ...]:
        """Motors that, at the last sample, count from another turn than before; the sample is
        corrected for that.
        """
        return self._restarts

    @property
    def in_doubt(self) -> tuple[str, ...]:
        """Motors that may be in several turns."""
        return tuple(self._sensors[i].of for i in self._guessed)

    def followed_by(self, rig: Rig) -> LogUnits:
        """Return a converter for another description of the same motors, in the turns in which they
        are now.

        Turns are kept for encoders that wrap, not for motors that count their turns.
        """
        other = LogUnits(rig, self.channels, temperature_slope=self._slope)
        other._last = self._last.copy()
        other._seen = self._seen.copy()
        other._ahead[np.isfinite(self._turns)] = self._ahead[np.isfinite(self._turns)]
        return other

    def _turn_sizes(self, asked: Mapping[str, float]) -> Floats:
        """Return the turn of each channel in SI, infinite for one that does not wrap."""
        sizes = np.full(len(self._sensors), inf)
        for i, sensor in enumerate(self._sensors):
            if (
                isinstance(sensor, AngleSensor)
                and sensor.measures == "position"
                and sensor.counts_per_turn is not None
            ):
                sizes[i] = abs(self._factors[i]) * sensor.counts_per_turn
        for name, turn in asked.items():
            at = self._index(name)
            if self._sensors[at].measures != "position":
                raise EstimationError(f"turns: '{name}' is no position; only these wrap")
            if not isinstance(turn, (int, float)) or not 0.0 <= turn < 1e9:
                raise EstimationError(
                    f"turns: '{name}' needs the log's number of one turn, {turn!r} came"
                )
            sizes[at] = abs(self._factors[at]) * turn if turn else inf
        return sizes

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
        sample: Floats = logged * self._factors
        wild = np.abs(sample) > LARGEST_READING
        if wild.any():
            at = int(np.argmax(wild))
            raise EstimationError(f"'{self.columns[at]}' cannot be {logged[at]:g}")
        doubts = list[str]()
        for i in np.flatnonzero(np.isfinite(self._turns) & np.isfinite(sample)).tolist():
            sample[i] = self._unwrapped(i, time, float(sample[i]), doubts)
        self._doubts = tuple(doubts)
        before = self._ahead.copy()
        for i in self._counted:
            is_known = isfinite(self._last[i])
            sample[i] = self._counted_anew(i, time, float(sample[i]))
            before[i] = before[i] if is_known else self._ahead[i]
        anew = np.flatnonzero(self._ahead[self._counted] != before[self._counted])
        self._restarts = tuple(self._sensors[self._counted[k]].of for k in anew)
        for name, temperature in (temperatures or {}).items():
            _check_temperature(name, temperature)
            for i in self._torques_of(name):
                sample[i] *= 1.0 + self._slope * (temperature - REFERENCE)
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

    def _unwrapped(self, i: int, time: float, position: float, doubts: list[str]) -> float:
        """Return a position [rad, m] in the turn in which the motor is; a doubt is appended to
        `doubts`.
        """
        turn = float(self._turns[i])
        last = float(self._last[i])
        gap = time - float(self._seen[i])
        near = position + turn * round((last - position) / turn) if isfinite(last) else nan
        if not isfinite(last) or self._fastest[i] * gap >= turn / 2:
            turns = self._possible(i, position, position)
            if len(turns) == 1:
                near = position + turn * turns[0]
                self._guessed.pop(i, None)
            else:
                if not isfinite(last):
                    near = position if not turns else position + turn * turns[len(turns) // 2]
                    since = "its turn is not known: it counts within one only"
                else:
                    since = f"may have turned without a value for {gap:.2g} s"
                if isfinite(last) or turns:
                    doubts.append(f"{self.columns[i]} {since}")
                    self._guessed[i] = near, near
        if i in self._guessed:
            near += self._settled(i, near)
        self._last[i] = near
        self._seen[i] = time
        self._ahead[i] = near - position
        return near

    def _possible(self, i: int, least: float, most: float) -> range:
        """Return the numbers of turns by which positions from `least` to `most` may be off, so that
        all are within the range.
        """
        turn = float(self._turns[i])
        (low, high) = self._ranges[i]
        if not isfinite(low):
            return range(0)
        return range(ceil((low - least) / turn), floor((high - most) / turn) + 1)

    def _settled(self, i: int, position: float) -> float:
        """Return the correction of a guessed turn [rad, m] if only one turn is possible, else 0."""
        least, most = self._guessed[i]
        least = min(least, position)
        most = max(most, position)
        self._guessed[i] = least, most
        turns = self._possible(i, least, most)
        if len(turns) != 1:
            return 0.0
        del self._guessed[i]
        return float(self._turns[i]) * turns[0]

    def _counted_anew(self, i: int, time: float, position: float) -> float:
        """Return the position [rad] of a motor that counts its turns, in the turn that its joint's
        range allows.

        The turn changes only where a position jumps, out of range, after a silence (a restart). Out
        of range without a jump, a tendon broke or a spool slipped.
        """
        if not isfinite(position):
            return position
        low, high = self._ranges[i]
        at = position + float(self._ahead[i])
        jumped = not abs(at - float(self._last[i])) < TURN / 2
        was_silent = not time - float(self._seen[i]) < BOOTS
        if jumped and was_silent and not low <= at <= high:
            ahead = TURN * round(((low + high) / 2 - position) / TURN)
            if low <= position + ahead <= high:
                self._ahead[i] = ahead
        self._last[i] = position + float(self._ahead[i])
        self._seen[i] = time
        return float(self._last[i])

    def logged(self, channel: str, value: float) -> float:
        """Return the logged number for a channel's value in SI, in the current turn of its encoder,
        such as a goal for a motor.
        """
        i = self._index(channel)
        return (value - float(self._ahead[i])) / float(self._factors[i])

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


class LiveInLogUnits:
    """A `LiveEstimator` that takes logged values and returns angles in a chosen unit.

    A sample raises an error only for an unknown name, for a value that is no number, or for one
    that no sensor reaches; else see `Monitor`. Where an encoder may have turned without a value,
    the estimator begins anew with half of the joints' largest range as standard deviation.

    Args:
        rig: the description, or a shipped rig's name, or a path.
        unit: of `angles` and `stds`.
        turns: see `LogUnits`.
        compiled: compile the kernel where possible.
    """

    def __init__(
        self,
        rig: Rig | str | Path,
        unit: Literal["deg", "rad"] = "deg",
        turns: Mapping[str, float] | None = None,
        compiled: bool = True,
    ) -> None:
        if unit not in ("deg", "rad"):
            raise EstimationError(f"angles are in deg or rad, {unit!r} came")
        self._live = LiveEstimator(rig, compiled=compiled)
        self._monitor = Monitor(self._live)
        self._units = LogUnits(self._live.rig, self._live.channels, turns)
        self._scale = degrees(1.0) if unit == "deg" else 1.0
        self._joints = tuple(self._live.rig.joint_names)
        self._reading: Reading | None = None

    def __copy__(self) -> LiveInLogUnits:
        """Return a copy that goes on independently; arrays are never shared."""
        return deepcopy(self)

    @property
    def rig(self) -> Rig:
        """The description of the rig that the estimator runs on."""
        return self._live.rig

    @property
    def live(self) -> LiveEstimator:
        """The estimator that takes in the converted samples."""
        return self._live

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the logged columns of a sample, in order."""
        return self._units.columns

    @property
    def reading(self) -> Reading | None:
        """The last reading, in SI, with its health; None before the first sample."""
        return self._reading

    def step(
        self, time: float, values: Values, temperatures: Mapping[str, float] | None = None
    ) -> dict[str, float]:
        """Take in logged values and return joint → angle in the chosen unit, NaN where the sample
        was skipped.

        Args:
            time: stamp [s].
            values: by column or sensor, or in the order of `columns`; missing ones are NaN, None or
                left out.
            temperatures: motor → its temperature [°C].

        Raises:
            EstimationError: a value is no number or is beyond all sensors, or a name is unknown.
        """
        sample = self._units.sample(time, values, temperatures)
        if self._units.doubts and self._live.samples:
            low, high = np.array([joint.travel for joint in self.rig.joints]).T
            self._live.reset(
                np.clip(self._live.angles, low, high).tolist(), float(np.max(high - low)) / 2
            )
        reading = self._monitor.take(time, sample)
        if self._units.doubts:
            reading = replace(reading, health="restarted", detail=", ".join(self._units.doubts))
        self._reading = reading
        return self.angles

    @property
    def angles(self) -> dict[str, float]:
        """Joint → angle of the last reading, in the chosen unit."""
        values = (nan,) * len(self._joints) if self._reading is None else self._reading.angles
        return {name: self._scale * value for name, value in zip(self._joints, values)}

    @property
    def stds(self) -> dict[str, float]:
        """Joint → standard deviation of the error of its last angle, in the chosen unit."""
        values = (nan,) * len(self._joints) if self._reading is None else self._reading.angle_stds
        return {name: self._scale * value for name, value in zip(self._joints, values)}

    def reset(self) -> None:
        """Forget everything: the next sample is the first."""
        self._units.reset()
        self._monitor.reset()
        self._reading = None


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


def _check_temperature(motor: str, temperature: object) -> None:
    if (
        not isinstance(temperature, (int, float, np.number))
        or not abs(float(temperature)) <= HOTTEST
    ):
        raise EstimationError(f"temperatures: '{motor}' cannot have {temperature!r} °C")


def _fastest(rig: Rig, sensor: Sensor) -> float:
    """Return the largest speed at which a sensor's drive moves [rad/s, m/s]."""
    drive = next((drive for drive in rig.drives if drive.name == sensor.of), None)
    if drive is None or drive.servo is None or drive.servo.fastest is None:
        return FASTEST
    return drive.servo.fastest
