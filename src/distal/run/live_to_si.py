"""Logged values, such as counts, milliamperes or degrees, as samples in SI, live."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf, nan
from pathlib import Path

import numpy as np

from distal.arrays import Floats
from distal.errors import EstimationError, did_you_mean
from distal.estimators import channels_of
from distal.logs import LARGEST_READING, RawToSI, Remark
from distal.rig import Rig, as_rig, log_factor

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
        temperature_slope: relative change of torque constants with temperature [1/K], used where
            `sample` is given temperatures.
        ranged: whether the ranges of the joints say in which turn a motor is; before a power-on
            routine they do not.
        doubting: whether readings that may be old are missing, see `RawToSI`.
    """

    def __init__(
        self,
        rig: Rig | str | Path,
        channels: Sequence[str] | None = None,
        temperature_slope: float = TEMPERATURE_SLOPE,
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
        self._slope = temperature_slope
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
        other = LogUnits(
            rig, self.channels, temperature_slope=self._slope, doubting=self._ways["doubting"]
        )
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


def _check_temperature(motor: str, temperature: object) -> None:
    if (
        not isinstance(temperature, (int, float, np.number))
        or not abs(float(temperature)) <= HOTTEST
    ):
        raise EstimationError(f"temperatures: '{motor}' cannot have {temperature!r} °C")
