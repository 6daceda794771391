"""The gate through which every goal of a motor goes: what does not pass is not sent.

A motor gets no goal before its sensor was read, nor while its reading is in doubt. It is taken to
be where it was read last, unless that reading leapt further than the motor can go, until it leaps
back or is where the motor was sent. A reading is stale, an old one handed out again, if it does
not change although the motor has to move, or if the motor had moved away from it. A motor is deaf
if it stands away from its goal with the torque that it had near the last goal that it reached.

A goal is a finite position within three limits: the motor's range, what it can go by then, and a
way that is tried where it stands. A motor without a reading for `OLDEST` stops, and with
it every motor whose tendons cross one of its joints.

A motor that stops keeps the force F that it holds. A servo of stiffness K and lag T, at position s
and speed v, holds F with a goal at u = s + v T + F/K. Where the goal that was sent last agrees
with this u, as the last readings give it, the motor keeps that goal, and otherwise it gets u. With
a goal at s it would give way by F/K. After `PATIENCE` the motor does what the rig's
`when_lost` says; a hot motor begins to let go at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import compress
from math import inf

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.logs import Limits
from distal.logs.stamps import REWOUND
from distal.rig import Rig, motor_range, position_range
from distal.rig.components import Drive
from distal.rig.sensors import Sensor
from distal.run.health import OVERDUE
from distal.run.live_estimator import LATEST

NOISES = 5.0
"""Change of a torque, in standard deviations of its noise, below which it counts as unchanged [1].
Source: judgement.
"""


OLDEST = 0.1
"""Age beyond which a reading does not tell where a motor is [s]. Source: judgement."""

PATIENCE = 1.0
"""Time for which a stopped motor holds its force before it does what the rig's `when_lost` says,
and over which it then lets go of it [s]; a motor stands if it would move by less than `AGREES` in
it. Source: judgement.
"""

LAG = 0.05
"""Lag of a servo that the rig does not describe [s], that of a bandwidth of 3 Hz. Source:
judgement.
"""

AGREES = 0.05
"""Distance within which a goal agrees with a motor's last position and force, an angle of the motor
or of a slider's joint [rad]. Source: judgement.
"""

JUMP = 0.1
"""Distance beyond what a motor can go at its speed, from which on its reading is in doubt [rad].
Source: judgement.
"""

ARRIVED = 0.15
"""Distance from its goal within which a motor has arrived [rad]: so far may a small servo give way
at its largest torque. A motor that stands is sent no more than twice as far, until it moves.
Source: judgement.
"""


def known_or(values: Floats, otherwise: Floats) -> Floats:
    """Return `values` where they are finite, and `otherwise` elsewhere."""
    return np.where(np.isfinite(values), values, otherwise)


def by_drive(rig: Rig, measures: str, value: Callable[[Sensor], float], otherwise: float) -> Floats:
    """Return a value of the sensor of each drive's position or force, (n_drives,), and `otherwise`
    where a drive has none.
    """
    known = {sensor.of: value(sensor) for sensor in rig.sensors_of(measures)}
    return np.array([known.get(name, otherwise) for name in rig.drive_names])


class MotorReadings:
    """Positions, speeds and torques of motors as far as they can be believed, (n_drives,) each, SI.

    Args:
        rig: the description.
        calibrated: whether the ranges of the joints are known.

    Attributes:
        fastest: largest speed of each motor [rad/s].
        oldest: age beyond which a reading does not tell where a motor is [s].
        is_motor: whether a drive turns a spool; a slider does not.
        agrees: distance within which two positions agree; of a slider, that of the joints that its
            tendons cross.
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

    def __init__(self, rig: Rig, calibrated: bool) -> None:
        names = rig.drive_names
        self.calibrated = calibrated
        self.fastest = np.array(
            [getattr(drive.servo, "fastest", None) or Limits.fastest for drive in rig.drives]
        )
        rates = by_drive(rig, "position", lambda sensor: sensor.rate, 0.0)
        self.has_sensor = rates > 0.0
        self.oldest = np.fmax(OLDEST, OVERDUE / np.where(self.has_sensor, rates, inf))
        # a stale reading is looked for among those that are young enough
        self._remembered = max(1, round(float((self.oldest * rates).max())))
        # how fast a slider goes, and what it has to feel, is not known: only motors can be told to
        # answer with old readings, or to be deaf, and a slider leaps only where it is absurd
        self.is_motor = np.array([drive.kind == "capstan" for drive in rig.drives])
        ways = [max(tendon.total_arm for tendon in rig.tendons_of(name)) for name in names]
        self.agrees = AGREES * np.where(self.is_motor, 1.0, ways)
        self._quiet = NOISES * by_drive(rig, "force", lambda sensor: sensor.noise, 0.0)

    def reset(self) -> None:
        """Forget everything: the next reading of each motor is its first."""
        n = len(self.fastest)
        self.position, self._raw, self.ahead = np.full((3, n), np.nan)
        self.speed, self.torque, self._torque_near = np.zeros((3, n))
        self.at, self._raw_at = np.full((2, n), -inf)
        self._followed_at = np.full(n, inf)
        self.doubted, self.stands, self.deaf, self.stale = np.zeros((4, n), dtype=bool)
        self._recent = np.full((self._remembered, 2, n), np.nan)

    def take(self, time: float, positions: Floats, torques: Floats, sent: Floats) -> Floats:
        """Take in what motors read, NaN where lost, and return the positions that can be believed,
        NaN for the others.

        Args:
            time: stamp [s], which rises.
            positions: what the drives' position sensors read [m, rad].
            torques: what the motors pull with [N, N m].
            sent: goals of the motors, NaN of one that has none [m, rad].
        """
        self.stale = self._is_stale(positions, torques, sent)
        self._recent = np.concatenate([self._recent[1:], [[positions, torques]]])
        known = np.isfinite(positions) & ~self.stale
        self.doubted = self._in_doubt(time, positions, known & np.isfinite(self._raw), sent)
        sound = known & ~self.doubted
        gap = time - self.at
        recent = sound & (gap > 0.0) & (gap <= self.oldest)
        speed = np.divide(positions - self.position, gap, out=np.zeros(len(gap)), where=recent)
        self.speed = np.where(recent, (self.speed + speed) / 2, np.where(sound, 0, self.speed))
        self._raw = np.where(known, positions, self._raw)
        self._raw_at = np.where(known, time, self._raw_at)
        self.position = np.where(sound, positions, self.position)
        self.at = np.where(sound, time, self.at)
        slow = np.abs(self.speed) * PATIENCE < self.agrees
        self.stands = slow & self.is_motor
        near = ~(np.abs(sent - self.position) > ARRIVED)
        acts = self._acts(slow, near, torques)
        self._followed_at = np.where(near | acts, time, self._followed_at)
        self.deaf = (self.deaf | (time - self._followed_at > self.oldest)) & ~acts
        rests = sound & slow & (near | ~self.is_motor) & ~self.deaf
        self.ahead = np.where(rests, sent - positions, self.ahead)
        self.torque = known_or(torques, self.torque)
        return np.where(sound, positions, np.nan)

    @property
    def holds_ahead(self) -> Floats:
        """By how much goals are ahead of standing motors that hold their force; zero where the
        ranges of the joints are not known, since no force is held there.
        """
        return np.where(np.isfinite(self.ahead) & self.calibrated, self.ahead, 0.0)

    def _in_doubt(self, time: float, positions: Floats, known: Bools, sent: Floats) -> Bools:
        """Return which positions are in doubt."""
        moved = np.abs(positions - self._raw)
        leaps = known & (moved > self.fastest * (time - self._raw_at) + JUMP)
        silent = self.fastest * np.minimum(time - self.at, self.oldest)
        is_back = leaps & (np.abs(positions - self.position) <= silent + JUMP)
        arrived = known & (np.abs(positions - sent) <= ARRIVED)
        doubted: Bools = np.where(self.doubted, ~is_back, leaps) & ~arrived
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
        has_to_move = np.abs(sent - self._raw - np.nan_to_num(self.ahead)) > self.agrees
        unmoved = same & (self.stale | has_to_move)
        came_before = (self._recent == [positions, torques]).all(axis=1).any(axis=0)
        again = came_before & (np.abs(positions - self._raw) > self.agrees / 2) & (torques != 0.0)
        stale: Bools = self.is_motor & (unmoved | again)
        return stale


def columns_of(rig: Rig, channels: Sequence[str], kind: str) -> NDArray[np.int_]:
    """Return the index of each drive's position or force in a sample, −1 where it has none,
    (n_drives,).

    Args:
        channels: names of the sensors in a sample.
        kind: "position" or "force".
    """
    return by_drive(rig, kind, lambda sensor: channels.index(sensor.name), -1).astype(int)


class GoalGate(MotorReadings):
    """Takes in what motors read and lets their goals pass, (n_drives,) each, SI. What it keeps is
    replaced, and never changed in place, so that a copy goes on by itself.

    Args:
        rig: the description.
        calibrated: whether the ranges of the joints are known: then goals stay within them, and
            motors that stop hold their force. In a power-on routine they are not, and motors that
            stop let go of their force.

    Attributes:
        together: which motors stop with each one, since their tendons cross a joint of it,
            (n_drives, n_drives).
    """

    def __init__(self, rig: Rig, *, calibrated: bool = True) -> None:
        super().__init__(rig, calibrated)
        self._rig = rig
        servos = [drive.servo for drive in rig.drives]
        self._lag = np.array([LAG if servo is None else servo.lag for servo in servos])
        self._low, self._high = np.array([_ends(rig, drive, calibrated) for drive in rig.drives]).T
        crossed = crossed_joints(rig)
        self.together = (crossed @ crossed.T) | np.eye(len(crossed), dtype=bool)
        self._continuous = np.array(
            [getattr(servo, "continuous_torque", None) or inf for servo in servos]
        )
        self.reset()

    def reset(self) -> None:
        """Forget everything: the next reading of each motor is its first."""
        self._begin()
        self.release()
        self._stopped_at = np.full(len(self.fastest), -inf)
        self._hot = np.zeros(len(self.fastest), dtype=bool)
        self._read_at = self._late_at = -inf
        self._late = 0

    def _begin(self) -> None:
        super().reset()
        self._time = self._passed_at = -inf
        self._failing_since = inf

    def release(self) -> None:
        """Forget the goals that were sent, but not what was read."""
        self._sent, self._held = np.full((2, len(self.fastest)), np.nan)
        self._share = np.ones(len(self.fastest))
        self._before = self._sent
        self._failing_since = inf

    def read(self, time: float, positions: Floats, torques: Floats) -> Floats:
        """Take in what motors read, NaN where lost, and return the positions that can be believed,
        NaN for the others.

        A sample whose stamp does not rise is not taken in, unless several in a row show that the
        clock was set back.

        Args:
            time: stamp [s].
            positions: what the drives' position sensors read [m, rad], (n_drives,).
            torques: what the motors pull with [N, N m], (n_drives,).
        """
        if not self._rises(time):
            return np.full(len(positions), np.nan)
        self._time = max(self._time, time)
        return self.take(time, positions, torques, self._sent)

    def _rises(self, time: float) -> bool:
        """Return whether a stamp rises; where the clock was set back, readings begin anew."""
        if not abs(time) < LATEST:
            return False
        if time <= self._read_at:
            self._late = self._late + 1 if time > self._late_at else 1
            self._late_at = time
            if self._late < REWOUND:
                return False
            self._begin()
        self._read_at = time
        self._late = 0
        return True

    def believed(self, time: float, sample: Floats, channels: Sequence[str]) -> Floats:
        """Take in a sample and return it with NaN for the drives' positions that cannot be
        believed.

        Args:
            time: stamp [s].
            sample: values of `channels`, SI, NaN where missing, (n_channels,).
        """
        at, forces = (columns_of(self._rig, channels, kind) for kind in ("position", "force"))
        # a drive without a sensor has column −1, the NaN at the end
        sample = np.append(sample, np.nan)
        sample[at] = self.read(time, sample[at], sample[forces])
        return sample[:-1]

    def heated(self, hot: Sequence[str]) -> None:
        """Set which motors are hot, by name: one that is stopped begins to let go of its force at
        once.
        """
        self._hot = np.isin(self._rig.drive_names, hot)

    @property
    def _unread(self) -> Bools:
        unread: Bools = self.has_sensor & ~np.isfinite(self.position)
        return unread

    @property
    def unread(self) -> str:
        """Names of the motors that have a position sensor but were never read."""
        return self._named(self._unread)

    @property
    def expected(self) -> Floats:
        """Motors' positions by their last goals, or their last readings where no goal was sent,
        (n_drives,).
        """
        return known_or(self._sent, self.position)

    @property
    def _lost(self) -> Bools:
        """Which motors have no reading that is young enough, have for as long not followed their
        goals, or do not get their goals.
        """
        unread = self.has_sensor & (self._time - self.at > self.oldest)
        return unread | (self._time - self._followed_at > self.oldest) | self._is_failing

    @property
    def _is_failing(self) -> Bools:
        return self._time - self._failing_since > self.oldest

    @property
    def stopped(self) -> Bools:
        """Which motors are stopped because a reading is lost or in doubt, their own or that of a
        motor with a common joint, (n_drives,).
        """
        return self.together @ (self._lost | self.doubted)

    @property
    def are_ignored(self) -> bool:
        """Whether a motor does not follow its goals, or goals fail to be sent."""
        return bool(self.deaf.any()) or self._failing_since < inf

    @property
    def holding(self) -> Floats:
        """Forces that stopped motors still hold [N, N m], infinite for the others, (n_drives,)."""
        return np.where(self.stopped, np.abs(self.torque) * self._share, inf)

    @property
    def note(self) -> str:
        """What is held back and why, in words; empty where nothing is."""
        stopped = self.stopped
        lost = self._lost
        failing = self._is_failing
        eased = stopped & (self._share < 1.0)
        oldest = f"{OLDEST:g} s: stands"
        parts = [
            ("no goal is sent to {}: where it is, is in doubt; power_on tells", self.doubted),
            (f"no goal arrives at {{}} for {oldest}", failing),
            (f"{{}} not read for {oldest}", lost & ~self.doubted & ~self.deaf & ~failing),
            ("{} does not follow its goals: they stay near it", self.deaf),
            ("{} answers with an old reading", self.stale & ~stopped),
            ("{} stands too: its tendons cross the same joint", stopped & ~lost & ~self.doubted),
            ("{} gives way", eased & ~self._hot),
            ("{} is hot and gives way", eased & self._hot),
        ]
        return "; ".join(words.format(self._named(which)) for words, which in parts if which.any())

    def passed(self, time: float, goals: Floats) -> Floats:
        """Return the goals that are sent to the motors [m, rad], NaN for a motor to which none is
        sent.

        Args:
            time: now [s].
            goals: positions as the sensors would read them, NaN where the last goal stays,
                (n_drives,).
        """
        time = time if abs(time) < LATEST else self._time
        since = max(time - self._passed_at, 0.0)
        self._time = max(self._time, time)
        self._passed_at = time
        desired = known_or(goals, self._sent)
        before = known_or(self.expected, desired)
        stopped = self.stopped
        desired = np.where(
            stopped,
            self._in_range(self._eased(time, stopped), before),
            self._limited(desired, before, since),
        )
        self._before = self._sent
        self._sent = np.where(self._unread, np.nan, desired)
        return np.where(self.doubted, np.nan, self._sent)

    def _in_range(self, goals: Floats, before: Floats) -> Floats:
        """Return goals within the motors' ranges, or no further beyond than the ones before."""
        return np.clip(goals, np.fmin(self._low, before), np.fmax(self._high, before))

    def _limited(self, goals: Floats, before: Floats, since: float) -> Floats:
        """Return goals within their limits; `since` is the time since those `before` [s].

        They change no faster than the motors can go, but back to where a motor is, it may go at
        once. A motor that stands is sent little beyond the goal with which it rests, until it
        moves.
        """
        most = self.fastest * min(since, OLDEST) + self.agrees
        low = np.fmin(before - most, self.position)
        high = np.fmax(before + most, self.position)
        goals = np.clip(self._in_range(goals, before), low, high)
        rests = self.position + self.holds_ahead
        little = 2 * ARRIVED
        return np.where(self.stands, np.clip(goals, rests - little, rests + little), goals)

    def confirm(self, arrived: bool) -> None:
        """Take in whether the goals that passed last were sent; where they were not, the goals
        before them count.
        """
        if arrived:
            self._failing_since = inf
        else:
            self._failing_since = min(self._failing_since, self._time)
            self._sent = self._before

    def _eased(self, time: float, stopped: Bools) -> Floats:
        """Return the goals of motors that stand, less the force that they no longer hold."""
        begins = stopped & ~np.isfinite(self._held)
        held = np.where(begins, self._where_it_stops(), self._held)
        self._held = np.where(stopped, held, np.nan)
        self._stopped_at = np.where(begins, time, self._stopped_at)
        # the share of its force that each motor may still hold
        waited = self._time - self._stopped_at - np.where(self._hot, 0.0, PATIENCE)
        eased = np.clip(waited / PATIENCE, 0.0, 1.0)
        most = np.minimum(self._continuous / np.maximum(np.abs(self.torque), 1e-12), 1.0)
        relaxes = self._hot | (self._rig.when_lost == "relax")
        left = 1.0 - eased * (1.0 - np.where(relaxes, 0.0, most))
        # what was let go is not held again before the motor is read
        self._share = np.where(stopped, np.minimum(self._share, left), 1.0)
        return self._held - (1.0 - self._share) * self.holds_ahead

    def _where_it_stops(self) -> Floats:
        """Return the goals of motors that stop now, by their last goals and readings."""
        since = np.minimum(self._time - self.at, self.oldest)
        coming = self.position + self.speed * (since + self._lag) + self.holds_ahead
        # a motor that overshoots comes back to its goal: either way is as likely
        near = self.agrees + np.abs(self.speed) * (since + 2.0 * self._lag)
        away = np.abs(self._sent - self.position)
        agrees = np.abs(self._sent - self.position - self.holds_ahead) <= near
        # how far it gives way is not known yet
        gives_way = ~np.isfinite(self.ahead) & self.calibrated
        gives_way &= ~self.is_motor | (away <= near + ARRIVED)
        return np.where(np.isfinite(self._sent) & (agrees | gives_way), self._sent, coming)

    def _named(self, chosen: Bools) -> str:
        return ", ".join(compress(self._rig.drive_names, chosen))


def _ends(rig: Rig, drive: Drive, calibrated: bool) -> tuple[float, float]:
    """Return between which positions a drive may be sent, as its sensor reads them."""
    for sensor in rig.sensors_of("position"):
        if calibrated and sensor.of == drive.name:
            return (motor_range if drive.stops is None else position_range)(rig, sensor)
    return -inf, inf


def crossed_joints(rig: Rig) -> Bools:
    """Return which joints the tendons of each drive cross, (n_drives, n_joints)."""
    return np.array(
        [
            [
                any(joint in tendon.joints for tendon in rig.tendons_of(drive))
                for joint in rig.joint_names
            ]
            for drive in rig.drive_names
        ]
    )
