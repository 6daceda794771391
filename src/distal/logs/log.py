"""A log: time and sensor readings in SI, in which NaN is a missing reading.

A joint's angle may come late: a camera's frame is old when it is stamped, and a slow sensor's
sample stays in the log until its next one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from math import log10
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.errors import LogError
from distal.rig import Rig, angle_names, torque_names
from distal.units import unit_factor


def sealed(array: Floats) -> Floats:
    """Make an array read-only and return it; no copy is made, so no other code may write to it."""
    array.flags.writeable = False
    return array


def frozen(values: object) -> Floats:
    """Return the values as a read-only float64 array, which is a copy unless they were one
    already.
    """
    if isinstance(values, np.ndarray) and values.dtype == np.float64 and not values.flags.writeable:
        return values
    return sealed(np.array(values, dtype=np.float64))


LARGEST_READING = 1e7
"""Largest magnitude that a real reading can have [m, N, rad, N m]; larger readings are wild values.
Source: judgement.
"""


class TruthKind(Enum):
    """The kind of source that a log's truth has."""

    SENSOR = "sensor"
    """The truth is read by the rig's own reference sensors."""

    HOME = "home"
    """The truth is the known angles of the joints while homing; it counts as readings, see
    `distal.homing`.
    """

    OTHER = "other"
    """The truth is neither, such as a column of the log, a file beside it, or a simulation's."""

    @property
    def by_sensor(self) -> bool:
        """Whether the truth of this kind is read by sensors of the rig, with their errors."""
        return self in (TruthKind.SENSOR, TruthKind.HOME)


@dataclass(frozen=True)
class TruthSource:
    """Where a log's truth comes from; `position` names the column, file or mark, for people."""

    kind: TruthKind = TruthKind.OTHER
    position: str = ""

    def __str__(self) -> str:
        """Return the source in words."""
        parts = (self.position, "the reference sensor" if self.kind.by_sensor else "")
        return ", ".join(filter(None, parts))


NO_SOURCE = TruthSource()
"""The source of a truth that is not there, or whose source was not given."""

FROM_SENSOR = TruthSource(TruthKind.SENSOR)
"""The source of a truth that the rig's own reference sensor reads."""


@dataclass(frozen=True)
class Log:
    """Sensor readings over time, in SI, with the truth where it is known.

    Args:
        time: stamps [s], rising, (n,).
        channels: sensor name → readings, (n,) each; NaN = missing.
        truth: name → true values, (n,) each: joint angles [rad] and, from a simulation, its other
            quantities.
        source: what the log is called in messages.
        truth_source: where the truth comes from.
        stamps: original stamps since 1970 [ns], (n,), of a log that has dates; `time` then counts
            from the log's start.
        goals: drive → position to which it was sent [m, rad], (n,) each, as its position sensor
            reads it.

    Raises:
        LogError: lengths differ, or a stamp is not finite, repeats or goes back.
    """

    time: Floats
    channels: Mapping[str, Floats]
    truth: Mapping[str, Floats] = field(default_factory=dict)
    source: str = "log"
    truth_source: TruthSource = NO_SOURCE
    stamps: NDArray[np.int64] | None = None
    goals: Mapping[str, Floats] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Freeze the arrays and check the stamps."""
        object.__setattr__(self, "time", frozen(self.time))
        for name in ("channels", "truth", "goals"):
            columns = {key: frozen(values) for key, values in getattr(self, name).items()}
            object.__setattr__(self, name, MappingProxyType(columns))
        if self.time.ndim != 1:
            raise LogError(f"{self.source}: time must be one column, shape {self.time.shape} came")
        check_stamps(self.time, self.source)
        every: dict[str, NDArray[np.generic]] = {**self.channels, **self.truth, **self.goals}
        if self.stamps is not None:
            stamps = np.array(self.stamps, dtype=np.int64)
            stamps.flags.writeable = False
            object.__setattr__(self, "stamps", stamps)
            every["stamps"] = stamps
        for key, values in every.items():
            if values.shape != self.time.shape:
                raise LogError(
                    f"{self.source}: '{key}' has shape {values.shape}, time has {self.time.shape}"
                )

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        """Return the log's name, length, rate and columns in a few words."""
        span = ""
        if len(self) > 1:
            span = f", {self.time[0]:g} to {self.time[-1]:g} s, {self.rate:.4g} Hz"
        truth = f"; truth: {', '.join(self.truth)}" if self.truth else ""
        return f"Log {self.source}: {len(self)} samples{span}; {', '.join(self.channels)}{truth}"

    @property
    def truth_kind(self) -> TruthKind:
        """The kind of source that the log's truth has."""
        return self.truth_source.kind

    @property
    def rate(self) -> float:
        """Samples per second, the inverse of the median interval; NaN for fewer than two
        samples.
        """
        return float(1.0 / np.median(np.diff(self.time))) if len(self) > 1 else float("nan")

    def gaps(self) -> list[tuple[float, float]]:
        """Return start and end [s] of the intervals that are longer than one and a half
        usual ones.
        """
        steps = np.diff(self.time)
        long = np.flatnonzero(steps > ONE_STEP / self.rate)
        return [(float(self.time[i]), float(self.time[i + 1])) for i in long]

    def select(self, rows: slice | NDArray[np.intp] | Bools) -> Log:
        """Return the log of some of its rows: a slice, indices or a mask, in rising order."""

        def chosen(columns: Mapping[str, Floats]) -> dict[str, Floats]:
            return {name: values[rows] for name, values in columns.items()}

        return replace(
            self,
            time=self.time[rows],
            channels=chosen(self.channels),
            truth=chosen(self.truth),
            stamps=None if self.stamps is None else self.stamps[rows],
            goals=chosen(self.goals),
        )

    def columns(self) -> dict[str, Floats]:
        """Return the columns by name, in SI: time as ``t``, channels, and truth with ``true_``
        before its names.
        """
        return {
            "t": self.time,
            **self.channels,
            **{f"true_{name}": values for name, values in self.truth.items()},
        }


def check_stamps(time: Floats, source: str, rows: NDArray[np.intp] | None = None) -> None:
    """Raise a `LogError` where a stamp of `time` [s], (n,), is not finite, repeats or goes back.

    Args:
        source: what the log is called in messages.
        rows: number of each stamp's row in its file; without it, the message counts samples from 0.
    """
    position = "sample" if rows is None else "row"
    at = np.arange(len(time)) if rows is None else rows
    bad = np.flatnonzero(~np.isfinite(time))
    if len(bad):
        raise LogError(
            f"{source}: {position} {at[bad[0]]}: time is {time[bad[0]]}; a finite number is needed"
        )
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        i = int(back[0]) + 1
        fault = "goes back"
        remedy = "leave out what is out of order"
        if time[i] == time[i - 1]:
            fault = "repeats"
            remedy = "--set 'log.time.repeated=\"last\"' keeps the last of them"
        raise LogError(
            f"{source}: {position} {at[i]}: time {fault} ({time[i]:.15g} s after "
            f"{time[i - 1]:.15g} s); {remedy}"
        )


def true_angles(log: Log, joints: Sequence[str]) -> Floats | None:
    """Return the joints' true angles [rad], read-only, (n, n_joints), or None where none is known.

    Angles that are not known are NaN.

    Args:
        joints: names of the joints.
    """
    return _columns(log, angle_names(joints))


def true_torques(log: Log, joints: Sequence[str]) -> Floats | None:
    """Return the true external torques on the joints [N m], (n, n_joints), in the form of
    `true_angles`.
    """
    return _columns(log, torque_names(joints))


def _columns(log: Log, names: Sequence[str]) -> Floats | None:
    if not any(name in log.truth for name in names):
        return None
    unknown = np.full(len(log), np.nan)
    return sealed(np.column_stack([log.truth.get(name, unknown) for name in names]))


BRIDGED = 2.5
"""Gap of a reference that is interpolated, in its usual intervals [1]. Source: judgement."""

SAME = 1e-9
"""Values that differ by less than this share of their range are one value [1]. Source: rounding."""

ONE_STEP = 1.5
"""Steps of a resolution, above which a change is more than one of them [1]. Source: definition
(the middle between one and two).
"""


@np.errstate(over="ignore", invalid="ignore")
def held_samples(values: Floats) -> Bools:
    """Return which values of a reference, (k,), only repeat a sample that was held until the next
    one; none where the sensor rounds.

    A value that is rounded also repeats, but then goes on by one step of its resolution; or by
    noise, about half as often as it changes by one step. What follows a sample that was held is
    farther away, and changes of one step are rare.
    """
    present = np.flatnonzero(np.isfinite(values))
    repeats = np.zeros(len(values), dtype=bool)
    if len(present) < 3 or np.ptp(values[present]) == 0.0:
        return repeats
    steps = np.abs(np.diff(values[present])) / np.ptp(values[present])
    steps[steps < SAME] = 0.0
    after_repeat = steps[1:][(steps[:-1] == 0.0) & (steps[1:] > 0.0)]
    more = ONE_STEP * np.min(steps[steps > 0.0])
    by_one = np.count_nonzero((steps > 0.0) & (steps < more))
    is_held = len(after_repeat) > 0 and np.median(after_repeat) > more
    if is_held and np.count_nonzero(steps == 0.0) > by_one:
        repeats[present[1:][steps == 0.0]] = True
    return repeats


def earlier(time: Floats, values: Floats, lag: float) -> Floats:
    """Return the values that a reference which is late by a `lag` [s] had at some times, NaN in
    gaps, beyond their ends, and wherever it has no sample of its own.

    Args:
        time: stamps [s], (k,).
        values: as they were read, (k,).
        lag: negative where the reference is early.
    """
    seen = np.isfinite(values)
    finite = np.flatnonzero(seen)
    if len(finite) < 2 or lag == 0.0:
        return values
    stamps = time[finite]
    at = time + lag
    moved = np.interp(at, stamps, values[finite])
    after = np.clip(np.searchsorted(stamps, at), 1, len(finite) - 1)
    gap = stamps[after] - stamps[after - 1] > BRIDGED * np.median(np.diff(stamps))
    outside = (at < stamps[0]) | (at > stamps[-1])
    # only as often as the reference has values: between them nothing new is known
    return np.where(gap | outside | ~seen, np.nan, moved)


JUMPS = 4.0
"""Ratio of a jump to the steps beside it, and to the step above which 2 % of all are [1]. Source:
judgement.
"""

LONGEST_AWAY = 0.02
"""Share of a log's samples for which a reference is away at the most [1]. Source: judgement."""


@np.errstate(over="ignore", invalid="ignore")
def jumps_away(values: Floats) -> Bools:
    """Return which values of a reference, (k,), are between a jump and the jump back, as of a
    marker that is seen the wrong way round for some frames.
    """
    away = np.zeros(len(values), dtype=bool)
    present = np.flatnonzero(np.isfinite(values))
    if len(present) < 3:
        return away
    steps = np.diff(values[present])
    moving = np.abs(steps[steps != 0.0])
    if not len(moving):
        return away
    jump = np.flatnonzero(np.abs(steps) > JUMPS * np.quantile(moving, 0.98))
    longest = max(2.0, LONGEST_AWAY * len(present))
    at = 0
    while at < len(jump) - 1:
        begin, end = jump[at], jump[at + 1]
        least = min(abs(steps[begin]), abs(steps[end]))
        # a joint that is so fast is fast before and after too
        beside = [*steps[max(begin - 1, 0) : begin], *steps[end + 1 : end + 2]]
        is_slow_beside = JUMPS * np.abs(beside).max(initial=0.0) < least
        is_back = abs(steps[begin] + steps[end]) < least / 2.0 and is_slow_beside
        if end - begin <= longest and is_back:
            away[present[begin + 1 : end + 1]] = True
            at += 1
        at += 1
    return away


@np.errstate(over="ignore", invalid="ignore")
def said_of_jumps(values: Floats, away: Bools) -> str:
    """Return in words how often a reference jumps away, and whether to its mirror image.

    Args:
        values: as they were read, (k,).
        away: which of them are away, see `jumps_away`, (k,).
    """
    first = np.flatnonzero(away & np.diff(away, prepend=False))
    before = values[np.maximum(first - 1, 0)]
    mirrored = np.abs(values[first] + before) < 0.2 * np.abs(values[first] - before)
    how = ", to its mirror image" if np.mean(mirrored) > 0.5 else ""
    return (
        f"jumps away and back {len(first)} times{how} ({int(away.sum())} samples): taken as missing"
    )


def check_unit(time: Floats, rig: Rig, source: str) -> None:
    """Raise a `LogError` where stamps are so far apart, or so near, that their unit is another.

    Args:
        time: stamps [s], (k,).
        rig: whose sensors say how far apart they usually are.
        source: what the log is called in messages.
    """
    rate = max((sensor.rate for sensor in rig.sensors), default=0.0)
    step = float(np.median(np.diff(time)))
    if rate == 0.0 or 1.0 / WRONG_UNIT < step * rate < WRONG_UNIT:
        return
    now = unit_factor(rig.log.time.unit, "s")
    factors = {unit: unit_factor(unit, "s") / now for unit in ("us", "ms", "s", "min", "h", "day")}
    unit = min(factors, key=lambda unit: abs(log10(step * rate * factors[unit])))
    raise LogError(
        f"{source}: the stamps are {step:.3g} s apart, and the rig's sensors give a value every "
        f"{1 / rate:.3g} s. In which unit is the time? --set 'log.time.unit=\"{unit}\"' fits best; "
        "or set the sensors' rate to the log's"
    )


WRONG_UNIT = 1000.0 / 3.0
"""Ratio of two intervals from which on one of them has another unit [1]: a thousand, of sensors
whose rate is up to three times another. Source: judgement.
"""
