"""What motors read, and which of it can be believed.

A motor is taken to be where it was read last, unless that reading is in doubt. A reading is in
doubt if it leapt further than the motor can go, until it leaps back or is where the motor was sent.
A reading is stale, an old one handed out again, if it does not change although the motor has to
move, or if the motor had moved away from it. A motor is deaf if it stands away from its goal with
the torque that it had near the last goal that it reached.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from distal.arrays import Bools, Floats
from distal.logs import Limits
from distal.rig import Rig
from distal.run.health import LIMITS

NOISES = 5.0
"""Change of a torque, in standard deviations of its noise, below which it counts as unchanged [1].
Source: judgement.
"""


@dataclass(frozen=True)
class Caution:
    """How much of what motors read is believed, and what motors do that are not read.

    Angles are those of motors. For a slider `agrees` is that angle of its joints.

    Args:
        oldest: age beyond which a reading does not tell where a motor is [s].
        patience: time for which a stopped motor holds its force before it does what the rig's
            `when_lost` says [s]; a motor stands if it would move by less than `agrees` in it.
        eases: time over which a stopped motor lets go of its force [s].
        lag: of a servo that the rig does not describe [s]; that of a bandwidth of 3 Hz.
        agrees: distance within which a goal agrees with a motor's last position and force [rad].
        jump: distance beyond what a motor can go at its speed, from which on its reading is in
            doubt [rad].
        arrived: distance from its goal within which a motor has arrived [rad]: so far may a small
            servo give way at its largest torque. A motor that stands is sent no more than twice as
            far, until it moves.
    """

    oldest: float = 0.1
    patience: float = 1.0
    eases: float = 1.0
    lag: float = 0.05
    agrees: float = 0.05
    jump: float = 0.1
    arrived: float = 0.15


USUAL = Caution()
"""What all motors go by."""


class MotorReadings:
    """Positions, speeds and torques of motors as far as they can be believed, (n_drives,) each, SI.

    Args:
        rig: the description.
        calibrated: whether the ranges of the joints are known.

    Attributes:
        fastest: largest speed of each motor [rad/s].
        oldest: age beyond which a reading does not tell where a motor is [s].
        is_motor: whether a drive turns a spool; a slider does not.
        scale: limit for a drive per limit for the angle of a motor: 1, or how far a slider goes as
            the joints that its tendons cross turn by 1 rad [m/rad].
        agrees: distance within which two positions agree.
        has_sensor: whether a sensor reads the position.
        position: the last one that was believed, NaN before the first.
        speed: of that position.
        torque: that was read last; 0 before the first.
        at: stamp of `position` [s].
        ahead: goal minus position, when the motor last stood near its goal; NaN before.
        doubted: whether the last reading is in doubt.
        stands: whether it is a motor that does not move.
        deaf: whether the motor did not follow its last goals, and has not moved or pulled otherwise
            since.
        stale: whether the last reading is an old one.
    """

    def __init__(self, rig: Rig, calibrated: bool = True) -> None:
        drives = rig.drives
        names = [drive.name for drive in drives]
        self.calibrated = calibrated
        self.fastest = np.array(
            [
                drive.servo.fastest or Limits.fastest if drive.servo else Limits.fastest
                for drive in drives
            ]
        )
        rates = {sensor.of: sensor.rate for sensor in rig.sensors_of("position")}
        self.oldest = np.maximum(
            [LIMITS.overdue / rates.get(name, inf) for name in names], USUAL.oldest
        )
        self.has_sensor = np.array([name in rates for name in names])
        # a stale reading is looked for among those that are young enough
        samples = self.oldest * [rates.get(name, 0.0) for name in names]
        self._remembered = max(1, round(float(samples.max())))
        # how fast a slider goes, and what it has to feel, is not known: only motors can be told to
        # answer with old readings, or to be deaf, and a slider leaps only where it is absurd
        self.is_motor = np.array([drive.kind == "capstan" for drive in drives])
        ways = [
            max(tendon.total_arm for tendon in rig.tendons if tendon.drive == name)
            for name in names
        ]
        self.scale = np.where(self.is_motor, 1.0, ways)
        self.agrees = USUAL.agrees * self.scale
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
        self._before = np.full((self._remembered, 2, n), np.nan)

    def read(self, time: float, positions: Floats, torques: Floats, sent: Floats) -> Floats:
        """Take in what motors read, NaN where lost, and return the positions that can be believed,
        NaN for the others.

        Args:
            time: stamp [s], which rises.
            positions: what the drives' position sensors read [m, rad].
            torques: what the motors pull with [N, N m].
            sent: goals of the motors, NaN of one that has none [m, rad].
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
        slow = np.abs(self.speed) * USUAL.patience < self.agrees
        self.stands = slow & self.is_motor
        near = ~(np.abs(sent - self.position) > USUAL.arrived)
        acts = self._acts(slow, near, torques)
        self._followed_at = np.where(near | acts, time, self._followed_at)
        self.deaf = (self.deaf | (time - self._followed_at > self.oldest)) & ~acts
        rests = sound & slow & (near | ~self.is_motor) & ~self.deaf
        self.ahead = np.where(rests, sent - positions, self.ahead)
        self.torque = np.where(np.isfinite(torques), torques, self.torque)
        return np.where(sound, positions, np.nan)

    @property
    def holds_ahead(self) -> Floats:
        """By how much goals are ahead of standing motors that hold their force; zero where the
        ranges of the joints are not known, since no force is held there.
        """
        return np.where(np.isfinite(self.ahead) & self.calibrated, self.ahead, 0.0)

    @property
    def unread(self) -> Bools:
        """Which motors have a position sensor but were never read."""
        unread: Bools = self.has_sensor & ~np.isfinite(self.position)
        return unread

    def lost(self, time: float) -> Bools:
        """Return which motors have no reading that is young enough, or have for as long not
        followed their goals.
        """
        unread = self.has_sensor & (time - self.at > self.oldest)
        lost: Bools = unread | (time - self._followed_at > self.oldest)
        return lost

    def _in_doubt(self, time: float, positions: Floats, known: Bools, sent: Floats) -> Bools:
        """Return which positions are in doubt."""
        moved = np.abs(positions - self._raw)
        leaps = known & (moved > self.fastest * (time - self._raw_at) + USUAL.jump)
        silent = self.fastest * np.minimum(time - self.at, self.oldest)
        is_back = leaps & (np.abs(positions - self.position) <= silent + USUAL.jump)
        arrived = known & (np.abs(positions - sent) <= USUAL.arrived)
        doubted: Bools = (self.doubted | leaps) & ~(self.doubted & is_back) & ~arrived
        return doubted

    def _acts(self, slow: Bools, near: Bools, torques: Floats) -> Bools:
        """Return which motors move, or pull otherwise than near the last goal that they reached; a
        motor whose torque is not read counts as one.
        """
        pulls = np.abs(torques - self._torque_near) > self._quiet
        self._torque_near = np.where(near, torques, self._torque_near)
        tells = self.is_motor & np.isfinite(torques) & (torques != 0.0)
        acts: Bools = ~slow | pulls | ~tells
        return acts

    def _is_stale(self, positions: Floats, torques: Floats, sent: Floats) -> Bools:
        """Return which readings are old ones: nothing of a motor that has to move changes, until
        something does, or a motor is where it came from with the very same torque.
        """
        same = (positions == self._raw) & (torques == self.torque) & (torques != 0.0)
        ahead = np.where(np.isfinite(self.ahead), self.ahead, 0.0)
        has_to_move = np.abs(sent - self._raw - ahead) > self.agrees
        unmoved = same & (self.stale | has_to_move)
        came_before = (self._before == [positions, torques]).all(axis=1).any(axis=0)
        again = came_before & (np.abs(positions - self._raw) > self.agrees / 2) & (torques != 0.0)
        stale: Bools = self.is_motor & (unmoved | again)
        return stale
