"""The one position through which every goal of a motor goes: what cannot pass is not sent.

A motor gets a goal after its first reading, and none while its reading is in doubt. Its goal is a
finite position within its range, no faster than it can go. Where it has no reading for `OLDEST`, it
stops, and with it each motor whose tendons cross one of its joints. A servo of stiffness K at
position s and speed v, of lag T, that holds a force F has its goal at u = s + v T + F/K. So a motor
that stops keeps the goal u that was sent last if that agrees with what was read last, and otherwise
gets the u of that. It is not sent s: it would give way by F/K. After `PATIENCE`, or at once where
it is hot, comes what the rig calls `when_lost`.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy, deepcopy
from math import inf, pi

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.inverse.motor_readings import AGREES, ARRIVED, OLDEST, MotorReadings
from distal.rig import Rig
from distal.run.drive_range import motor_range, position_range
from distal.run.live_estimator import LATEST
from distal.run.monitor import REWOUND

PATIENCE = 1.0
"""A motor that stopped for longer does what the rig says in `when_lost` [s]."""

EASES = 1.0
"""A force that a motor no longer holds goes down over this time [s]."""

LAG = 0.05
"""Lag of a servo of which the rig says nothing, as that of a small servo at 3 Hz [s]."""


AHEAD = 2 * ARRIVED
"""A motor that stands is sent no further from where it is, until it moves [rad]."""


def columns_of(rig: Rig, channels: Sequence[str], kind: str) -> NDArray[np.int_]:
    """Return where a sample has each drive's position or force, −1 for one without, (n_drives,)."""
    at = {sensor.of: channels.index(sensor.name) for sensor in rig.sensors_of(kind)}
    return np.array([at.get(drive.name, -1) for drive in rig.drives])


class GoalGate:
    """Takes in what motors read and lets their goals pass, (n_drives,) each, SI.

    Args:
        rig: the description.
        calibrated: whether goals stay within the ranges of the joints, and motors that stand hold
            their force; in a power-on routine ranges are not known, and forces are let go.
    """

    def __init__(self, rig: Rig, *, calibrated: bool = True) -> None:
        self._rig = rig
        self._names = rig.drive_names
        self._motors = MotorReadings(rig)
        servos = [drive.servo for drive in rig.drives]
        self._lag = np.array([LAG if s is None else s.delay + _lag(s.bandwidth) for s in servos])
        self._ends = np.array([_ends(rig, name, calibrated) for name in self._names])
        crossed = crossed_joints(rig)
        self._together = (crossed @ crossed.T) | np.eye(len(crossed), dtype=bool)
        self._calibrated = calibrated
        self._relaxes = rig.when_lost == "relax"
        holds = [getattr(servo, "continuous_torque", None) for servo in servos]
        self._continuous = np.array([inf if most is None else most for most in holds])
        self.reset()

    def reset(self) -> None:
        """Forget everything: the next reading of each motor is its first."""
        n = len(self._names)
        self._motors.reset()
        self._sent, self._held = np.full((2, n), np.nan)
        self._stopped_at = np.full(n, -inf)
        self._hot = np.zeros(n, dtype=bool)
        self._share = np.ones(n)
        self._before = self._sent
        self._read_at = -inf
        self._late_at = -inf
        self._late = 0
        self._begin()

    def _begin(self) -> None:
        self._time = -inf
        self._passed_at = -inf
        self._failing_since = inf

    def release(self) -> None:
        """Forget what motors were sent, and keep what is known of them."""
        n = len(self._names)
        self._sent, self._held = np.full((2, n), np.nan)
        self._share = np.ones(n)
        self._before = self._sent
        self._failing_since = inf

    def clone(self) -> GoalGate:
        """Return another one that goes on alone."""
        other = copy(self)
        # what the gate itself keeps is replaced, and never changed in place
        other._motors = deepcopy(self._motors)
        return other

    def read(self, time: float, positions: Floats, torques: Floats | None = None) -> Floats:
        """Take in what motors read, NaN where lost, and return the positions that can be believed.

        A stamp that does not rise tells nothing.

        Args:
            time: stamp [s].
            positions: what the sensors of the drives' positions read [m, rad], (n_drives,).
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
        """Take in a sample and return it without the positions of drives that cannot be.

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
        """Say which motors are hot: where they stand, they give way at once."""
        self._hot = np.isin(self._names, list(hot))

    @property
    def unread(self) -> list[str]:
        """Motors that were never read, although a sensor is there."""
        return self._named(self._motors.has_sensor & ~np.isfinite(self._motors.position))

    @property
    def expected(self) -> Floats:
        """Where motors are by their last goal, or by their last reading, (n_drives,)."""
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
        """Which motors stand because a reading is lost or in doubt, (n_drives,)."""
        alone = self._lost | self._motors.doubted
        if not alone.any():
            return alone
        stopped: Bools = self._together @ alone
        return stopped

    @property
    def are_ignored(self) -> bool:
        """Whether motors do not go where they are sent, or what is sent fails."""
        return bool(self._motors.deaf.any()) or self._failing_since < inf

    @property
    def holding(self) -> Floats:
        """The torques that stopped motors had [N, N m], less what is eased off; infinite for the
        others, (n_drives,).
        """
        stopped = self.stopped
        if not stopped.any():
            return np.full(len(stopped), inf)
        return np.where(stopped, np.abs(self._motors.torque) * self._share, inf)

    @property
    def note(self) -> str:
        """What is held back and why, in words; may be empty."""
        stopped = self.stopped
        deaf = self._motors.deaf
        stale = self._motors.stale
        if not (stopped | deaf | stale).any():
            return ""
        doubted = self._motors.doubted
        lost = self._lost
        failing = self._is_failing
        eased = stopped & (self._share < 1.0)
        parts = [
            ("no goal is sent to {}: where it is, is in doubt; power_on tells", doubted),
            (f"no goal arrives at {{}} for {OLDEST:g} s: stands", failing),
            (f"{{}} not read for {OLDEST:g} s: stands", lost & ~doubted & ~deaf & ~failing),
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
        """Return what is sent to the motors, NaN for one to which nothing is.

        Args:
            time: now [s].
            goals: positions as the sensors would read them, NaN for no new one, (n_drives,).
        """
        time = time if abs(time) < LATEST else self._time
        since = min(max(time - self._passed_at, 0.0), OLDEST)
        self._time = max(self._time, time)
        self._passed_at = time
        low, high = self._ends.T
        desired = np.where(np.isfinite(goals), goals, self._sent)
        before = self.expected
        before = np.where(np.isfinite(before), before, desired)
        low = np.fmin(low, before)
        high = np.fmax(high, before)
        desired = np.clip(desired, low, high)
        most = self._motors.fastest * since + AGREES * self._motors.scale
        position = self._motors.position
        # back to where a motor is, a goal may go at once
        desired = np.clip(
            desired, np.fmin(before - most, position), np.fmax(before + most, position)
        )
        rests = position + self._ahead
        near = np.clip(desired, rests - AHEAD, rests + AHEAD)
        desired = np.where(self._motors.stands, near, desired)
        stopped = self.stopped
        sent = desired
        if stopped.any():
            sent = np.where(stopped, np.clip(self._eased(time, stopped), low, high), desired)
        else:
            self._share = np.ones(len(desired))
        self._held = np.where(stopped, self._held, np.nan)
        self._before = self._sent
        never_read = self._motors.has_sensor & ~np.isfinite(self._motors.position)
        self._sent = np.where(never_read, np.nan, sent)
        return np.where(self._motors.doubted, np.nan, self._sent)

    def confirm(self, arrived: bool) -> None:
        """Say whether what passed last was sent: what was not is not where the motor goes."""
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
        return self._held - (1.0 - self._share) * self._ahead

    def _where_it_stops(self) -> Floats:
        """Return the goals at which motors stop that have no reading any more."""
        motors = self._motors
        since = np.minimum(self._time - motors.at, motors.oldest)
        coming = motors.position + motors.speed * (since + self._lag) + self._ahead
        # a motor that overshoots comes back to its goal: either way is as likely
        near = AGREES * motors.scale + np.abs(motors.speed) * (since + 2.0 * self._lag)
        agrees = np.abs(self._sent - motors.position - self._ahead) <= near
        # how far it gives way is not known yet
        gives_way = ~np.isfinite(motors.ahead) & self._calibrated
        gives_way &= ~motors.is_motor | (np.abs(self._sent - motors.position) <= near + ARRIVED)
        return np.where(np.isfinite(self._sent) & (agrees | gives_way), self._sent, coming)

    @property
    def _ahead(self) -> Floats:
        """By how much goals are ahead of standing motors that hold their force."""
        holds = np.isfinite(self._motors.ahead) & self._calibrated
        return np.where(holds, self._motors.ahead, 0.0)

    def _left(self) -> Floats:
        """Return the share of its force that each motor may still hold."""
        patience = np.where(self._hot, 0.0, PATIENCE)
        eased = np.clip((self._time - self._stopped_at - patience) / EASES, 0.0, 1.0)
        left = np.zeros(len(eased))
        if not self._relaxes:
            torques = np.maximum(np.abs(self._motors.torque), 1e-12)
            left = np.where(self._hot, 0.0, np.minimum(self._continuous / torques, 1.0))
        return 1.0 - eased * (1.0 - left)

    def _named(self, chosen: Bools) -> list[str]:
        return [name for name, is_chosen in zip(self._names, chosen) if is_chosen]


def _lag(bandwidth: float | None) -> float:
    return 0.0 if bandwidth is None else 1.0 / (2 * pi * bandwidth)


def _ends(rig: Rig, name: str, calibrated: bool) -> tuple[float, float]:
    """Return between which positions a drive may be sent, as its sensor reads them."""
    sensor = next((s for s in rig.sensors_of("position") if s.of == name), None)
    drive = next(drive for drive in rig.drives if drive.name == name)
    if sensor is None or not calibrated:
        return -inf, inf
    if drive.stops is not None:
        return position_range(rig, sensor)
    return motor_range(rig, sensor)


def crossed_joints(rig: Rig) -> Bools:
    """Return which joints the tendons of each drive cross, (n_drives, n_joints)."""
    joints = rig.joint_names
    at = {drive.name: i for i, drive in enumerate(rig.drives)}
    crossed = np.zeros((len(at), len(joints)), dtype=bool)
    for tendon in rig.tendons:
        for joint in tendon.joints:
            crossed[at[tendon.drive], joints.index(joint)] = True
    return crossed
