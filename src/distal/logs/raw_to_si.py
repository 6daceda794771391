"""Raw readings to SI: logged numbers as samples in SI, one after the other, without what registers,
encoders and drivers did to them. What a reading is worth the filter knows.

An encoder may wrap, or count from another turn after a restart. Logs, streams and hands pass the
same conversion, sample by sample, so that a log gives what its stream gave.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import ceil, exp, floor, inf, isfinite, log, log1p, nan, pi, remainder, sqrt
from typing import Literal

import numpy as np

from distal.arrays import Floats
from distal.logs.log import LARGEST_READING, sealed
from distal.rig import REFERENCES, Rig, Sensor, motor_range
from distal.rig.sensors import AngleSensor

Kind = Literal["turn", "unknown turn", "restarted", "decoded", "repeated", "full"]
"""What was done with a reading: its turn may be another one, or is a guess; it counts from another
turn than before; its register was decoded; it is missing since it repeats the last one, or since it
is the end of a register.
"""

TURN = 2 * pi
"""One turn of a motor that is read in radians or degrees [rad]. Source: definition (full angle)."""

SMALLEST = 1e-9
"""Least room for a noise [m, rad]. Source: rounding (a product with zero stays zero)."""


@dataclass(frozen=True)
class Limits:
    """What is known of an encoder, and what its readings are judged by where nothing but judgement
    says how.

    Args:
        turn: one turn [SI]; infinite where there is none.
        wraps: whether it counts within a turn only.
        low: least position of its range [SI].
        high: largest position of its range [SI].
        begins: whether a log begins where its first reading is, in whichever turn that is.
        interval: its usual interval [s].
        fastest: largest speed of its motor, where its rig gives none (`servo.fastest`) [SI].
        boots: shortest time in which a motor restarts and answers again [s]; a position that jumps
            sooner is a wrong reading.
        unusual: ratio to what is usual above which a motion or an interval is not [1].
        rate: relative change of that median with a sample [1].
        rare: weight of a sample in the means that the conversion follows [1].
        often: share of readings beyond one turn, above which the encoder counts its turns [1].
    """

    turn: float
    wraps: bool
    low: float
    high: float
    begins: bool
    interval: float
    fastest: float = 10.0
    boots: float = 0.05
    unusual: float = 5.0
    rate: float = 0.3
    rare: float = 0.05
    often: float = 0.2


class Encoder:
    """A position that may wrap or restart."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self.ahead = 0.0
        # of that, what are turns of an encoder that seemed to wrap
        self._unwrapped = 0.0
        # whether the range holds in the turn in which the log begins
        self._is_ranged = True
        self._last = self._seen = nan
        # least and largest reading so far, the share of readings that are beyond them lately, and
        # the ends of a position whose turn is a guess
        self._read = (inf, -inf)
        self._beyond = 0.0
        self._guessed: tuple[float, float] | None = None
        # the last two positions; and the median of the motion in two samples, which two sources in
        # turn do not show
        self._before = (nan, nan)
        self._usual = SMALLEST

    @property
    def in_doubt(self) -> bool:
        """Whether the encoder may be in several turns."""
        return self._guessed is not None

    def follow(self, other: Encoder) -> None:
        """Go on in the turn in which another encoder is."""
        self._last = other._last
        self._seen = other._seen
        if self._limits.wraps:
            self.ahead = other.ahead

    def take(self, time: float, reading: float) -> tuple[float, Kind | None, float]:
        """Return the position of a reading [SI], and what was done, with its size (see `Remark`).

        Args:
            time: stamp [s].
            reading: what the encoder reads [SI].
        """
        gap = time - self._seen
        if not isfinite(self._last):
            gap = inf
        elif not gap > 0.0:
            gap = self._limits.interval  # the clock was set back, or the stamp is none
        limits = self._limits
        # of what was read bit by bit: a wrong reading does not make a counter of it
        within = self._is_within(*self._read)
        ahead = None
        kind: Kind | None = None
        if limits.high - limits.low < limits.turn:
            position, kind, ahead = self._in_range(reading, gap)
        elif limits.wraps and within:
            position, kind = self._within_turn(reading, gap)
        else:
            position = self._counted(reading, gap)
        self._learn(position)
        if limits.wraps and within and 4.0 * self._usual > limits.turn:
            return nan, "turn", gap  # it goes on too fast to be followed
        size = gap if kind == "turn" else 0.0
        if kind != "restarted" and isfinite(self._last):
            self._unwrapped += position - reading - self.ahead
        if ahead is None and within and self._counts(reading):
            position -= self._unwrapped  # no turn was gone that it did not count
        self._last = position
        self._seen = time
        self.ahead = position - reading if ahead is None else ahead
        return position, kind, size

    def _counts(self, reading: float) -> bool:
        """Return whether a reading shows that the encoder counts its turns: it is beyond one turn,
        near what was read, or the last of many.
        """
        least, most = self._read
        turn = self._limits.turn
        is_beyond = isfinite(least) and not least - turn / 4.0 <= reading <= most + turn / 4.0
        self._beyond += self._limits.rare * (is_beyond - self._beyond)
        if is_beyond and self._beyond <= self._limits.often:
            return False
        self._read = min(least, reading), max(most, reading)
        return not self._is_within(*self._read)

    def _is_within(self, least: float, most: float) -> bool:
        """Return whether readings are within one turn; rounded, both of its ends may be read, 0 and
        a turn or half a turn either way.
        """
        turn = self._limits.turn
        if most - least < turn:
            return True
        return most - least <= turn + SMALLEST and abs(remainder(least, turn / 2)) <= SMALLEST

    def _learn(self, position: float) -> None:
        """Follow the median of the motion in two samples."""
        first, second = self._before
        self._before = second, position
        if isfinite(first):
            rate = self._limits.rate if abs(position - first) > self._usual else -self._limits.rate
            self._usual = max(self._usual * exp(rate), SMALLEST)

    def _nearest(self, reading: float, to: float) -> float:
        """Return the position nearest to another one that a reading may mean [SI]; of no other, the
        reading.
        """
        turn = self._limits.turn
        return reading + turn * round((to - reading) / turn) if isfinite(to) else reading

    def _within_turn(self, reading: float, gap: float) -> tuple[float, Kind | None]:
        """Return the position of an encoder that counts within one turn only."""
        limits = self._limits
        turn = limits.turn
        has_last = isfinite(self._last)
        near = self._nearest(reading, self._last)
        kind: Kind | None = None
        # between two samples of the usual interval nobody can do better than the nearest turn
        silent = gap > limits.unusual * limits.interval and limits.fastest * gap >= turn / 2
        if not has_last or silent:
            turns = self._possible(reading, reading)
            if len(turns) == 1:
                near = reading + turn * turns[0]
                self._guessed = None
            else:
                if not has_last and turns and 0 not in turns:
                    near = reading + turn * turns[len(turns) // 2]
                if has_last or turns:
                    kind = "turn" if has_last else "unknown turn"
                    self._guessed = near, near
        if self._guessed is not None:
            least = min(self._guessed[0], near)
            most = max(self._guessed[1], near)
            self._guessed = least, most
            turns = self._possible(least, most)
            if len(turns) == 1:
                self._guessed = None
                ahead = turn * turns[0]
                near += ahead
                self._last += ahead
                self._before = self._before[0] + ahead, self._before[1] + ahead
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

    def _in_range(self, reading: float, gap: float) -> tuple[float, Kind | None, float]:
        """Return the position of an encoder whose range is less than a turn, what was done, and
        how much a goal is ahead of what the motor shall read: the turn nearest to the last one, and
        after a jump out of the range the one within it.

        Out of range without a jump, a tendon broke or a spool slipped.
        """
        limits = self._limits
        has_last = isfinite(self._last)
        near = self._nearest(reading, self._last)
        if not has_last and limits.begins and not limits.wraps:
            self._is_ranged = limits.low <= reading <= limits.high
        goes_on = abs(near - self._last) <= limits.fastest * min(gap, limits.interval)
        if self._is_ranged and not limits.low <= near <= limits.high and not goes_on:
            anew = self._nearest(reading, (limits.low + limits.high) / 2)
            near = anew if limits.low <= anew <= limits.high else near
        restarts = gap >= limits.boots and abs(near - reading - self.ahead) > limits.turn / 2
        if limits.wraps or restarts or not has_last:
            return near, "restarted" if restarts and not limits.wraps else None, near - reading
        return near, None, self.ahead

    def _counted(self, reading: float, gap: float) -> float:
        """Return the position of an encoder that counts its turns, or a wrapped one if all that it
        has read is within one turn.
        """
        limits = self._limits
        position = reading + self.ahead
        if not abs(position - self._last) >= limits.turn / 2:
            return position
        within = self._is_within(min(self._read[0], reading), max(self._read[1], reading))
        near = self._nearest(reading, self._last)
        # without a range nothing speaks for one turn
        is_inside = isfinite(limits.low) and limits.low <= position <= limits.high
        soon = limits.fastest * gap < limits.turn / 2
        if within and (soon or not is_inside) and limits.low <= near <= limits.high:
            return near
        return position


def encoder_of(rig: Rig, sensor: Sensor, factor: float, ranged: bool, doubting: bool) -> Encoder:
    """Return what follows a sensor of a position or of a joint's angle.

    Args:
        factor: from a logged number to SI.
        ranged: whether the joint's range says in which turn it is.
        doubting: whether a log begins where its first reading is.
    """
    counts = None
    turn = inf
    if isinstance(sensor, AngleSensor):
        counts = sensor.counts_per_turn
        turn = TURN / sensor.gear if counts is None else abs(factor) * counts
    wraps = counts is not None and sensor.measures == "position"
    low, high = motor_range(rig, sensor) if ranged else (-inf, inf)
    begins = doubting and sensor.measures == "position"
    for learned in rig.map.readings if ranged and rig.map else ():
        first, last = learned.reach.get(sensor.name, (-inf, inf))
        if last - first < turn < inf:  # its logs say in which turn it is, with room at each end
            room = (turn - (last - first)) / 4
            begins = False
            low = first - room
            high = last + room
    servos = {drive.name: drive.servo for drive in rig.drives}
    return Encoder(
        Limits(
            turn=turn,
            wraps=wraps,
            low=low,
            high=high,
            fastest=getattr(servos.get(sensor.of), "fastest", None) or Limits.fastest,
            begins=begins,
            interval=1.0 / sensor.rate,
        )
    )


IMPROBABLE = 1e-6
"""Probability of a repetition by chance, below which readings are old ones; of a register that is
read as another, before a log is seen. Source: definition (level of the test).
"""

REPEATS_AT_REST = 0.02
"""Probability of a repetition at rest below which a reading alone counts as old: its noise is 14
steps wide [1]. Source: judgement.
"""

WHITE = 1.5
"""Ratio of mean third to mean second differences above which a reading has noise of its own: it is
√(20/6) for white noise, far less for smooth motion [1]. Source: judgement (between the two).
"""

FULL = frozenset(
    end for bits in (16, 32) for end in (2**bits - 1, 2 ** (bits - 1) - 1, -(2 ** (bits - 1)))
)
"""Ends of registers, which drivers give where they read nothing. Source: definition (16 and 32
bits).
"""

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
    "repeated": "{} repeats exactly what it read before: taken as missing",
    "full": "{} is at the end of its register: taken as missing",
}
"""What was done with a reading, in words."""


@dataclass(frozen=True)
class Remark:
    """What the conversion did with a reading.

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


class RawToSI:
    """Turns logged numbers into samples in SI.

    * Registers that hold a sign (`REGISTERS`), read as numbers without a sign, are decoded, since
      their steps are then far more probable.
    * An encoder that wraps is followed beyond its turn: of all positions that its reading may mean,
      the one nearest to the last is taken. At the first value, and after a silence in which it may
      have gone half a turn, it is the only one in the range of its joint; if there are several,
      `in_doubt` says so until motion has decided.
    * A motor that counts its turns may count from another one after a restart; it is then set to
      the turn that its joint's range allows.
    * A reading that repeats exactly, although it has noise of its own, is missing, as old as it is.

    Args:
        rig: the description.
        sensors: in the order of a sample.
        factors: from logged numbers to SI, with the sensor's sign, (n,).
        ranged: whether the ranges of the joints say in which turn a motor is; before a power-on
            routine they do not.
        doubting: whether readings that may be old are missing; what moves motors looks at them
            itself.

    Attributes:
        remarks: what was done with the readings of the last sample.
    """

    def __init__(
        self,
        rig: Rig,
        sensors: Sequence[Sensor],
        factors: Iterable[float],
        *,
        ranged: bool = True,
        doubting: bool = True,
    ) -> None:
        self._channels = [
            _Channel(rig, sensor, float(factor), ranged, doubting)
            for sensor, factor in zip(sensors, factors)
        ]
        self._doubting = doubting
        self.remarks: tuple[Remark, ...] = ()

    @property
    def in_doubt(self) -> tuple[str, ...]:
        """Drives that may be in several turns."""
        encoders = ((channel.sensor.of, channel.encoder) for channel in self._channels)
        return tuple(of for of, encoder in encoders if encoder is not None and encoder.in_doubt)

    def ahead(self, i: int) -> float:
        """Return how much a channel's position is ahead of its reading, whole turns [SI]."""
        encoder = self._channels[i].encoder
        return 0.0 if encoder is None else encoder.ahead

    def follow(self, other: RawToSI) -> None:
        """Go on in the turns in which encoders of another conversion that wrap are now."""
        for mine, theirs in zip(self._channels, other._channels):
            if mine.encoder is not None and theirs.encoder is not None:
                mine.encoder.follow(theirs.encoder)

    def take(self, time: float, logged: Sequence[float]) -> Floats:
        """Return a sample in SI, (n,), NaN where a value is missing.

        Args:
            time: stamp [s].
            logged: numbers, NaN where missing, (n,).
        """
        remarks = list[Remark]()
        sample = np.full(len(self._channels), nan)
        old = self._old(logged, remarks) if self._doubting else []
        for i, (channel, number) in enumerate(zip(self._channels, logged)):
            name = channel.sensor.name
            if number != number or channel in old:
                continue
            if number in FULL and not 0.0 <= number < (channel.turn or 0):
                remarks.append(Remark("full", name))
                continue
            value = number * channel.factor
            if abs(value) <= LARGEST_READING:
                value = channel.register.decoded(number) * channel.factor
                if channel.register.bit:
                    remarks.append(Remark("decoded", name))
                if channel.encoder is not None:
                    value, kind, size = channel.encoder.take(time, value)
                    if kind is not None:
                        remarks.append(Remark(kind, name, size))
                if value == value:
                    # in logged numbers, without the rounding of whole turns
                    channel.noise.learn(round(value / channel.factor, 9))
            sample[i] = value  # the estimator takes what is beyond all sensors as missing
        self.remarks = tuple(remarks)
        return sample

    def through(
        self, time: Floats, logged: Sequence[Floats]
    ) -> tuple[dict[str, Floats], list[str]]:
        """Return sensor → its readings over a log [SI], (k,) each, and a sentence on each
        thing that the conversion did.

        Args:
            time: stamps [s], (k,).
            logged: numbers of each sensor, NaN where missing, (k,) each.
        """
        samples = np.empty((len(logged), len(time)))
        remarks_by_sensor = dict[tuple[Kind, str], list[tuple[Remark, float]]]()
        # what registers mean holds from the first sample on
        for channel, values in zip(self._channels, logged):
            channel.register = _Register.learned(values, channel.turn) or channel.register
        # a view gives one number after the other, so that they are never all in memory as objects
        for k, (stamp, *row) in enumerate(zip(time.data, *(values.data for values in logged))):
            samples[:, k] = self.take(stamp, row)
            for remark in self.remarks:
                # where a log begins it is taken as it is
                if remark.kind != "unknown turn":
                    remarks_by_sensor.setdefault((remark.kind, remark.sensor), []).append(
                        (remark, stamp)
                    )
        sensors = [channel.sensor for channel in self._channels]
        column_of = {sensor.name: sensor.log_column for sensor in sensors}
        lines = [
            f"{replace(remarks[0][0], sensor=column_of.get(sensor, '')).text} ({len(remarks)} "
            f"readings, the first at {remarks[0][1]:g} s)"
            for (_, sensor), remarks in remarks_by_sensor.items()
        ]
        return {sensor.name: sealed(values) for sensor, values in zip(sensors, samples)}, lines

    def _old(self, logged: Sequence[float], remarks: list[Remark]) -> list[_Channel]:
        """Return the channels whose readings are old ones: alone, or all together, they repeat more
        often than chance lets them.
        """
        runs = {
            channel: channel.noise.repeats(number)
            for channel, number in zip(self._channels, logged)
            if channel.sensor.measures not in REFERENCES and number == number
        }
        if not any(runs.values()):
            return []
        chances = {channel: channel.noise.chance for channel in runs}
        if min(runs.values()) * sum(chances.values()) < log(IMPROBABLE):
            remarks.append(Remark("repeated", ""))
            return [*runs]
        # alone, a reading with few steps may as well be at rest
        old = [
            channel
            for channel, run in runs.items()
            if channel.noise.is_fine and run * chances[channel] < log(IMPROBABLE)
        ]
        remarks += [Remark("repeated", channel.sensor.name) for channel in old]
        return old


class _Channel:
    """What the numbers of one sensor pass."""

    def __init__(
        self, rig: Rig, sensor: Sensor, factor: float, ranged: bool, doubting: bool
    ) -> None:
        self.sensor = sensor
        self.factor = factor
        # counts of an encoder within a turn
        self.turn = getattr(sensor, "counts_per_turn", None)
        self.register = _Register(self.turn)
        self.noise = _Noise()
        self.encoder: Encoder | None = None
        if sensor.measures in ("position", "angle"):
            self.encoder = encoder_of(rig, sensor, factor, ranged, doubting)


class _Register:
    """What a number means that may come from a register with a sign: the hypothesis under which its
    steps are most probable (Cauchy distribution, as wide as they usually are).
    """

    def __init__(self, turn: float | None = None) -> None:
        self.bit = 0
        # an encoder within a turn of as many counts as a register holds wraps as if it had a sign
        self._allowed = [turn is None or 2.0 ** (bit + 1) > turn for bit, _ in REGISTERS]
        self._whole = True
        self._before: list[float] | None = None
        self._evidence = [0.0] * len(REGISTERS)
        self._step = 1.0

    @classmethod
    def learned(cls, values: Floats, turn: float | None = None) -> _Register | None:
        """Return what a register is after a column of numbers, (k,), before the first of them; None
        where nothing was decoded.
        """
        present = values[np.isfinite(values)]
        least = 2.0 ** min(bit for bit, _ in REGISTERS)
        largest = float(np.max(present, initial=0.0))
        jump = float(np.max(np.abs(np.diff(present)), initial=0.0))
        # what has no bit of a sign, or never changes one that positions use too, needs no look
        if largest < least or (largest < 2.0**15 and jump < least / 2):
            return None
        register = cls(turn)
        found = False
        for number in present.tolist():
            register.decoded(number)
            found = found or register.bit > 0
        register._before = None
        return register if found else None

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
            is_flag = not REGISTERS[k][1]
            if not self._allowed[k] or (is_flag and self._before is None):
                continue  # that a flag is set, one number alone does not show
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
            self._step += Limits.rare * (max(abs(value - before), 1.0) - self._step)
        self._before = [number if m is None else m for m in meanings] + [number]
        return value


def decoded(values: Floats) -> Floats:
    """Return a column of numbers, (k,), in which those of a register that holds a sign are what the
    register means; unchanged where it is none.
    """
    register = _Register.learned(values)
    if register is None:
        return values
    return np.array([register.decoded(v) if v == v else v for v in values.tolist()])


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
        self._longest = 0
        self._changed = 0
        self._usual = 0.0
        self._smallest = inf
        self._differences = (0.0, 0.0)
        self._sums = (0.0, 0.0)
        self._known = nan

    def repeats(self, number: float) -> int:
        """Take in a number, and return how often it has come again without a change."""
        if number == self._last:
            self._run += 1
            return self._run
        # old readings end with a jump, a rest does not
        is_rest = abs(number - self._last) <= Limits.unusual * self._usual
        if self._run and (is_rest or self._run * self.chance >= log(IMPROBABLE)):
            self._repeated += self._run
            self._longest = max(self._longest, self._run)
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
        self._usual += (abs(difference) - self._usual) / self._changed
        self._smallest = min(self._smallest, abs(difference))
        if self._changed > 2:
            self._sums = self._sums[0] + abs(second), self._sums[1] + abs(third)

    @property
    def is_fine(self) -> bool:
        """Whether its noise is many steps wide, so that it cannot repeat at rest either."""
        return 0.0 < self._coincidence() < REPEATS_AT_REST

    @property
    def chance(self) -> float:
        """Logarithm of the probability that it repeats once more, the value being at rest."""
        coincidence = self._coincidence()
        if coincidence == 0.0 or self._run <= Limits.unusual * self._longest:
            return 0.0
        often = (self._repeated + 1) / (self._repeated + self._changed + 2)
        return min(log(max(coincidence, often)), 0.0)

    def _coincidence(self) -> float:
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


@np.errstate(over="ignore", invalid="ignore")
def says_nothing(values: Floats) -> str | None:
    """Return why the readings of an effort, (k,), say nothing of it; None where they may.

    Where noise is as large as the smallest of them, a sign shows: that m readings within its std
    are all above zero has the probability 2^{-m}.
    """
    present = values[np.isfinite(values)]
    if len(present) < FEWEST:
        return None
    if np.ptp(present) == 0.0:
        return f"has one value ({abs(present[0]):g}) in the whole log while its drive moves"
    size = present if np.min(present) >= 0.0 else -present
    second = np.abs(np.diff(size, 2))
    noise = float(np.median(second)) / NORMAL_MEDIAN / sqrt(6.0)
    within = int(np.count_nonzero((size > 0.0) & (size < noise)))
    # a sensor that cannot read less than zero reads zero often
    is_cut = np.count_nonzero(size == 0.0) > within
    if np.min(size) >= 0.0 and not is_cut and within * log(2.0) > -log(IMPROBABLE):
        return "never changes its sign, though its noise reaches zero, so it was logged without one"
    return None


FEWEST = 50
"""Least number of readings that say anything of a rig or of a sensor. Source: judgement."""

NORMAL_MEDIAN = 0.6745
"""Median of absolute values of a normal error per its std [1]. Source: definition (75 % quantile).
"""
