"""The gate through which every goal of a motor goes: what does not pass is not sent.

A motor gets no goal before its sensor was read, nor while its reading is in doubt. It is taken to
be where it was read last, unless that reading leapt further than the motor can go, until it leaps
back or is where the motor was sent. A reading is stale, an old one handed out again, if it does
not change although the motor has to move, or if the motor had moved away from it. A motor is deaf
if it stands away from its goal with the torque that it had near the last goal that it reached.

A goal is a finite position within three limits: the motor's range, what it can go by then, and a
way that is tried where it stands. A motor without a reading for `Caution.oldest` stops, and with
it every motor whose tendons cross one of its joints.

A motor that stops keeps the force F that it holds. A servo of stiffness K and lag T, at position s
and speed v, holds F with a goal at u = s + v T + F/K. Where the goal that was sent last agrees
with this u, as the last readings give it, the motor keeps that goal, and otherwise it gets u. With
a goal at s it would give way by F/K. After `Caution.patience` the motor does what the rig's
`when_lost` says; a hot motor begins to let go at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from itertools import compress
from math import inf

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.logs import Limits
from distal.logs.stamps import REWOUND
from distal.rig import Rig, motor_range, position_range
from distal.rig.components import Drive
from distal.run.health import OVERDUE
from distal.run.live_estimator import LATEST

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


def known_or(values: Floats, otherwise: Floats) -> Floats:
    """Return `values` where they are finite, and `otherwise` elsewhere."""
    return np.where(np.isfinite(values), values, otherwise)


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

    def __init__(self, rig: Rig, calibrated: bool = True) -> None:
        names = rig.drive_names
        self.calibrated = calibrated
        self.fastest = np.array(
            [getattr(drive.servo, "fastest", None) or Limits.fastest for drive in rig.drives]
        )
        rates = {sensor.of: sensor.rate for sensor in rig.sensors_of("position")}
        self.oldest = np.maximum([OVERDUE / rates.get(name, inf) for name in names], USUAL.oldest)
        self.has_sensor = np.array([name in rates for name in names])
        # a stale reading is looked for among those that are young enough
        samples = self.oldest * [rates.get(name, 0.0) for name in names]
        self._remembered = max(1, round(float(samples.max())))
        # how fast a slider goes, and what it has to feel, is not known: only motors can be told to
        # answer with old readings, or to be deaf, and a slider leaps only where it is absurd
        self.is_motor = np.array([drive.kind == "capstan" for drive in rig.drives])
        ways = [max(tendon.total_arm for tendon in rig.tendons_of(name)) for name in names]
        self.agrees = USUAL.agrees * np.where(self.is_motor, 1.0, ways)
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
        slow = np.abs(self.speed) * USUAL.patience < self.agrees
        self.stands = slow & self.is_motor
        near = ~(np.abs(sent - self.position) > USUAL.arrived)
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
        came_before = (self._before == [positions, torques]).all(axis=1).any(axis=0)
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
    at = {sensor.of: channels.index(sensor.name) for sensor in rig.sensors_of(kind)}
    return np.array([at.get(drive.name, -1) for drive in rig.drives])


class GoalGate:
    """Takes in what motors read and lets their goals pass, (n_drives,) each, SI.

    Args:
        rig: the description.
        calibrated: whether the ranges of the joints are known: then goals stay within them, and
            motors that stop hold their force. In a power-on routine they are not, and motors that
            stop let go of their force.
    """

    def __init__(self, rig: Rig, *, calibrated: bool = True) -> None:
        self._rig = rig
        self._names = rig.drive_names
        self._motors = MotorReadings(rig, calibrated)
        servos = [drive.servo for drive in rig.drives]
        self._lag = np.array([USUAL.lag if servo is None else servo.lag for servo in servos])
        self._low, self._high = np.array([_ends(rig, drive, calibrated) for drive in rig.drives]).T
        crossed = crossed_joints(rig)
        self._together = (crossed @ crossed.T) | np.eye(len(crossed), dtype=bool)
        self._relaxes = rig.when_lost == "relax"
        self._continuous = np.array(
            [getattr(servo, "continuous_torque", None) or inf for servo in servos]
        )
        self.reset()

    def reset(self) -> None:
        """Forget everything: the next reading of each motor is its first."""
        n = len(self._names)
        self._motors.reset()
        self.release()
        self._stopped_at = np.full(n, -inf)
        self._hot = np.zeros(n, dtype=bool)
        self._read_at = self._late_at = -inf
        self._late = 0
        self._begin()

    def _begin(self) -> None:
        self._time = self._passed_at = -inf
        self._failing_since = inf

    def release(self) -> None:
        """Forget the goals that were sent, but not what was read."""
        n = len(self._names)
        self._sent, self._held = np.full((2, n), np.nan)
        self._share = np.ones(n)
        self._before = self._sent
        self._failing_since = inf

    def clone(self) -> GoalGate:
        """Return a copy of the gate that goes on by itself."""
        other = copy(self)
        # what they keep is replaced, and never changed in place
        other._motors = copy(self._motors)
        return other

    def read(self, time: float, positions: Floats, torques: Floats | None = None) -> Floats:
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
        torques = np.full(len(positions), np.nan) if torques is None else torques
        return self._motors.read(time, positions, torques, self._sent)

    def _rises(self, time: float) -> bool:
        """Return whether a stamp rises; where the clock was set back, readings begin anew."""
        if not abs(time) < LATEST:
            return False
        if time <= self._read_at:
            self._late = self._late + 1 if time > self._late_at else 1
            self._late_at = time
            if self._late < REWOUND:
                return False
            self._motors.reset()
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
        self._hot = np.isin(self._names, hot)

    @property
    def unread(self) -> list[str]:
        """Names of the motors that have a position sensor but were never read."""
        return self._named(self._motors.unread)

    @property
    def expected(self) -> Floats:
        """Motors' positions by their last goals, or their last readings where no goal was sent,
        (n_drives,).
        """
        return known_or(self._sent, self._motors.position)

    @property
    def _lost(self) -> Bools:
        """Which motors are not read, or do not get their goals."""
        return self._motors.lost(self._time) | self._is_failing

    @property
    def _is_failing(self) -> Bools:
        return self._time - self._failing_since > self._motors.oldest

    @property
    def stopped(self) -> Bools:
        """Which motors are stopped because a reading is lost or in doubt, their own or that of a
        motor with a common joint, (n_drives,).
        """
        return self._together @ (self._lost | self._motors.doubted)

    @property
    def are_ignored(self) -> bool:
        """Whether a motor does not follow its goals, or goals fail to be sent."""
        return bool(self._motors.deaf.any()) or self._failing_since < inf

    @property
    def holding(self) -> Floats:
        """Forces that stopped motors still hold [N, N m], infinite for the others, (n_drives,)."""
        return np.where(self.stopped, np.abs(self._motors.torque) * self._share, inf)

    @property
    def note(self) -> str:
        """What is held back and why, in words; empty where nothing is."""
        stopped = self.stopped
        deaf = self._motors.deaf
        stale = self._motors.stale
        if not (stopped | deaf | stale).any():
            return ""
        doubted = self._motors.doubted
        lost = self._lost
        failing = self._is_failing
        eased = stopped & (self._share < 1.0)
        oldest = f"{USUAL.oldest:g} s: stands"
        parts = [
            ("no goal is sent to {}: where it is, is in doubt; power_on tells", doubted),
            (f"no goal arrives at {{}} for {oldest}", failing),
            (f"{{}} not read for {oldest}", lost & ~doubted & ~deaf & ~failing),
            ("{} does not follow its goals: they stay near it", deaf),
            ("{} answers with an old reading", stale & ~stopped),
            ("{} stands too: its tendons cross the same joint", stopped & ~lost & ~doubted),
            ("{} gives way", eased & ~self._hot),
            ("{} is hot and gives way", eased & self._hot),
        ]
        return "; ".join(
            words.format(", ".join(self._named(which))) for words, which in parts if which.any()
        )

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
        motors = self._motors
        desired = known_or(goals, self._sent)
        before = known_or(self.expected, desired)
        desired = self._limited(desired, before, since)
        stopped = self.stopped
        if stopped.any():
            eased = self._in_range(self._eased(time, stopped), before)
            desired = np.where(stopped, eased, desired)
        else:
            self._share = np.ones(len(stopped))
        self._held = np.where(stopped, self._held, np.nan)
        self._before = self._sent
        self._sent = np.where(motors.unread, np.nan, desired)
        return np.where(motors.doubted, np.nan, self._sent)

    def _in_range(self, goals: Floats, before: Floats) -> Floats:
        """Return goals within the motors' ranges, or no further beyond than the ones before."""
        return np.clip(goals, np.fmin(self._low, before), np.fmax(self._high, before))

    def _limited(self, goals: Floats, before: Floats, since: float) -> Floats:
        """Return goals within their limits; `since` is the time since those `before` [s].

        They change no faster than the motors can go, but back to where a motor is, it may go at
        once. A motor that stands is sent little beyond the goal with which it rests, until it
        moves.
        """
        motors = self._motors
        most = motors.fastest * min(since, USUAL.oldest) + motors.agrees
        low = np.fmin(before - most, motors.position)
        high = np.fmax(before + most, motors.position)
        goals = np.clip(self._in_range(goals, before), low, high)
        rests = motors.position + motors.holds_ahead
        little = 2 * USUAL.arrived
        return np.where(motors.stands, np.clip(goals, rests - little, rests + little), goals)

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
        self._held = np.where(begins, self._where_it_stops(), self._held)
        self._stopped_at = np.where(begins, time, self._stopped_at)
        # the share of its force that each motor may still hold
        patience = np.where(self._hot, 0.0, USUAL.patience)
        waited = self._time - self._stopped_at - patience
        eased = np.clip(waited / USUAL.eases, 0.0, 1.0)
        torques = np.maximum(np.abs(self._motors.torque), 1e-12)
        held = np.minimum(self._continuous / torques, 1.0)
        left = 1.0 - eased * (1.0 - np.where(self._hot | self._relaxes, 0.0, held))
        # what was let go is not held again before the motor is read
        self._share = np.where(stopped, np.minimum(self._share, left), 1.0)
        return self._held - (1.0 - self._share) * self._motors.holds_ahead

    def _where_it_stops(self) -> Floats:
        """Return the goals of motors that stop now, by their last goals and readings."""
        motors = self._motors
        since = np.minimum(self._time - motors.at, motors.oldest)
        coming = motors.position + motors.speed * (since + self._lag) + motors.holds_ahead
        # a motor that overshoots comes back to its goal: either way is as likely
        near = motors.agrees + np.abs(motors.speed) * (since + 2.0 * self._lag)
        agrees = np.abs(self._sent - motors.position - motors.holds_ahead) <= near
        # how far it gives way is not known yet
        gives_way = ~np.isfinite(motors.ahead) & motors.calibrated
        away = np.abs(self._sent - motors.position)
        gives_way &= ~motors.is_motor | (away <= near + USUAL.arrived)
        return np.where(np.isfinite(self._sent) & (agrees | gives_way), self._sent, coming)

    def _named(self, chosen: Bools) -> list[str]:
        return [*compress(self._names, chosen)]


def _ends(rig: Rig, drive: Drive, calibrated: bool) -> tuple[float, float]:
    """Return between which positions a drive may be sent, as its sensor reads them."""
    sensor = next((each for each in rig.sensors_of("position") if each.of == drive.name), None)
    if sensor is None or not calibrated:
        return -inf, inf
    return motor_range(rig, sensor) if drive.stops is None else position_range(rig, sensor)


def crossed_joints(rig: Rig) -> Bools:
    """Return which joints the tendons of each drive cross, (n_drives, n_joints)."""
    joints = rig.joint_names
    return np.array(
        [
            [any(joint in tendon.joints for tendon in rig.tendons_of(drive)) for joint in joints]
            for drive in rig.drive_names
        ]
    )
