"""The door of readings: logged numbers as samples in SI, one after the other, without what
registers, encoders and drivers did to them.

Logs, streams and hands pass through the same door, sample by sample, so that a log gives what its
stream gave.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, exp, floor, inf, isfinite, log, log1p, nan, pi, sqrt
from typing import Literal

import numpy as np

from distal.arrays import Floats
from distal.logs.log import LARGEST_READING
from distal.rig import REFERENCES, Rig, Sensor, drive_travel, motor_range
from distal.rig.sensors.motions import AngleSensor

Kind = Literal["turn", "unknown turn", "restarted", "decoded", "left out", "jumped", "repeated"]
"""What the door did with a reading: its turn may be another one, or is a guess; it counts from
another turn than before; its register was decoded; it is missing since it may be a wrong one; it
jumped and stays there; it is missing since it repeats the last one.
"""

TURN = 2 * pi
"""One turn of a motor that is read in radians or degrees [rad]. Source: definition (full angle)."""

FASTEST = 10.0
"""Largest speed of a motor whose rig does not give one (`servo.fastest`) [rad/s, m/s]. Source:
judgement.
"""

CROSSING = 0.1
"""Shortest time in which a drive crosses its range, where its rig gives no speed [s]. Source:
judgement (a finger's joint at 1000 °/s).
"""

BOOTS = 0.05
"""Shortest time in which a motor restarts and answers again [s]; a position that jumps sooner is a
wrong reading. Source: judgement.
"""

IMPROBABLE = 1e-6
"""Probability of a repetition by chance, below which readings are old ones; of a register that is
read as another, before a log is seen. Source: definition (level of the test).
"""

FINE = 0.02
"""Probability of a repetition at rest below which a reading alone counts as old: its noise is 14
steps wide [1]. Source: judgement.
"""

WHITE = 1.5
"""Ratio of mean third to mean second differences above which a reading has noise of its own: it is
√(20/6) for white noise, far less for smooth motion [1]. Source: judgement (between the two).
"""

UNUSUAL = 5.0
"""Motion in two samples, by its median, above which a reading is not believed at once [1]. Source:
judgement.
"""

RARE = 0.05
"""Weight of a sample in the means that the door follows [1]. Source: judgement."""

OFTEN = 0.2
"""Share of readings that were left out, above which the others are not believed either [1]. Source:
judgement.
"""

RATE = 0.3
"""Relative change of that median with a sample [1]. Source: judgement."""

REGISTERS = ((15, True), (31, True), (10, False), (15, False), (31, False))
"""Bit of the sign, and whether below zero counts in two's complement (else the sign is a flag), of
registers that were read as numbers without a sign. Source: definition (16 and 32 bits; bits 10 and
15 of load and position in servos' memory tables).
"""


SENTENCES: dict[Kind, str] = {
    "turn": "{} may have turned without a value for {:.2g} s",
    "unknown turn": "{}: its turn is not known, it counts within one only",
    "restarted": "{} counts from another turn: taken back",
    "decoded": "{} holds negative numbers that were read without a sign: decoded",
    "left out": "{} is where its drive cannot be so soon: left out",
    "jumped": "{} jumped faster than its drive can: did its zero change?",
    "repeated": "{} repeats exactly what it read before: taken as missing",
}
"""What was done with a reading, in words."""


@dataclass(frozen=True)
class Remark:
    """What the door did with a reading.

    Args:
        kind: see `Kind`.
        sensor: name of the sensor; empty for all of them.
        size: for how long the motor was silent [s], for a turn; else 0.
    """

    kind: Kind
    sensor: str
    size: float = 0.0

    @property
    def text(self) -> str:
        """What was done, in words."""
        name = f"'{self.sensor}'" if self.sensor else "every sensor"
        return SENTENCES[self.kind].format(name, self.size)


class Door:
    """Turns logged numbers into samples in SI.

    * Registers that hold a sign (`REGISTERS`), read as numbers without a sign, are decoded, since
      their steps are then far more probable.
    * An encoder that wraps is followed beyond its turn: of all positions that its reading may mean,
      the one nearest to the last is taken. At the first value, and after a silence in which it may
      have gone half a turn, it is the only one in the range of its joint; if there are several,
      `in_doubt` says so until motion has decided.
    * A motor that counts its turns may count from another one after a restart; it is then set to
      the turn that its joint's range allows.
    * A position that a drive cannot have reached is missing until the next sample confirms it. Of
      two sources in turn none is believed.
    * A reading that repeats exactly, although it has noise of its own, is missing, as old as it is.

    Args:
        rig: the description.
        sensors: in the order of a sample.
        factors: from logged numbers to SI, with the sensor's sign, (n,).
        turns: index → the logged number of one turn, at which it wraps, 0 for one that does not.
        ranged: whether the ranges of the joints say in which turn a motor is; before a power-on
            routine they do not.
        doubting: whether readings that may be wrong or old are missing; what moves motors looks at
            them itself.
    """

    def __init__(
        self,
        rig: Rig,
        sensors: Sequence[Sensor],
        factors: Floats,
        turns: Mapping[int, float] | None = None,
        *,
        ranged: bool = True,
        doubting: bool = True,
    ) -> None:
        self._sensors = tuple(sensors)
        self._factors = [float(factor) for factor in factors]
        sizes = turns or {}
        self._registers = [_Register() for _ in sensors]
        self._noises = [_Noise() for _ in sensors]
        self._doubting = doubting
        self._moving = [i for i, sensor in enumerate(sensors) if sensor.measures not in REFERENCES]
        self._encoders = {
            i: _encoder(rig, sensor, self._factors[i], sizes.get(i), ranged, doubting)
            for i, sensor in enumerate(sensors)
            if sensor.measures in ("position", "angle")
        }
        self._remarks: tuple[Remark, ...] = ()

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What was done with the readings of the last sample."""
        return self._remarks

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors of a sample."""
        return tuple(sensor.name for sensor in self._sensors)

    @property
    def in_doubt(self) -> tuple[str, ...]:
        """Drives that may be in several turns."""
        return tuple(self._sensors[i].of for i, each in self._encoders.items() if each.in_doubt)

    def ahead(self, i: int) -> float:
        """Return how much a channel's position is ahead of its reading, whole turns [SI]."""
        return self._encoders[i].ahead if i in self._encoders else 0.0

    def follow(self, other: Door) -> None:
        """Go on in the turns in which encoders of another door that wrap are now."""
        for i, encoder in self._encoders.items():
            encoder.follow(other._encoders[i])

    def take(self, time: float, logged: Sequence[float]) -> Floats:
        """Return a sample in SI, (n,), NaN where a value is missing.

        Args:
            time: stamp [s].
            logged: numbers, NaN where missing, (n,).
        """
        remarks = list[Remark]()
        sample = np.full(len(self._sensors), nan)
        old = self._old(logged, remarks) if self._doubting else [False] * len(logged)
        for i, number in enumerate(logged):
            if number != number or old[i]:
                continue
            if not abs(number * self._factors[i]) <= LARGEST_READING:
                sample[i] = number * self._factors[i]  # the estimator takes it as missing
                continue
            register = self._registers[i]
            value = register.decoded(number) * self._factors[i]
            if register.bit:
                remarks.append(Remark("decoded", self._sensors[i].name))
            encoder = self._encoders.get(i)
            if encoder is not None:
                value, kind, size = encoder.take(time, value)
                if kind is not None:
                    remarks.append(Remark(kind, self._sensors[i].name, size))
            if value == value:
                # in logged numbers, without the rounding of whole turns
                self._noises[i].learn(round(value / self._factors[i], 9))
            sample[i] = value
        self._remarks = tuple(remarks)
        return sample

    def _old(self, logged: Sequence[float], remarks: list[Remark]) -> list[bool]:
        """Return which readings are old ones: alone, or all together, they repeat more often than
        chance lets them.
        """
        runs = {
            i: self._noises[i].repeats(logged[i]) for i in self._moving if logged[i] == logged[i]
        }
        old = [False] * len(self._sensors)
        if not any(runs.values()):
            return old
        chances = {i: self._noises[i].chance for i in runs}
        if min(runs.values()) * sum(chances.values()) < log(IMPROBABLE):
            remarks.append(Remark("repeated", ""))
            for i in runs:
                old[i] = True
            return old
        for i, run in runs.items():
            # alone, a reading with few steps may as well be at rest
            if self._noises[i].is_fine and run * chances[i] < log(IMPROBABLE):
                remarks.append(Remark("repeated", self._sensors[i].name))
                old[i] = True
        return old


class _Register:
    """What a number means that may come from a register with a sign: the hypothesis under which its
    steps are most probable (Cauchy distribution, as wide as they usually are).
    """

    def __init__(self) -> None:
        self.bit = 0
        self._whole = True
        self._before: list[float] | None = None
        self._evidence = [0.0] * len(REGISTERS)
        self._step = 1.0

    def decoded(self, number: float) -> float:
        """Return the number that a register holds."""
        self.bit = 0
        if not self._whole or number != floor(number) or not 0.0 <= number < 2.0**32:
            self._whole = self._whole and number == floor(number) and number >= 0.0
            return number
        meanings = [_meaning(number, *register) for register in REGISTERS]
        # before anything is known, small numbers are the most probable
        scale = self._step if self._before is not None else 2.0 ** REGISTERS[2][0]
        was = self._before or [0.0] * (1 + len(REGISTERS))
        plain = _unlikely(number - was[-1], scale)
        for k, meaning in enumerate(meanings):
            gain = -2.0 * plain if meaning is None else plain - _unlikely(meaning - was[k], scale)
            most = -2.0 * log(IMPROBABLE)
            self._evidence[k] = min(max(self._evidence[k] + gain, -most), most)
        best = max(range(len(REGISTERS)), key=self._evidence.__getitem__)
        value = number
        meaning = meanings[best]
        before = was[-1]
        if self._evidence[best] > -0.5 * log(IMPROBABLE) and meaning is not None:
            value = meaning
            before = was[best]
            self.bit = REGISTERS[best][0]
        if self._before is not None:
            self._step += RARE * (max(abs(value - before), 1.0) - self._step)
        self._before = [number if m is None else m for m in meanings] + [number]
        return value


def _meaning(number: float, bit: int, complement: bool) -> float | None:
    """Return what a register with a sign means, None where it cannot hold the number."""
    if number >= 2.0 ** (bit + 1):
        return None
    if number < 2.0**bit:
        return number
    return number - 2.0 ** (bit + 1) if complement else 2.0**bit - number


def _unlikely(step: float, scale: float) -> float:
    return log1p((step / scale) ** 2)


class _Noise:
    """How improbable it is that a reading repeats exactly: by how often it has done so, and by its
    noise beside its smallest step, as at rest.
    """

    def __init__(self) -> None:
        self._last = nan
        self._run = 0
        self._repeated = 0
        self._changed = 0
        self._smallest = inf
        self._differences = (0.0, 0.0)
        self._sums = (0.0, 0.0)
        self._known = nan

    def repeats(self, number: float) -> int:
        """Take in a number, and return how often it has come again without a change."""
        if number == self._last:
            self._run += 1
            return self._run
        if self._run and self._run * self.chance >= log(IMPROBABLE):
            self._repeated += self._run
        self._run = 0
        self._last = number
        return 0

    def learn(self, number: float) -> None:
        """Learn from a number that is no wrong one."""
        if number == self._known:
            return
        difference = number - self._known
        self._known = number
        if difference != difference:
            return
        second = difference - self._differences[0]
        third = second - self._differences[1]
        self._differences = difference, second
        self._changed += 1
        self._smallest = min(self._smallest, abs(difference))
        if self._changed > 2:
            self._sums = self._sums[0] + abs(second), self._sums[1] + abs(third)

    @property
    def is_fine(self) -> bool:
        """Whether its noise is many steps wide, so that it cannot repeat at rest either."""
        return 0.0 < self._at_rest() < FINE

    @property
    def chance(self) -> float:
        """Logarithm of the probability that it repeats once more, the value being at rest."""
        at_rest = self._at_rest()
        if at_rest == 0.0:
            return 0.0
        often = (self._repeated + 1) / (self._repeated + self._changed + 2)
        return min(log(max(at_rest, often)), 0.0)

    def _at_rest(self) -> float:
        """Return the probability of a repetition by noise and smallest step; 0 where no noise is
        seen.
        """
        second, third = self._sums
        if self._changed < 4 or not third > WHITE * second:
            return 0.0
        # E|N(0, σ²)| = σ √(2/π), and second differences have the variance 6 σ²; rounding in motion
        # looks like noise of up to half a step
        seen = second / (self._changed - 2) * sqrt(pi / 2.0) / sqrt(6.0)
        noise = sqrt(max(seen**2 - self._smallest**2 / 4.0, 0.0))
        return self._smallest / (2.0 * sqrt(pi) * noise) if noise > 0.0 else 0.0


@dataclass(frozen=True)
class _Limits:
    """What is known of an encoder: one turn [SI], infinite where there is none; whether it counts
    within a turn only; the range of its position; the largest speed of its motor, and that of a
    reading that is believed at once; its usual interval [s]; and room for its noise.
    """

    turn: float
    wraps: bool
    low: float
    high: float
    fastest: float
    believed: float
    interval: float
    noise: float


class _Encoder:
    """A position that may wrap, restart or jump."""

    def __init__(self, limits: _Limits) -> None:
        self._limits = limits
        self.ahead = 0.0
        self._last = self._seen = nan
        self._speed = self._left_out = 0.0
        self._changed = -inf
        # least and largest reading so far, and those of a position whose turn is a guess
        self._read = (inf, -inf)
        self._guessed: tuple[float, float] | None = None
        # what the last sample was, where a drive cannot have reached it
        self._waiting: float | None = None
        # by the median of the motion in two samples more is believed, never less
        self._least = max(limits.noise, 1e-3 * limits.believed * limits.interval) / UNUSUAL
        self._before = (nan, nan)
        self._usual = self._least

    @property
    def in_doubt(self) -> bool:
        """Whether the encoder may be in several turns."""
        return self._guessed is not None

    def follow(self, other: _Encoder) -> None:
        """Go on in the turn in which another encoder is."""
        self._last = other._last
        self._seen = other._seen
        if self._limits.wraps:
            self.ahead = other.ahead

    def take(self, time: float, reading: float) -> tuple[float, Kind | None, float]:
        """Return the position of a reading [SI], and what was done, with its size."""
        gap = time - self._seen
        if not isfinite(self._last):
            gap = inf
        elif not gap > 0.0:
            gap = self._limits.interval  # the clock was set back, or the stamp is none
        limits = self._limits
        # of what was read bit by bit: a wrong reading does not make a counter of it
        within = self._read[1] - self._read[0] < limits.turn
        if limits.wraps and within:
            position, kind = self._within_turn(reading, gap)
        else:
            position, kind = self._counted(reading, gap)
        self._learn(position)
        if limits.wraps and within and 4.0 * self._usual > limits.turn:
            return nan, "turn", gap  # it goes on too fast to be followed
        size = gap if kind == "turn" else 0.0
        if self._reached(position, time, gap):
            self._speed = (position - self._last) / gap if isfinite(gap) else 0.0
        else:
            waiting = self._waiting
            self._waiting = position
            if waiting is None or not self._near(position - waiting, self._limits.interval):
                self._left_out += RARE * (1.0 - self._left_out)
                return nan, "left out", 0.0
            kind = kind or "jumped"
            self._speed = 0.0
        self._waiting = None
        least, most = self._read
        room = limits.turn / 4.0
        if not isfinite(least) or least - room <= reading <= most + room:
            self._read = min(least, reading), max(most, reading)
        if position != self._last:
            self._changed = time
        self._last = position
        self._seen = time
        self.ahead = position - reading
        self._left_out *= 1.0 - RARE
        if self._left_out > OFTEN:
            kind = kind or "left out"  # two sources in turn: nobody knows which is the drive
        return (nan if self._left_out > OFTEN else position), kind, size

    def _learn(self, position: float) -> None:
        """Follow the median of the motion in two samples, which two sources in turn do not show."""
        first, second = self._before
        self._before = second, position
        if isfinite(first):
            rate = RATE if abs(position - first) > self._usual else -RATE
            self._usual = max(self._usual * exp(rate), self._least)

    def _reached(self, position: float, time: float, gap: float) -> bool:
        """Return whether the drive can have gone there, since the reading last changed."""
        if not isfinite(self._last):
            return True
        step = position - self._last
        since = max(time - self._changed, gap)
        return self._near(step, since) or self._near(step - self._speed * gap, gap)

    def _near(self, step: float, gap: float) -> bool:
        limits = self._limits
        room = max(limits.noise, UNUSUAL * self._usual)
        return abs(step) <= limits.believed * (gap + limits.interval) + room

    def _within_turn(self, reading: float, gap: float) -> tuple[float, Kind | None]:
        """Return the position of an encoder that counts within one turn only."""
        turn = self._limits.turn
        is_known = isfinite(self._last)
        near = reading + turn * round((self._last - reading) / turn) if is_known else reading
        kind: Kind | None = None
        if not is_known or self._limits.fastest * gap >= turn / 2:
            turns = self._possible(reading, reading)
            if len(turns) == 1:
                near = reading + turn * turns[0]
                self._guessed = None
            else:
                if not is_known and turns and 0 not in turns:
                    near = reading + turn * turns[len(turns) // 2]
                if is_known or turns:
                    kind = "turn" if is_known else "unknown turn"
                    self._guessed = near, near
        if self._guessed is not None:
            least = min(self._guessed[0], near)
            most = max(self._guessed[1], near)
            self._guessed = least, most
            turns = self._possible(least, most)
            if len(turns) == 1:
                self._guessed = None
                near += turn * turns[0]
                self._last += turn * turns[0]
        return near, kind

    def _possible(self, least: float, most: float) -> range:
        """Return the numbers of turns by which positions from `least` to `most` may be off, so that
        all are within the range.
        """
        limits = self._limits
        if not isfinite(limits.low):
            return range(0)
        return range(
            ceil((limits.low - least) / limits.turn), floor((limits.high - most) / limits.turn) + 1
        )

    def _counted(self, reading: float, gap: float) -> tuple[float, Kind | None]:
        """Return the position of an encoder that counts its turns, or a wrapped one if all that it
        has read is within one turn.

        Out of range without a jump, a tendon broke or a spool slipped.
        """
        limits = self._limits
        position = reading + self.ahead
        if not isfinite(limits.turn) or abs(position - self._last) < limits.turn / 2:
            return position, None
        is_inside = limits.low <= position <= limits.high
        if isfinite(self._last):
            within = max(self._read[1], reading) - min(self._read[0], reading) < limits.turn
            near = reading + limits.turn * round((self._last - reading) / limits.turn)
            soon = limits.fastest * gap < limits.turn / 2
            if within and (soon or not is_inside) and limits.low <= near <= limits.high:
                return near, None
        if is_inside or gap < BOOTS or not limits.high - limits.low < limits.turn:
            return position, None
        middle = (limits.low + limits.high) / 2
        anew = reading + limits.turn * round((middle - reading) / limits.turn)
        if not limits.low <= anew <= limits.high:
            return position, None
        return anew, "restarted" if isfinite(self._last) and anew != position else None


def through(
    door: Door, time: Floats, logged: Floats, columns: Sequence[str]
) -> tuple[Floats, list[str]]:
    """Return the samples of a log [SI], (k, n), and a sentence on each thing that the door did.

    Args:
        time: stamps [s], (k,).
        logged: numbers, NaN where missing, (k, n).
        columns: names of the columns by the sensors' order, as the log has them.
    """
    samples = np.empty_like(logged)
    found = dict[Remark, list[float]]()
    for k, (stamp, numbers) in enumerate(zip(time.tolist(), logged.tolist())):
        samples[k] = door.take(stamp, numbers)
        for remark in door.remarks:
            # where a log begins it is taken as it is
            if remark.kind != "unknown turn":
                found.setdefault(replace(remark, size=0.0), []).append(stamp)
    column_of = dict(zip(door.sensors, columns))
    lines = [
        f"{replace(remark, sensor=column_of.get(remark.sensor, '')).text} ({len(times)} readings, "
        f"the first at {times[0]:g} s)"
        for remark, times in found.items()
    ]
    return samples, lines


def _encoder(
    rig: Rig, sensor: Sensor, factor: float, asked: float | None, ranged: bool, doubting: bool
) -> _Encoder:
    """Return what follows a sensor of a position or of a joint's angle."""
    counts = sensor.counts_per_turn if isinstance(sensor, AngleSensor) else None
    turn = TURN if isinstance(sensor, AngleSensor) else inf
    if counts is not None:
        turn = abs(factor) * counts
    wraps = counts is not None and sensor.measures == "position"
    if asked is not None:
        wraps = asked > 0.0
        turn = abs(factor) * asked if wraps else inf
    low, high = motor_range(rig, sensor) if ranged else (-inf, inf)
    drive = next((drive for drive in rig.drives if drive.name == sensor.of), None)
    servo = None if drive is None or drive.servo is None else drive.servo.fastest
    believed = inf
    if doubting and drive is not None and sensor.measures == "position":
        travel = motor_range(rig, sensor)
        if not isfinite(travel[0]):
            travel = drive_travel(rig, rig.drives.index(drive))
        believed = servo or (travel[1] - travel[0]) / CROSSING
    return _Encoder(
        _Limits(
            turn=turn,
            wraps=wraps,
            low=low,
            high=high,
            fastest=servo or FASTEST,
            believed=believed,
            interval=1.0 / sensor.rate,
            noise=10.0 * sensor.noise + sensor.resolution,
        )
    )
