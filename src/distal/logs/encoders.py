"""Positions as an encoder reads them: it may wrap, or count from another turn after a restart. What
a reading is worth the filter knows.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, exp, floor, inf, isfinite, nan, pi, remainder
from typing import Literal

from distal.rig import Rig, Sensor, motor_range
from distal.rig.sensors.base import AngleSensor

Kind = Literal["turn", "unknown turn", "restarted", "decoded", "repeated"]
"""What was done with a reading: its turn may be another one, or is a guess; it counts from another
turn than before; its register was decoded; it is missing since it repeats the last one.
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
        self._last = self._seen = nan
        # least and largest reading so far, the share of readings that are beyond them lately, and
        # the ends of a position whose turn is a guess
        self._read = (inf, -inf)
        self._beyond = 0.0
        self._guessed: tuple[float, float] | None = None
        # the median of the motion in two samples, which two sources in turn do not show
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
        if limits.wraps and within:
            position, kind = self._within_turn(reading, gap)
        else:
            position, kind = self._counted(reading, gap)
        self._learn(position)
        if limits.wraps and within and 4.0 * self._usual > limits.turn:
            return nan, "turn", gap  # it goes on too fast to be followed
        size = gap if kind == "turn" else 0.0
        if kind != "restarted" and isfinite(self._last):
            self._unwrapped += position - reading - self.ahead
        if within and self._counts(reading):
            position -= self._unwrapped  # no turn was gone that it did not count
        self._last = position
        self._seen = time
        self.ahead = position - reading
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

    def _within_turn(self, reading: float, gap: float) -> tuple[float, Kind | None]:
        """Return the position of an encoder that counts within one turn only."""
        limits = self._limits
        turn = limits.turn
        has_last = isfinite(self._last)
        near = reading + turn * round((self._last - reading) / turn) if has_last else reading
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
        if not isfinite(self._last) and limits.begins:
            return position, None
        # without a range nothing speaks for one turn
        is_inside = isfinite(limits.low) and limits.low <= position <= limits.high
        if isfinite(self._last):
            within = self._is_within(min(self._read[0], reading), max(self._read[1], reading))
            near = reading + limits.turn * round((self._last - reading) / limits.turn)
            soon = limits.fastest * gap < limits.turn / 2
            if within and (soon or not is_inside) and limits.low <= near <= limits.high:
                return near, None
        if is_inside or gap < limits.boots or not limits.high - limits.low < limits.turn:
            return position, None
        middle = (limits.low + limits.high) / 2
        anew = reading + limits.turn * round((middle - reading) / limits.turn)
        if not limits.low <= anew <= limits.high:
            return position, None
        return anew, "restarted" if isfinite(self._last) and anew != position else None


def encoder_of(rig: Rig, sensor: Sensor, factor: float, ranged: bool, doubting: bool) -> Encoder:
    """Return what follows a sensor of a position or of a joint's angle.

    Args:
        factor: from a logged number to SI.
        ranged: whether the joint's range says in which turn it is.
        doubting: whether a log begins where its first reading is.
    """
    counts = sensor.counts_per_turn if isinstance(sensor, AngleSensor) else None
    turn = TURN / sensor.gear if isinstance(sensor, AngleSensor) else inf
    if counts is not None:
        turn = abs(factor) * counts
    wraps = counts is not None and sensor.measures == "position"
    low, high = motor_range(rig, sensor) if ranged else (-inf, inf)
    drive = next((drive for drive in rig.drives if drive.name == sensor.of), None)
    servo = None if drive is None or drive.servo is None else drive.servo.fastest
    return Encoder(
        Limits(
            turn=turn,
            wraps=wraps,
            low=low,
            high=high,
            fastest=servo or Limits.fastest,
            begins=doubting and drive is not None and sensor.measures == "position",
            interval=1.0 / sensor.rate,
        )
    )
