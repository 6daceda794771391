"""The power-on routine: each motor goes slowly from one end of its travel to the other, several
times, with limits on its torque and on time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite, nan

import numpy as np

from distal.arrays import Floats
from distal.errors import CommandError, LogError, did_you_mean
from distal.inverse.motor_safety import GoalGate
from distal.logs import Log
from distal.rig import Joint, Rig, Tendon, check_scales, independent_parts

TURNED = 0.05
"""Way back after which a motor has turned back, as a share of its travel, in the log or as the
joints' ranges need it [1]. Source: judgement.
"""

FEWEST_SWEEPS = 3
"""Least number of sweeps of a motor. Source: definition (one each way after the first, which begins
anywhere).
"""

RISEN = 1.6
"""Torque at the end of a sweep from which on it met an end, in multiples of the torque that moves
the motor [1]; six stds of its noise come on top. Source: judgement.
"""

MIDDLE = (0.35, 0.7)
"""Range of a sweep, in shares of its travel, in which the motor moves freely [1]. Source:
judgement.
"""

LOADED = (0.3, 0.95)
"""Range of the torque's rise at the end, in shares of it, in which its slope is taken [1]. Source:
judgement.
"""

STRONGEST = 5.0
"""Largest torque of a motor of a hand [N m]; a larger one is in another unit. Source: judgement."""


@dataclass(frozen=True)
class Sweep:
    """One sweep of a motor, in the direction `way`, +1 or −1, up to the sample `end`.

    Args:
        level: torque that moves the motor, positive in the direction of the sweep [N m].
        noise: std of the torque about that level [N m].
        contact: where the torque begins to rise at the end, or else where the sweep ends [rad].
        resisted: whether the sweep met an end.
    """

    way: int
    end: int
    level: float
    noise: float
    contact: float
    resisted: bool


def sweeps_of(log: Log, rig: Rig, drive: str) -> tuple[Sweep, ...]:
    """Return the sweeps of a motor in a log without gaps, of which the first begins anywhere; a
    motor that meets no end either way may have two.

    Raises:
        LogError: its angle or torque is not in the log, or it sweeps less than `FEWEST_SWEEPS`
        times.
    """
    position, torque = sweep_channels_of(rig, drive)
    positions = log.channels[position]
    torques = log.channels[torque]
    if not np.isfinite([positions, torques]).all():
        raise LogError(f"{log.source}: '{position}' or '{torque}' is never there")
    sweeps = [
        _sweep(positions[begin : end + 1], torques[begin : end + 1], end)
        for begin, end in pairwise(_turning(positions, travel_of(rig, drive)))
    ]
    if sweeps:
        way = sweeps[-1].way
        reached = [way * sweep.contact for sweep in sweeps if sweep.way == way]
        if reached[-1] < max(reached) - TURNED * np.ptp(positions):
            sweeps = sweeps[:-1]  # it went to rest
    if len(sweeps) < FEWEST_SWEEPS and (len(sweeps) < 2 or any(sweep.resisted for sweep in sweeps)):
        raise LogError(
            f"{log.source}: motor '{drive}' sweeps {len(sweeps)} times to an end of its travel; a "
            f"power-on routine has at least {FEWEST_SWEEPS} of each (see distal.hands.Routine)"
        )
    return tuple(sweeps)


def is_pair(rig: Rig, drive: str) -> bool:
    """Return whether a motor holds one joint by two tendons."""
    return len(rig.tendons_of(drive)) == 2


def crossed(rig: Rig, tendon: Tendon) -> list[tuple[Joint, float]]:
    """Return the joints that a tendon crosses, each with its moment arm [m], in the rig's order."""
    arms = tendon.arms()
    return [(joint, arms[joint.name]) for joint in rig.joints if joint.name in arms]


def needed(rig: Rig, drive: str) -> float:
    """Return the length that the joints' ranges take up of a motor's tendon [m]."""
    meets = crossed(rig, rig.tendons_of(drive)[0])
    return float(sum(abs(arm) * np.ptp(joint.travel) for joint, arm in meets))


def travel_of(rig: Rig, drive: str) -> float:
    """Return the turn of a motor that its joints' ranges need [rad]; of a slider, the way [m]."""
    return needed(rig, drive) / rig.drive(drive).lever


def contacts(sweeps: Sequence[Sweep], way: int) -> tuple[float, ...]:
    """Return where full sweeps in one direction met the end of the travel, or else ended [rad]."""
    return tuple(sweep.contact for sweep in sweeps[1:] if sweep.way == way)


def winds_to(rig: Rig, tendon: Tendon, sweeps: Sequence[Sweep]) -> tuple[float, float, float]:
    """Return where a tendon's motor met the end of its travel [rad], and the length that the rig
    has it wind from zero until there, less slack, with its std [m].

    An end that was not met is anywhere beyond.
    """
    lever = rig.drive(tendon.drive).lever
    meets = crossed(rig, tendon)
    way = tendon.winding
    met = [sweep.contact for sweep in sweeps[1:] if sweep.way == way and sweep.resisted]
    beyond = 0.0 if met else needed(rig, tendon.drive)
    at = np.mean(met or contacts(sweeps, way)) + way * beyond / lever
    # some part of what moves the motor stretches the tendon before the joint moves
    level = np.median([abs(sweep.level) for sweep in sweeps])
    stretch = level / lever / tendon.stiffness.value
    stops = [arm * joint.travel[arm > 0] for joint, arm in meets]
    stds = [arm * joint.stops_std for joint, arm in meets]
    std = np.hypot.reduce([*stds, stretch / np.sqrt(12), beyond])
    return float(at), float(sum(stops) + stretch / 2), float(std)


def sweep_channels_of(rig: Rig, drive: str) -> tuple[str, str]:
    """Return the names of the sensors of a drive's angle and of its torque.

    Raises:
        LogError: one of them is missing in the rig.
    """
    channels = {sensor.measures: sensor.name for sensor in rig.sensors if sensor.of == drive}
    for measures in ("position", "force"):
        if measures not in channels:
            raise LogError(
                f"'{rig.name}': motor '{drive}' has no sensor of its {measures}; a calibration "
                "needs both"
            )
    return channels["position"], channels["force"]


def _turning(positions: Floats, travel: float) -> list[int]:
    """Return the samples at which a motor's motion begins, turns back, and ends; its joints' ranges
    need a `travel` [rad].
    """
    least = TURNED * max(float(np.ptp(positions)), travel)
    moved = np.flatnonzero(np.abs(positions - positions[0]) > least)
    if not len(moved):
        return []
    way = 1.0 if positions[moved[0]] > positions[0] else -1.0
    ends = [int(np.argmin(way * positions[: moved[0]]))]
    best = 0
    for k, position in enumerate(positions):
        if way * (position - positions[best]) > 0.0:
            best = k
        elif way * (positions[best] - position) > least:
            ends.append(best)
            way = -way
            best = k
    return [*ends, best]


def _sweep(positions: Floats, torques: Floats, end: int) -> Sweep:
    way = 1 if positions[-1] > positions[0] else -1
    going = way * positions
    pull = way * torques
    low = float(going.min())
    high = float(going.max())
    first, last = (low + share * (high - low) for share in MIDDLE)
    free = pull[(going > first) & (going < last)]
    level = float(np.median(free)) if free.size else 0.0
    noise = float(1.48 * np.median(np.abs(free - level))) if free.size else 0.0
    last_pull = float(np.median(pull[-3:]))
    resisted = last_pull > RISEN * abs(level) + 6.0 * noise
    contact = high
    if resisted:
        least, most = (level + share * (last_pull - level) for share in LOADED)
        late = np.arange(len(pull)) > len(pull) // 2
        line = late & (pull > least) & (pull < most)
        if np.count_nonzero(line) >= 3 and np.ptp(going[line]) > 0.0:
            slope, beginning = np.polyfit(going[line], pull[line], 1)
            if slope > 0.0:
                contact = float(np.clip((level - beginning) / slope, low, high))
    return Sweep(way, end, level, noise, way * contact, resisted)


OF_PAIR = 0.15
"""Usual torque at which a sweep of a motor with a pair of tendons turns back [N m]. Source:
judgement.
"""

OF_SINGLE = 0.35
"""Usual torque at which a sweep of a motor with one tendon against springs turns back [N m].
Source: judgement.
"""

SLOWS = 1.2
"""A motor slows down near its limit: the share of its speed is this less torque/limit, at most 1
[1]. Source: judgement.
"""

SLOWEST = 0.25
"""Least such share [1]. Source: judgement."""

HELD = 0.03
"""Time for which a motor's torque has to stay above its limit until the sweep turns back [s].
Source: judgement.
"""

LONGEST_SWEEP = 1.3
"""Travel after which a sweep that meets no end turns back, in multiples of what the joints' ranges
need [1]; `MARGIN` is added. Source: judgement.
"""

MARGIN = 0.5
"""Travel of such a sweep beyond that, and of a motor that lets its one tendon out, beyond the
ranges [rad]: the tendon is loose there. Source: judgement.
"""

LEAD = 0.35
"""Largest distance of a goal from its motor [rad]. Source: judgement."""

SILENT = 0.5
"""Longest time without an angle or a torque of a motor; after it the motor's routine ends [s].
Source: judgement.
"""

STILL = 0.2
"""Time after which a motor stands [s]. Where it stands though its goal is as far ahead as allowed
and its torque is below the limit, its routine ends, since it may push with an unknown force.
Source: judgement.
"""

CREEPS = 0.01
"""Motion below which a motor stands still [rad]. Source: judgement."""

FELT = 0.1
"""Travel after which a motor whose torque still reads 0 has no working torque reading [rad].
Source: judgement.
"""

LARGEST_TORQUE = 3.0
"""Torque at which a motor's routine ends, in multiples of its limit [1]. Source: judgement."""


@dataclass(frozen=True, kw_only=True)
class RoutineOptions:
    """How a routine moves the motors.

    Args:
        order: groups of motors or joints; those of a group move at one time. None moves one motor
            after the other, in the rig's order.
        limits: torque at which a sweep turns back [N m], for all motors or by motor; by default
            0.15 with a pair of tendons, and 0.35 with one tendon against springs.
        speed: of a motor [rad/s].
        sweeps: number of sweeps of each motor.
        longest: time for a sweep [s]; the routine of a motor ends where one takes longer.
    """

    order: Sequence[Sequence[str]] | None = None
    limits: float | Mapping[str, float] | None = None
    speed: float = 1.2
    sweeps: int = 5
    longest: float = 30.0


class _Motor:
    """One motor's sweeps: where it is and its goal is, which way it goes, and what ended the last
    sweep.
    """

    def __init__(self, rig: Rig, name: str, limit: float, options: RoutineOptions) -> None:
        self.limit = limit
        self.options = options
        self.pair = is_pair(rig, name)
        self.need = travel_of(rig, name)
        self.way = 1
        self.done = 0
        self.over = self.silent = self.beyond = self.still = 0.0
        self.position = self.goal = self.begin = self.started = self.stood_at = nan
        self.ends: dict[int, float] = {}
        self.rested = self.felt = False

    def moved(self, time: float, dt: float, position: float, torque: float, note: str) -> str:
        """Go on by one period, and return why the motor's routine ends; empty where it goes on."""
        if self.silent > SILENT:
            note = note or "its angle or its current is missing"
            return f"nothing to go by for {self.silent:.1f} s ({note})"
        if not (isfinite(position) and isfinite(torque)):
            return ""
        if abs(torque) > LARGEST_TORQUE * self.limit:
            return f"a torque of {abs(torque):.2f} N m; its limit is {self.limit:.2f}"
        if not isfinite(self.begin):
            self.goal = self.begin = position
            self.started = time
        most = self.options.speed * dt
        if self.done >= self.options.sweeps:
            self.goal += float(np.clip(self.rest - self.goal, -most, most))
            self.rested = self.rested or (self._stands(dt, position) and self.goal == self.rest)
        else:
            why = self._blind(dt, position, torque)
            if why:
                return why
            self._turn(time, dt, position, torque)
            share = float(np.clip(SLOWS - self.way * torque / self.limit, SLOWEST, 1.0))
            ahead = self.goal + self.way * share * most
            self.goal = float(np.clip(ahead, position - LEAD, position + LEAD))
        if not self.rested and time - self.started > self.options.longest:
            return f"a sweep took longer than {self.options.longest:g} s: does it move?"
        return ""

    def _turn(self, time: float, dt: float, position: float, torque: float) -> None:
        """Turn back where the motor met an end, or went as far as it may."""
        self.over = self.over + dt if self.way * torque > self.limit else 0.0
        met = self.over >= HELD
        gone = self.way * (position - self.begin)
        # the first sweep begins anywhere; one tendon is let out from where it was wound up
        times = LONGEST_SWEEP if self.pair or self.way > 0 else 1.0
        most = times * self.need + MARGIN
        if self.done == 0:
            most *= 2
        if met or gone > most + self.beyond:
            self.done += 1
            if not met and self.beyond > 0.0:
                # it meets no end either way and would only go on turning
                self.done = self.options.sweeps + 1
            # the way back is longer by what it went without meeting an end
            self.beyond = 0.0 if met else gone
            self.ends[self.way] = self.goal = self.begin = position
            self.way = -self.way
            self.started = time
            self.over = 0.0

    def _blind(self, dt: float, position: float, torque: float) -> str:
        """Return why no torque reading says how hard the motor pushes in a sweep; empty where one
        does.
        """
        self.felt = self.felt or torque != 0.0
        if not self.felt and abs(position - self.begin) > FELT:
            return "its current reads 0 while it moves"
        if self.way * (self.goal - position) < LEAD - CREEPS:
            self.stood_at = nan
        if not self._stands(dt, position) or self.way * torque > self.limit:
            return ""
        return (
            f"it stands still at {np.rad2deg(position):.0f}° and its torque reads "
            f"{torque:.2f} N m, where {self.limit:.2f} N m end a sweep: does it move, and is its "
            "current right?"
        )

    def _stands(self, dt: float, position: float) -> bool:
        """Return whether the motor has stood for as long as `STILL` says."""
        if not abs(position - self.stood_at) < CREEPS:
            self.still = -dt
            self.stood_at = position
        self.still += dt
        return self.still >= STILL

    @property
    def rest(self) -> float:
        """Where the motor rests afterwards: in the middle of its travel, or where its one tendon is
        loose [rad].
        """
        if self.pair and len(self.ends) == 2:
            return sum(self.ends.values()) / 2
        return self.ends.get(-1, self.goal)


class Routine:
    """Moves a hand's motors for `calibrate`, step by step: it reads angles and torques and returns
    goals.

    ```python
    routine = Routine(rig)
    while not routine.done:
        # sample: channel → value, SI; goals: motor → angle as its sensor reads it [rad]
        goals = routine.step(time, sample)
    found = calibrate(routine.log(), rig)
    ```

    Only the motors of one group move at a time, and goals pass a `GoalGate`. A motor that cannot go
    on rests where it is, with those that move the same joints, and the others go on; `abort` leaves
    all motors where they are.

    Attributes:
        aborted: why the routine was aborted; empty if it was not.
        failed: motor whose routine ended too early → why.

    Raises:
        CommandError: the order or a limit names no motor or joint, or a number is out of its range.
    """

    def __init__(self, rig: Rig, options: RoutineOptions | None = None) -> None:
        options = options or RoutineOptions()
        limits = _checked_limits(rig, options)
        self._names = [name for drive in rig.drive_names for name in sweep_channels_of(rig, drive)]
        self._motors = {name: _Motor(rig, name, limit, options) for name, limit in limits.items()}
        self._groups = _groups(rig, options.order)
        self._gate = GoalGate(rig, calibrated=False)
        # those that share a joint, a tendon or an error
        self._together = {
            name: part.rig.drive_names
            for part in independent_parts(rig)
            for name in part.rig.drive_names
        }
        self._time = nan
        self.aborted = ""
        self.failed = dict[str, str]()
        self._sent = dict.fromkeys(self._motors, nan)
        self._rows = list[list[float]]()

    @property
    def done(self) -> bool:
        """Whether the routine is at its end, or was aborted."""
        return bool(self.aborted) or not self._groups

    @property
    def moving(self) -> tuple[str, ...]:
        """The motors that move now."""
        return () if self.done else self._groups[0]

    @property
    def goals(self) -> dict[str, float]:
        """Goals of all motors as they pass the gate, as their sensors read them [rad]; NaN for a
        motor that gets none.
        """
        goals = np.array([motor.goal for motor in self._motors.values()])
        return dict(zip(self._motors, self._gate.passed(self._time, goals).tolist()))

    def confirm(self, arrived: bool) -> None:
        """Take in whether the last goals were sent."""
        self._gate.confirm(arrived)

    def abort(self, why: str = "asked for") -> None:
        """End the routine: the goals become the positions of the motors, so that none goes on
        pushing.
        """
        self.aborted = self.aborted or why
        for motor in self._motors.values():
            motor.goal = motor.position

    def fail(self, motor: str, why: str) -> None:
        """End the routine of a motor, and of all that move the same joints."""
        for name in self._together[motor]:
            self.failed.setdefault(name, why if name == motor else f"{motor}: {why}")
            self._motors[name].goal = self._motors[name].position

    def step(self, time: float, sample: Mapping[str, float]) -> dict[str, float]:
        """Take in a sample and return the goals of all motors, as their sensors read them [rad].

        Args:
            time: of the sample [s].
            sample: channel → value, SI; NaN or left out where missing.
        """
        dt = float(np.nan_to_num(np.clip(time - self._time, 0.0, 0.1)))
        self._time = time
        read = np.array([sample.get(name, nan) for name in self._names])
        self._rows.append([time, *read, *self._sent.values()])
        torques = read[1::2]
        believed = self._gate.read(time, read[::2], torques)
        for (name, motor), position, torque in zip(self._motors.items(), believed, torques):
            is_read = isfinite(position) and isfinite(torque)
            motor.silent = 0.0 if is_read else motor.silent + dt
            if isfinite(position):
                motor.position = position
                if not isfinite(motor.goal):
                    motor.goal = position
            if name in self.moving and name not in self.failed:
                why = motor.moved(time, dt, position, torque, self._gate.note)
                if why:
                    self.fail(name, why)
        if all(name in self.failed or self._motors[name].rested for name in self.moving):
            self._groups = self._groups[1:]
        self._sent = self.goals
        return dict(self._sent)

    def log(self) -> Log:
        """Return the log of what was read and sent, as `calibrate` takes it."""
        time, *columns = np.array(self._rows).T
        goals = dict(zip(self._motors, columns[len(self._names) :]))
        return Log(time, dict(zip(self._names, columns)), {}, "power-on routine", goals=goals)


def _checked_limits(rig: Rig, options: RoutineOptions) -> dict[str, float]:
    """Return motor → torque at which its sweeps turn back [N m], after a check of all options
    before anything moves.

    Raises:
        CommandError: a number is out of its range, a limit is of no motor, or the rig's scale of
            force was taken.
    """
    check_scales(rig, "a power-on routine with limits of torque", "torque")
    asked = options.limits
    limits = dict[str, float]()
    for name in rig.drive_names:
        usual = OF_PAIR if is_pair(rig, name) else OF_SINGLE
        limits[name] = usual if asked is None or isinstance(asked, Mapping) else asked
    if isinstance(asked, Mapping):
        for name in asked:
            if name not in limits:
                raise CommandError(
                    f"limits: there is no motor '{name}'{did_you_mean(name, limits)}"
                )
        limits |= asked
    for what, value, least, most in (
        ("speed [rad/s]", options.speed, 0.05, 20.0),
        ("sweeps", options.sweeps, FEWEST_SWEEPS, 1000),
        ("longest [s]", options.longest, 1.0, 3600.0),
        *((f"the limit of motor '{n}' [N m]", of, 1e-3, STRONGEST) for n, of in limits.items()),
    ):
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not (is_number and least <= value <= most):
            raise CommandError(f"{what} must be from {least:g} to {most:g}, {value!r} came")
    return limits


def _groups(rig: Rig, order: Sequence[Sequence[str]] | None) -> list[tuple[str, ...]]:
    """Return the groups of motors that move at one time; a joint stands for the first motor with a
    tendon across it.
    """
    motors = rig.drive_names
    motor_of = {name: tendon.drive for tendon in reversed(rig.tendons) for name in tendon.joints}
    motor_of |= dict(zip(motors, motors))
    groups = list[tuple[str, ...]]()
    left = set(motors)
    for group in (*(order or ()), *([name] for name in motors)):
        for name in group:
            if name not in motor_of:
                raise CommandError(f"order: '{name}' is no motor and no joint of '{rig.name}'")
        names = dict.fromkeys(motor_of[name] for name in group)
        groups.append(tuple(name for name in names if name in left))
        left.difference_update(names)
    return [group for group in groups if group]
