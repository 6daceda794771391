"""The one place through which every goal of a motor goes: what cannot pass is not sent.

A motor gets a goal after its first reading, and none while its reading is in doubt. Its goal is a
finite place within its range, no faster than it can go. Where it has no reading for `OLDEST`, it
stops, and with it each motor whose tendons cross one of its joints. A servo of stiffness K at place
s and speed v, of lag T, that holds a force F has its goal at u = s + v T + F/K. So a motor that
stops keeps the goal u that was sent last if that agrees with what was read last, and otherwise gets
the u of that. It is not sent s: it would give way by F/K. After `PATIENCE` comes what the rig calls
`when_lost`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, pi

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.rig import Rig
from distal.run.drive_range import motor_range, place_range
from distal.run.log_units import FASTEST

OLDEST = 0.1
"""A reading that is older does not tell where a motor is [s]."""

MISSED = 2.5
"""A sensor that is read less often may miss so many of its samples."""

PATIENCE = 1.0
"""A motor that stopped for longer does what the rig says in `when_lost` [s]."""

EASES = 1.0
"""A force that a motor no longer holds goes down over this time [s]."""

LAG = 0.05
"""Lag of a servo of which the rig says nothing, as that of a small servo at 3 Hz [s]."""

SPOOL = 0.01
"""What holds for an angle of a motor holds for so much of a slider's way: a usual spool [m/rad]."""

STANDS = 0.05
"""A motor that is slower stands [rad/s]."""

AGREES = 0.05
"""A goal this near to what a motor's last place and force say is kept [rad]."""

JUMP = 0.1
"""A place that moved by this more than its motor can is in doubt [rad]."""

ARRIVED = 0.15
"""A motor this near to its goal is where it was sent [rad]: so far may a small servo give way at
its largest torque.
"""

NOISES = 5.0
"""A torque that changed by less than so many standard deviations of its noise did not change."""


def columns_of(rig: Rig, channels: Sequence[str], kind: str) -> NDArray[np.int_]:
    """Return where a sample has each drive's place or force, −1 for one without, (n_drives,)."""
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
        drives, self._rig = rig.drives, rig
        self._names = [drive.name for drive in drives]
        servos = [drive.servo for drive in drives]
        fastest = [None if servo is None else servo.fastest for servo in servos]
        self._fastest = np.array([FASTEST if most is None else most for most in fastest])
        self._lag = np.array([LAG if s is None else s.delay + _lag(s.bandwidth) for s in servos])
        self._ends = np.array([_ends(rig, name, calibrated) for name in self._names])
        rates = {sensor.of: sensor.rate for sensor in rig.sensors_of("position")}
        oldest = [MISSED / rates.get(name, inf) for name in self._names]
        self._oldest = np.maximum(oldest, OLDEST)
        # how fast a slider goes, and what it has to feel, is not known: only motors can be told to
        # leap, to answer with old readings, or to be deaf
        self._is_motor = np.array([drive.kind == "capstan" for drive in drives])
        self._scale = np.where(self._is_motor, 1.0, SPOOL)
        self._has_sensor = np.array([name in rates for name in self._names])
        crossed = crossed_joints(rig)
        self._together = (crossed @ crossed.T) | np.eye(len(crossed), dtype=bool)
        noise = {sensor.of: sensor.noise for sensor in rig.sensors_of("force")}
        self._quiet = NOISES * np.array([noise.get(name, 0.0) for name in self._names])
        self._calibrated = calibrated
        self._relaxes = rig.when_lost == "relax"
        holds = [getattr(servo, "continuous_torque", None) for servo in servos]
        self._continuous = np.array([inf if most is None else most for most in holds])
        self.reset()

    def reset(self) -> None:
        """Forget everything: the next reading of each motor is its first."""
        n = len(self._names)
        self._place, self._raw, self._sent, self._ahead, self._held = np.full((5, n), np.nan)
        self._speed, self._torque, self._torque_near = np.zeros((3, n))
        self._at, self._raw_at, self._stopped_at = np.full((3, n), -inf)
        self._followed_at = np.full(n, inf)
        self._doubted, self._stale = np.zeros((2, n), dtype=bool)
        self._time, self._read_at, self._failing_since = -inf, -inf, inf
        self._before = self._sent

    def clone(self, rig: Rig) -> GoalGate:
        """Return another one that goes on alone."""
        other = GoalGate(rig)
        for name, value in vars(self).items():
            setattr(other, name, value.copy() if isinstance(value, np.ndarray) else value)
        return other

    def read(self, time: float, places: Floats, torques: Floats | None = None) -> Floats:
        """Take in what motors read, NaN where lost, and return the places that can be believed.

        A stamp that does not rise tells nothing.

        Args:
            time: stamp [s].
            places: what the sensors of the drives' places read [m, rad], (n_drives,).
            torques: what the motors pull with [N, N m], (n_drives,).
        """
        if not time > self._read_at:
            return np.full(len(places), np.nan)
        self._time, self._read_at = max(self._time, time), time
        torques = np.full(len(places), np.nan) if torques is None else torques
        self._stale = self._is_stale(places, torques)
        known = np.isfinite(places) & ~self._stale
        first = known & ~np.isfinite(self._raw)
        self._doubted = self._in_doubt(time, places, known & ~first)
        sound = known & ~self._doubted
        gap = time - self._at
        recent = sound & (gap > 0.0) & (gap <= self._oldest)
        speed = np.divide(places - self._place, gap, out=np.zeros(len(gap)), where=recent)
        self._speed = np.where(recent, (self._speed + speed) / 2, np.where(sound, 0, self._speed))
        self._raw = np.where(known, places, self._raw)
        self._raw_at = np.where(known, time, self._raw_at)
        self._place = np.where(sound, places, self._place)
        self._at = np.where(sound, time, self._at)
        slow = np.abs(self._speed) < STANDS * self._scale
        follows = self._follows(slow, torques)
        self._followed_at = np.where(follows, time, self._followed_at)
        standing = sound & slow & follows & self._calibrated
        self._ahead = np.where(standing, self._sent - places, self._ahead)
        self._torque = np.where(np.isfinite(torques), torques, self._torque)
        return np.where(sound, places, np.nan)

    def _in_doubt(self, time: float, places: Floats, known: Bools) -> Bools:
        """Return which places are in doubt: one that leapt further than its motor can go, until it
        leaps back, or is where it was sent.
        """
        moved = np.abs(places - self._raw)
        leaps = known & self._is_motor & (moved > self._fastest * (time - self._raw_at) + JUMP)
        silent = np.minimum(time - self._at, self._oldest)
        is_back = leaps & (np.abs(places - self._place) <= self._fastest * silent + JUMP)
        arrived = known & (np.abs(places - self._sent) <= ARRIVED)
        doubted: Bools = (self._doubted | leaps) & ~(self._doubted & is_back) & ~arrived
        return doubted

    def _follows(self, slow: Bools, torques: Floats) -> Bools:
        """Return which motors do not stand away from their goals with the torque that they had
        near them; those without a torque that is read cannot tell.
        """
        near = ~(np.abs(self._sent - self._place) > ARRIVED)
        pulls = np.abs(torques - self._torque_near) > self._quiet
        self._torque_near = np.where(near, torques, self._torque_near)
        tells = self._is_motor & np.isfinite(torques) & (torques != 0.0)
        follows: Bools = near | ~slow | pulls | ~tells
        return follows

    def _is_stale(self, places: Floats, torques: Floats) -> Bools:
        """Return which readings are old ones again: nothing changes of a motor that has to move,
        until something does.
        """
        same = (places == self._raw) & (torques == self._torque) & (torques != 0.0)
        ahead = np.where(np.isfinite(self._ahead), self._ahead, 0.0)
        has_to_move = np.abs(self._sent - self._raw - ahead) > AGREES
        stale: Bools = self._is_motor & same & (self._stale | has_to_move)
        return stale

    def believed(self, time: float, sample: Floats, channels: Sequence[str]) -> Floats:
        """Take in a sample and return it without the places of drives that cannot be.

        Args:
            time: stamp [s].
            sample: values of `channels`, SI, NaN where missing, (n_channels,).
        """
        at = columns_of(self._rig, channels, "position")
        forces = columns_of(self._rig, channels, "force")
        sample = np.array(sample, dtype=np.float64)
        places = np.where(at >= 0, sample[at], np.nan)
        torques = np.where(forces >= 0, sample[forces], np.nan)
        sample[at[at >= 0]] = self.read(time, places, torques)[at >= 0]
        return sample

    @property
    def unread(self) -> list[str]:
        """Motors that were never read, although a sensor is there."""
        return self._named(self._has_sensor & ~np.isfinite(self._place))

    @property
    def expected(self) -> Floats:
        """Where motors are by their last goal, or by their last reading, (n_drives,)."""
        return np.where(np.isfinite(self._sent), self._sent, self._place)

    @property
    def _lost(self) -> Bools:
        """Which motors have no reading that is young enough, or do not get their goals: they stand
        away from them and pull no more than at the last that they reached.
        """
        failing = self._time - self._failing_since > self._oldest
        unread = self._has_sensor & (self._time - self._at > self._oldest)
        lost: Bools = unread | failing | (self._time - self._followed_at > self._oldest)
        return lost

    @property
    def stopped(self) -> Bools:
        """Which motors stand because a reading is lost or in doubt, (n_drives,)."""
        alone = self._lost | self._doubted
        if not alone.any():
            return alone
        stopped: Bools = self._together @ alone
        return stopped

    @property
    def holding(self) -> Floats:
        """The torques that stopped motors had [N, N m], less what is eased off; infinite for the
        others, (n_drives,).
        """
        stopped = self.stopped
        if not stopped.any():
            return np.full(len(stopped), inf)
        return np.where(stopped, np.abs(self._torque) * self._share(stopped), inf)

    @property
    def note(self) -> str:
        """What is held back and why, in words; may be empty."""
        stopped = self.stopped
        if not stopped.any():
            return ""
        doubted = self._named(self._doubted)
        lost = self._named(self._lost & ~self._doubted)
        also = self._named(stopped & ~self._lost & ~self._doubted)
        eased = self._named(stopped & (self._share(stopped) < 1.0))
        parts = [
            ("no goal is sent to {}: where it is, is in doubt; power_on tells", doubted),
            (f"{{}} not read, or deaf to its goals, for {OLDEST:g} s: stands", lost),
            ("{} stands too: its tendons cross the same joint", also),
            ("{} gives way", eased),
        ]
        return "; ".join(words.format(", ".join(names)) for words, names in parts if names)

    def passed(self, time: float, goals: Floats) -> Floats:
        """Return what is sent to the motors, NaN for one to which nothing is.

        Args:
            time: now [s].
            goals: places as the sensors would read them, NaN for no new one, (n_drives,).
        """
        self._time = max(self._time, time)
        low, high = self._ends.T
        wanted = np.where(np.isfinite(goals), goals, self._sent)
        before = self.expected
        before = np.where(np.isfinite(before), before, wanted)
        wanted = np.clip(wanted, np.fmin(low, before), np.fmax(high, before))
        most = self._fastest * self._oldest
        wanted = np.clip(wanted, before - most, before + most)
        stopped = self.stopped
        sent = np.where(stopped, self._eased(time, stopped), wanted) if stopped.any() else wanted
        self._held = np.where(stopped, self._held, np.nan)
        self._before = self._sent
        self._sent = np.where(np.isfinite(self._place) | ~self._has_sensor, sent, np.nan)
        return np.where(self._doubted, np.nan, self._sent)

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
        ahead = np.where(np.isfinite(self._ahead), self._ahead, 0.0)
        return self._held - (1.0 - self._share(stopped)) * ahead

    def _where_it_stops(self) -> Floats:
        """Return the goals at which motors stop that have no reading any more."""
        ahead = np.where(np.isfinite(self._ahead), self._ahead, 0.0)
        since = np.minimum(self._time - self._at, self._oldest)
        coming = self._place + self._speed * (since + self._lag) + ahead
        # a motor that overshoots comes back to its goal: either way is as likely
        near = AGREES * self._scale + np.abs(self._speed) * (since + 2.0 * self._lag)
        agrees = np.abs(self._sent - self._place - ahead) <= near
        unknown = ~np.isfinite(self._ahead) & self._calibrated
        return np.where(np.isfinite(self._sent) & (agrees | unknown), self._sent, coming)

    def _share(self, stopped: Bools) -> Floats:
        """Return the share of its force that each motor still holds."""
        stopped_for = self._time - self._stopped_at - PATIENCE
        eased = np.clip(stopped_for / EASES, 0.0, 1.0)
        left = np.zeros(len(eased))
        if not self._relaxes:
            left = np.minimum(self._continuous / np.maximum(np.abs(self._torque), 1e-12), 1.0)
        return np.where(stopped, 1.0 - eased * (1.0 - left), 1.0)

    def _named(self, chosen: Bools) -> list[str]:
        return [name for name, is_chosen in zip(self._names, chosen) if is_chosen]


def _lag(bandwidth: float | None) -> float:
    return 0.0 if bandwidth is None else 1.0 / (2 * pi * bandwidth)


def _ends(rig: Rig, name: str, calibrated: bool) -> tuple[float, float]:
    """Return between which places a drive may be sent, as its sensor reads them."""
    sensor = next((s for s in rig.sensors_of("position") if s.of == name), None)
    drive = next(drive for drive in rig.drives if drive.name == name)
    if sensor is None or not calibrated:
        return -inf, inf
    if drive.stops is not None:
        return place_range(rig, sensor)
    return motor_range(rig, sensor)


def crossed_joints(rig: Rig) -> Bools:
    """Return which joints the tendons of each drive cross, (n_drives, n_joints)."""
    joints = [joint.name for joint in rig.joints]
    at = {drive.name: i for i, drive in enumerate(rig.drives)}
    crossed = np.zeros((len(at), len(joints)), dtype=bool)
    for tendon in rig.tendons:
        for joint in tendon.joints:
            crossed[at[tendon.drive], joints.index(joint)] = True
    return crossed
