"""The gate through which every goal of a motor goes: what does not pass is not sent.

A motor gets no goal before its sensor was read, nor while its reading is in doubt. A goal is a
finite position within three limits: the motor's range, what it can go by then, and a way that is
tried where it stands. A motor without a reading for `Caution.oldest` stops, and with it every motor
whose tendons cross one of its joints.

A motor that stops keeps the force F that it holds. A servo of stiffness K and lag T, at position s
and speed v, holds F with a goal at u = s + v T + F/K. Where the goal that was sent last agrees with
this u, as the last readings give it, the motor keeps that goal, and otherwise it gets u. With a
goal at s it would give way by F/K. After `Caution.patience` the motor does what the rig's
`when_lost` says; a hot motor begins to let go at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from math import inf

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.inverse.motor_readings import USUAL, MotorReadings
from distal.logs.stamps import REWOUND
from distal.rig import Rig, motor_range, position_range
from distal.rig.drives import Drive
from distal.run.live_estimator import LATEST


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
        holds = [getattr(servo, "continuous_torque", None) for servo in servos]
        self._continuous = np.array([inf if most is None else most for most in holds])
        self.reset()

    def reset(self) -> None:
        """Forget everything: the next reading of each motor is its first."""
        n = len(self._names)
        self._motors.reset()
        self.release()
        self._stopped_at = np.full(n, -inf)
        self._hot = np.zeros(n, dtype=bool)
        self._read_at = -inf
        self._late_at = -inf
        self._late = 0
        self._begin()

    def _begin(self) -> None:
        self._time = -inf
        self._passed_at = -inf
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
        at = columns_of(self._rig, channels, "position")
        forces = columns_of(self._rig, channels, "force")
        sample = np.array(sample, dtype=np.float64)
        positions = np.where(at >= 0, sample[at], np.nan)
        torques = np.where(forces >= 0, sample[forces], np.nan)
        sample[at[at >= 0]] = self.read(time, positions, torques)[at >= 0]
        return sample

    def heated(self, hot: Sequence[str]) -> None:
        """Set which motors are hot, by name: one that is stopped begins to let go of its force at
        once.
        """
        self._hot = np.isin(self._names, list(hot))

    @property
    def unread(self) -> list[str]:
        """Names of the motors that have a position sensor but were never read."""
        return self._named(self._motors.unread)

    @property
    def expected(self) -> Floats:
        """Motors' positions by their last goals, or their last readings where no goal was sent,
        (n_drives,).
        """
        return np.where(np.isfinite(self._sent), self._sent, self._motors.position)

    @property
    def _lost(self) -> Bools:
        """Which motors are not read, or do not get their goals."""
        lost: Bools = self._motors.lost(self._time) | self._is_failing
        return lost

    @property
    def _is_failing(self) -> Bools:
        failing: Bools = self._time - self._failing_since > self._motors.oldest
        return failing

    @property
    def stopped(self) -> Bools:
        """Which motors are stopped because a reading is lost or in doubt, their own or that of a
        motor with a common joint, (n_drives,).
        """
        stopped: Bools = self._together @ (self._lost | self._motors.doubted)
        return stopped

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
        desired = np.where(np.isfinite(goals), goals, self._sent)
        before = self.expected
        before = np.where(np.isfinite(before), before, desired)
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
            return
        self._failing_since = min(self._failing_since, self._time)
        self._sent = self._before

    def _eased(self, time: float, stopped: Bools) -> Floats:
        """Return the goals of motors that stand, less the force that they no longer hold."""
        begins = stopped & ~np.isfinite(self._held)
        self._held = np.where(begins, self._where_it_stops(), self._held)
        self._stopped_at = np.where(begins, time, self._stopped_at)
        # what was let go is not held again before the motor is read
        self._share = np.where(stopped, np.minimum(self._share, self._left()), 1.0)
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

    def _left(self) -> Floats:
        """Return the share of its force that each motor may still hold."""
        patience = np.where(self._hot, 0.0, USUAL.patience)
        waited = self._time - self._stopped_at - patience
        eased = np.clip(waited / USUAL.eases, 0.0, 1.0)
        left = np.zeros(len(eased))
        if not self._relaxes:
            torques = np.maximum(np.abs(self._motors.torque), 1e-12)
            left = np.where(self._hot, 0.0, np.minimum(self._continuous / torques, 1.0))
        return 1.0 - eased * (1.0 - left)

    def _named(self, chosen: Bools) -> list[str]:
        return [name for name, is_chosen in zip(self._names, chosen) if is_chosen]


def _ends(rig: Rig, drive: Drive, calibrated: bool) -> tuple[float, float]:
    """Return between which positions a drive may be sent, as its sensor reads them."""
    sensor = next((each for each in rig.sensors_of("position") if each.of == drive.name), None)
    if sensor is None or not calibrated:
        return -inf, inf
    return motor_range(rig, sensor) if drive.stops is None else position_range(rig, sensor)


def crossed_joints(rig: Rig) -> Bools:
    """Return which joints the tendons of each drive cross, (n_drives, n_joints)."""
    crossed = [
        {joint for tendon in rig.tendons_of(drive) for joint in tendon.joints}
        for drive in rig.drive_names
    ]
    return np.array([[joint in of for joint in rig.joint_names] for of in crossed])
