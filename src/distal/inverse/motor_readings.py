"""What motors read, and which of it can be believed.

A motor is where it was read last, unless that is in doubt: it leapt further than it can go, until
it leaps back or is where it was sent. A reading that does not change although the motor has to move
is an old one, and so is one from which it had moved away. A motor that stands away from its goal,
and pulls no more than near it, is deaf.
"""

from __future__ import annotations

from math import inf

import numpy as np

from distal.arrays import Bools, Floats
from distal.rig import Rig
from distal.run.log_units import FASTEST

OLDEST = 0.1
"""A reading that is older does not tell where a motor is [s]."""

MISSED = 2.5
"""A sensor that is read less often may miss so many of its samples."""

SPOOL = 0.01
"""What holds for an angle of a motor holds for so much of a slider's way: a usual spool [m/rad]."""

STANDS = 0.05
"""A motor that is slower stands [rad/s]."""

AGREES = 0.05
"""A goal this near to what a motor's last position and force say is kept [rad]."""

JUMP = 0.1
"""A position that moved by this more than its motor can is in doubt [rad]."""

ARRIVED = 0.15
"""A motor this near to its goal is where it was sent [rad]: so far may a small servo give way at
its largest torque.
"""

REMEMBERED = 10
"""A reading that an SDK hands out once more is at most so many samples old."""

NOISES = 5.0
"""A torque that changed by less than so many standard deviations of its noise did not change."""


class MotorReadings:
    """Positions, speeds and torques of motors, (n_drives,) each, SI, as far as they can be
    believed.

    Args:
        rig: the description.

    Attributes:
        fastest: speed of each motor at most [rad/s].
        oldest: a reading that is older does not tell where a motor is [s].
        is_motor: whether it turns a spool; a slider does not.
        scale: what holds for an angle of a motor, for each drive: 1, or m/rad of a slider.
        has_sensor: whether a sensor reads its position.
        position: that was believed last, NaN before the first.
        speed: of it.
        torque: that was read last; 0 before the first.
        ahead: by how much the goal of a standing motor is ahead of its position.
        doubted: whether its last reading is in doubt.
        stands: whether it is a motor that does not move.
        deaf: whether it did not follow its last goals, and did nothing since.
        stale: whether its last reading is an old one.
    """

    def __init__(self, rig: Rig) -> None:
        drives = rig.drives
        names = [drive.name for drive in drives]
        servos = [drive.servo for drive in drives]
        fastest = [None if servo is None else servo.fastest for servo in servos]
        self.fastest = np.array([FASTEST if most is None else most for most in fastest])
        rates = {sensor.of: sensor.rate for sensor in rig.sensors_of("position")}
        self.oldest = np.maximum([MISSED / rates.get(name, inf) for name in names], OLDEST)
        self.has_sensor = np.array([name in rates for name in names])
        # how fast a slider goes, and what it has to feel, is not known: only motors can be told to
        # answer with old readings, or to be deaf, and a slider leaps only where it is absurd
        self.is_motor = np.array([drive.kind == "capstan" for drive in drives])
        self.scale = np.where(self.is_motor, 1.0, SPOOL)
        noise = {sensor.of: sensor.noise for sensor in rig.sensors_of("force")}
        self._quiet = NOISES * np.array([noise.get(name, 0.0) for name in names])
        self.reset()

    def reset(self) -> None:
        """Forget everything: the next reading of each motor is its first."""
        n = len(self.fastest)
        self.position, self._raw, self.ahead = np.full((3, n), np.nan)
        self.speed, self.torque, self._torque_near = np.zeros((3, n))
        self.at, self._raw_at = np.full((2, n), -inf)
        self._followed_at = np.full(n, inf)
        self.doubted, self.stands, self.deaf, self.stale = np.zeros((4, n), dtype=bool)
        self._before = np.full((REMEMBERED, 2, n), np.nan)

    def read(self, time: float, positions: Floats, torques: Floats, sent: Floats) -> Floats:
        """Take in what motors read, NaN where lost, and return the positions that can be believed.

        Args:
            time: stamp [s], which rises.
            positions: what the sensors of the drives' positions read [m, rad].
            torques: what the motors pull with [N, N m].
            sent: their goals, NaN of one that has none [m, rad].
        """
        self.stale = self._is_stale(positions, torques, sent)
        self._before = np.concatenate([self._before[1:], [[positions, torques]]])
        known = np.isfinite(positions) & ~self.stale
        first = known & ~np.isfinite(self._raw)
        self.doubted = self._in_doubt(time, positions, known & ~first, sent)
        sound = known & ~self.doubted
        gap = time - self.at
        recent = sound & (gap > 0.0) & (gap <= self.oldest)
        speed = np.divide(positions - self.position, gap, out=np.zeros(len(gap)), where=recent)
        self.speed = np.where(recent, (self.speed + speed) / 2, np.where(sound, 0, self.speed))
        self._raw = np.where(known, positions, self._raw)
        self._raw_at = np.where(known, time, self._raw_at)
        self.position = np.where(sound, positions, self.position)
        self.at = np.where(sound, time, self.at)
        slow = np.abs(self.speed) < STANDS * self.scale
        self.stands = slow & self.is_motor
        near = ~(np.abs(sent - self.position) > ARRIVED)
        acts = self._acts(slow, near, torques)
        self._followed_at = np.where(near | acts, time, self._followed_at)
        self.deaf = (self.deaf | (time - self._followed_at > self.oldest)) & ~acts
        rests = sound & slow & (near | ~self.is_motor) & ~self.deaf
        self.ahead = np.where(rests, sent - positions, self.ahead)
        self.torque = np.where(np.isfinite(torques), torques, self.torque)
        return np.where(sound, positions, np.nan)

    def lost(self, time: float) -> Bools:
        """Return which motors have no reading that is young enough, or stand away from their goals
        and pull no more than at the last that they reached.
        """
        unread = self.has_sensor & (time - self.at > self.oldest)
        lost: Bools = unread | (time - self._followed_at > self.oldest)
        return lost

    def _in_doubt(self, time: float, positions: Floats, known: Bools, sent: Floats) -> Bools:
        """Return which positions are in doubt."""
        moved = np.abs(positions - self._raw)
        leaps = known & (moved > self.fastest * (time - self._raw_at) + JUMP)
        silent = np.minimum(time - self.at, self.oldest)
        is_back = leaps & (np.abs(positions - self.position) <= self.fastest * silent + JUMP)
        arrived = known & (np.abs(positions - sent) <= ARRIVED)
        doubted: Bools = (self.doubted | leaps) & ~(self.doubted & is_back) & ~arrived
        return doubted

    def _acts(self, slow: Bools, near: Bools, torques: Floats) -> Bools:
        """Return which motors move, or pull otherwise than at the last goal that they were near to;
        those without a torque that is read cannot tell.
        """
        pulls = np.abs(torques - self._torque_near) > self._quiet
        self._torque_near = np.where(near, torques, self._torque_near)
        tells = self.is_motor & np.isfinite(torques) & (torques != 0.0)
        acts: Bools = ~slow | pulls | ~tells
        return acts

    def _is_stale(self, positions: Floats, torques: Floats, sent: Floats) -> Bools:
        """Return which readings are old ones again: nothing changes of a motor that has to move,
        until something does; or it is where it came from, with the very same torque.
        """
        same = (positions == self._raw) & (torques == self.torque) & (torques != 0.0)
        ahead = np.where(np.isfinite(self.ahead), self.ahead, 0.0)
        has_to_move = np.abs(sent - self._raw - ahead) > AGREES
        unmoved = same & (self.stale | has_to_move)
        came_before = (self._before == [positions, torques]).all(axis=1).any(axis=0)
        again = came_before & (np.abs(positions - self._raw) > AGREES / 2) & (torques != 0.0)
        stale: Bools = self.is_motor & (unmoved | again)
        return stale
