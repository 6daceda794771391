"""`Hand`: joint angles of a hand without sensors in its joints, and goals for its motors, through
its own SDK, of which `Motors` says what is needed (readings, temperatures, goals). `distal`
imports no SDK.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import degrees, inf, isfinite, isnan, nan, radians
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from distal.arrays import Floats
from distal.confidence import CLEARLY
from distal.errors import CommandError, DistalError, EstimationError, did_you_mean
from distal.hands.calibrate import Calibrated, calibrate
from distal.hands.power_on_routine import Routine, RoutineOptions
from distal.inverse import LiveInverse
from distal.inverse.motor_safety import GoalGate, by_drive
from distal.logs import check_outputs, write_log
from distal.rig import Rig, as_rig, log_factor
from distal.rig.plausibility import KNOWN
from distal.run import HEALTH, LiveEstimator, LogUnits, Monitor, Reading
from distal.run.health import Health
from distal.run.live_estimator import HOTTEST


@runtime_checkable
class Motors(Protocol):
    """Interface of the motors to a `Hand`: for a hand of another kind, write an object with these
    three methods.

    Where it also has `limit_torques(limits)`, motor → torque [N m], that limits the torques of
    these motors, and of all others to their usual limits.
    """

    def read(self) -> Mapping[str, float]:
        """Return column of the rig → reading, in the unit of the log; columns of a motor that does
        not answer are left out.
        """

    def temperatures(self) -> Mapping[str, float]:
        """Return motor → temperature [°C]; motors without a measured one are left out."""

    def write(self, goals: Mapping[str, float]) -> None:
        """Send goals: motor → angle, in the unit in which its position is read."""


ORCA_METHODS = (
    "get_motor_pos",
    "get_motor_current",
    "get_motor_temp",
    "write_motor_pos",
    "set_max_current",
)
"""Methods of `orca_core.OrcaHand` (0.4 on) that are used here: motors by number, radians,
milliamperes.
"""


class OrcaMotors:
    """The motors of an ORCA hand, as columns of a rig made by `from_orca`.

    Raises:
        EstimationError: its SDK is too old, or its motors are not the rig's.
    """

    def __init__(self, hand: Any, rig: Rig) -> None:
        for method in ORCA_METHODS:
            if not hasattr(hand, method):
                raise EstimationError(
                    f"{type(hand).__name__} has no {method}: it needs orca_core 0.4.0 or newer"
                )
        self._hand = hand
        self._ids = [int(number) for number in hand.config.motor_ids]
        self._names = [f"motor_{number}" for number in self._ids]
        for name in rig.drive_names:
            if name not in self._names:
                raise EstimationError(
                    f"the rig '{rig.name}' has a motor '{name}' that this hand has not: "
                    f"{', '.join(self._names)}"
                )
        self._torque_of = {s.of: abs(log_factor(s)) for s in rig.sensors_of("force")}

    def read(self) -> dict[str, float]:
        """Return positions [rad] and currents [mA] by column; none where a read failed."""
        positions = list(self._hand.get_motor_pos())
        answered = self._answered()
        currents = list(self._hand.get_motor_current())
        if not (answered and self._answered()):
            return {}
        if not len(positions) == len(currents) == len(self._names):
            return {}  # whose readings are missing is not known
        return {
            f"{name}_{what}": float(value)
            for what, values in (("position", positions), ("current", currents))
            for name, value in zip(self._names, values)
            if value is not None and not isnan(value)
        }

    def _answered(self) -> bool:
        """Return whether the last read succeeded: where it failed, the SDK returns old values."""
        parts = (self._hand, getattr(self._hand, "motor_client", None))
        return all(getattr(part, "last_read_ok", True) for part in parts)

    def limit_torques(self, limits: Mapping[str, float]) -> None:
        """Limit the currents of motors to their torques [N m], and of all others to the SDK's
        maximum.
        """
        most = float(self._hand.config.max_current)
        currents = [
            limits.get(name, inf) / self._torque_of.get(name, 1e-300) for name in self._names
        ]
        self._hand.set_max_current([min(current, most) for current in currents])

    def temperatures(self) -> dict[str, float]:
        """Return motor → temperature [°C]."""
        return dict(zip(self._names, self._hand.get_motor_temp()))

    def write(self, goals: Mapping[str, float]) -> None:
        """Send goals: motor → angle [rad]."""
        sent = {n: goals[name] for n, name in zip(self._ids, self._names) if name in goals}
        self._hand.write_motor_pos(list(sent), list(sent.values()))


def motors_of(hand: object, rig: Rig) -> Motors:
    """Return the motors of a hand, whose kind is known by its methods.

    Raises:
        EstimationError: the hand is of no known kind, its SDK is too old, or its motors are not the
            rig's.
    """
    if isinstance(hand, Motors):
        return hand
    if hasattr(getattr(hand, "config", None), "motor_ids"):
        return OrcaMotors(hand, rig)
    raise EstimationError(
        f"{type(hand).__name__} is no hand that distal knows: give an OrcaHand of orca_core, or an "
        "object with the methods of distal.hands.Motors, as in examples/hands/aero_motors.py"
    )


HOT = 65.0
"""Temperature above which a motor is hot [°C]. Source: judgement."""

LOOKS = 1.0
"""Time between two readings of the temperatures [s]. Source: judgement."""


@dataclass(frozen=True)
class HandHealth:
    """State of a hand at its last reading.

    Args:
        word: health of the reading.
        detail: of that word; may be empty.
        silent: motors that do not answer.
        hot: motor → temperature, of the hot ones [°C].
        lost: number of reads at which the SDK failed, since the beginning.
        held_back: goals that are not sent, and why; may be empty.
    """

    word: Health
    detail: str
    silent: tuple[str, ...]
    hot: Mapping[str, float]
    lost: int
    held_back: str = ""

    @property
    def sentence(self) -> str:
        """The whole state of the hand in a line."""
        hot = ", ".join(f"{name} {value:.0f} °C" for name, value in self.hot.items())
        parts = (
            f"{self.word}: {self.detail or HEALTH[self.word]}",
            self.silent and f"no answer from {', '.join(self.silent)}",
            hot and f"hot: {hot}",
            self.held_back,
        )
        return "; ".join(part for part in parts if part)


class Hand:
    """Angles of all joints with their errors, and motions to desired angles, beside the hand's own
    SDK.

    ```python
    # an orca_core.OrcaHand, connected
    hand = distal.hands.Hand(orca_hand, "hand.toml")
    while True:
        hand.update()  # read, estimate; once per period, 100 times a second
        print(hand.get_joint_positions(), hand.health().sentence)
    ```

    `update` does not fail at a lost packet or at a motor that restarts: the filter goes on without
    the missing readings, and `health` says so. Every goal passes a `GoalGate`: motors whose
    readings are lost for 0.1 s stop, and after a second do what the rig's `when_lost` says. Where
    no goal arrives either, no software here can stop a motor: set the watchdog of its servo, if it
    has one.

    Args:
        hand: an `orca_core.OrcaHand`, or an object with `read`, `temperatures` and `write`: see
            `Motors`.
        rig: of that hand, best after `power_on` or `distal calibrate`.
        compensated: whether torque constants follow the motors' temperatures.

    Raises:
        EstimationError: the hand is of no known kind, or its motors are not the rig's.
        RigError: the rig is unknown or wrong.
    """

    def __init__(
        self, hand: object, rig: Rig | str | Path, compensated: bool = False, compiled: bool = True
    ) -> None:
        rig = as_rig(rig)
        self._motors = motors_of(hand, rig)
        self._compiled = compiled
        self._compensated = compensated
        self._use(rig)
        self._temperatures: Mapping[str, float] = {}
        self._looked = -inf
        self._lost = 0
        self._silent = tuple[str, ...]()
        self._limits: Mapping[str, float] = {}
        self._held_back = ""
        self._sent = dict[str, float]()

    def _use(self, rig: Rig, units: LogUnits | None = None) -> None:
        """Begin with a description of the hand, or go on with another one: the motors stay in the
        turns in which they are by the `units`.
        """
        self._rig = rig
        self._live = LiveEstimator(rig, compiled=self._compiled)
        self._monitor = Monitor(self._live)
        # its ranges are those of the rig that was found, by which a motor's turn is known
        self._units = (
            units.followed_by(rig) if units else LogUnits(rig, self._live.channels, doubting=False)
        )
        self._gate = GoalGate(rig)
        self._inverse: LiveInverse | None = None
        self._desired: dict[str, float] = {}
        unknown = (nan,) * len(rig.joints)
        self._reading = Reading(nan, unknown, unknown, "untested", "not updated yet")

    def update(self, time: float | None = None) -> Reading:
        """Read the motors once, estimate, send goals for the angles of `set_joint_positions`, and
        return the reading (SI).

        Args:
            time: stamp of what is read [s]; None takes the clock.
        """
        time = clock.monotonic() if time is None else time
        sample, problem = self._sample(time)
        self._gate.heated(tuple(self._hot))
        if self._inverse is None:
            self._gate.believed(time, sample, self._live.channels)
            self._reading = self._monitor.take(time, sample)
            self._held_back = self._gate.note
            self._limit()
        else:
            command = self._inverse.step(time, self._desired, sample)
            self._reading = command.reading
            self._held_back = command.note
            names = self._rig.drive_names
            self._gate.confirm(self._write(dict(zip(names, command.positions.tolist()))))
            self._limit(self._gate.holding)
        for motors, what in (
            (self._units.restarts, " counts from another turn: it restarted"),
            (self._units.in_doubt, ": in which of its turns, is not known; it gets no goal"),
        ):
            if motors:
                detail = ", ".join(motors) + what
                self._reading = replace(self._reading, health="restarted", detail=detail)
        if problem and self._reading.health in ("ok", "untested", "bad"):
            word: Health = "bad" if self._reading.health == "bad" else "missing"
            self._reading = replace(self._reading, health=word, detail=problem)
        return self._reading

    def _sample(self, time: float) -> tuple[Floats, str]:
        """Return a sample in SI, and in words why it is incomplete; empty where it is not."""
        problem = ""
        values = dict[str, float]()
        # the clock may have been set back, or be another one
        if not self._looked <= time < self._looked + LOOKS:
            self._look(time)
        try:
            values = dict(self._motors.read())
        except DistalError:
            raise
        except Exception as failure:  # serial ports and their packages raise many kinds
            self._lost += 1
            problem = f"the hand did not answer ({type(failure).__name__}: {failure})"
        known = {*self._units.columns, *self._units.channels}
        read = {name: value for name, value in values.items() if name in known}
        if values and not read:
            problem = (
                f"'{next(iter(values))}' was read, no column of the rig: "
                f"{', '.join(self._units.columns[:4])}, …"
            )
        positions = self._rig.sensors_of("position")
        self._silent = tuple(s.of for s in positions if s.log_column not in read)
        try:
            temperatures = self._temperatures if self._compensated else None
            sample = self._units.sample(time, read, temperatures)
        except EstimationError as wrong:
            self._lost += 1
            return np.full(len(self._units.channels), nan), str(wrong)
        for sensor in positions:
            if sensor.of in self._units.in_doubt:
                sample[self._units.channels.index(sensor.name)] = nan
        return sample, problem

    def _look(self, time: float) -> None:
        """Read the motors' temperatures; a value that is no temperature is left out."""
        self._looked = time
        try:
            self._temperatures = {
                name: float(value)
                for name, value in self._motors.temperatures().items()
                if name in self._rig.drive_names
                and isinstance(value, (int, float, np.number))
                and abs(value) <= HOTTEST
            }
        except DistalError:
            raise
        except Exception:  # a read that is lost; the last ones hold until the next look
            self._lost += 1

    def get_joint_positions(self) -> dict[str, float]:
        """Return joint → angle [deg] at the last `update`; NaN before the first, and where there
        was no estimate.
        """
        return self._degrees(self._reading.angles)

    def get_joint_stds(self) -> dict[str, float]:
        """Return joint → standard deviation of its angle [deg] at the last `update`."""
        return self._degrees(self._reading.angle_stds)

    def _degrees(self, values: tuple[float, ...]) -> dict[str, float]:
        return dict(zip(self._rig.joint_names, map(degrees, values)))

    @property
    def _hot(self) -> dict[str, float]:
        return {name: value for name, value in self._temperatures.items() if value > HOT}

    @property
    def rig(self) -> Rig:
        """Description of the hand, after `power_on` the calibrated one."""
        return self._rig

    def health(self) -> HandHealth:
        """Return the state of the hand at the last `update`."""
        last = self._reading
        return HandHealth(
            last.health, last.detail, self._silent, self._hot, self._lost, self._held_back
        )

    def set_joint_positions(self, positions: Mapping[str, float]) -> None:
        """Set desired angles: each `update` then sends goals that bring the joints there, with
        backlash, stretch and friction compensated.

        Joints that are left out keep their desired angles, or else the angles that they have. A
        joint that follows another one cannot have a desired angle.

        Args:
            positions: joint → desired angle [deg].

        Raises:
            CommandError: a name is unknown, an angle is no number or beyond the joint's range, or
                the angles or a motor's zero are not known yet.
        """
        if not all(map(isfinite, self._reading.angles)):
            raise CommandError(
                "where the hand is, is not known yet: call update until it has angles"
            )
        if self._units.in_doubt:
            names = ", ".join(self._units.in_doubt)
            raise CommandError(f"in which of its turns {names} is, is not known: call power_on")
        unknown = _without_zero(self._rig)
        if unknown:
            raise CommandError(
                f"where {', '.join(unknown[:3])} have their zero is not known, so nothing is sent: "
                "call power_on, or take the rig that distal calibrate wrote"
            )
        ranges = {joint.name: joint.travel for joint in self._rig.joints if joint.coupled is None}
        angles = dict(zip(self._rig.joint_names, self._reading.angles))
        desired = {name: angles[name] for name in ranges} | self._desired
        for name, angle in positions.items():
            if name in angles and name not in ranges:
                raise CommandError(
                    f"'{name}' follows another joint and is not moved by itself: want an angle of "
                    "that one"
                )
            if name not in ranges:
                raise CommandError(f"there is no joint '{name}'{did_you_mean(name, ranges)}")
            low, high = (degrees(end) for end in ranges[name])
            if (
                not isinstance(angle, (int, float, np.number))
                or not low - 1.0 <= angle <= high + 1.0
            ):
                raise CommandError(f"'{name}' turns from {low:.4g}° to {high:.4g}°, {angle!r} came")
            desired[name] = radians(float(np.clip(angle, low, high)))
        self._desired = desired
        if self._inverse is None:
            self._inverse = LiveInverse(self._rig, compiled=self._compiled, gate=self._gate)
            self._inverse.estimator.reset(self._reading.angles, max(self._reading.angle_stds))

    @property
    def restarted(self) -> tuple[str, ...]:
        """The motors that, by the last `update`, count from another turn, or may do so."""
        return (*self._units.restarts, *self._units.in_doubt)

    @property
    def zeros(self) -> dict[str, float]:
        """Motor → what its sensor reads where the rig has zero, in the unit of the log: it changes
        where the motor counts from another turn.
        """
        return {s.of: self._units.logged(s.name, 0.0) for s in self._rig.sensors_of("position")}

    def relax(self) -> None:
        """Drop all desired angles: `update` then sends no goals."""
        self._inverse = None
        self._desired = {}
        self._gate.release()

    def _write(self, goals: Mapping[str, float]) -> bool:
        """Send the goals that are known [rad], in the unit of the log; return whether that
        worked.
        """
        # a motor that does not answer keeps its goal without being told again: if it restarts, it
        # may count from another turn
        held_back = {name for name in self._silent if goals[name] == self._sent.get(name)}
        held_back.update(self._units.in_doubt)
        sent = {
            sensor.of: self._units.logged(sensor.name, goals[sensor.of])
            for sensor in self._rig.sensors_of("position")
            if isfinite(goals[sensor.of]) and sensor.of not in held_back
        }
        try:
            if sent:
                self._motors.write(sent)
                self._sent |= {name: goals[name] for name in sent}
        except Exception:  # the next period sends it again
            self._lost += 1
            return False
        return True

    def _limit(self, holding: Floats | float = inf) -> None:
        """Limit the torques of motors that stand [N m] to what they hold, where servos have a
        limit.
        """
        most = holding + CLEARLY * by_drive(self._rig, "force", lambda sensor: sensor.noise, 0.0)
        torques = zip(self._rig.drive_names, most.tolist())
        limits = {name: torque for name, torque in torques if isfinite(torque)}
        if limits == self._limits or not hasattr(self._motors, "limit_torques"):
            return
        try:
            self._motors.limit_torques(limits)
            self._limits = limits
        except Exception:  # the next period says it again
            self._lost += 1

    def power_on(
        self,
        options: RoutineOptions | None = None,
        period: float = 0.01,
        show: Callable[[str], None] | None = None,
        record: str | Path | None = None,
        sleep: Callable[[float], None] = clock.sleep,
        now: Callable[[], float] = clock.monotonic,
    ) -> Calibrated:
        """Move each motor slowly to both ends and back, calibrate, and go on with the calibrated
        rig.

        Args:
            options: order, limits, speed; see `RoutineOptions`.
            period: of goals and readings [s].
            show: called with the names of the motors that move, each time they change.
            record: file for what was read, as a log for `distal calibrate`; it is written if the
                routine is aborted too.
            sleep: function that waits [s]; with `now`, for hands that are simulated.
            now: function that returns the time [s].

        Raises:
            CommandError: the routine was aborted, or no motor came to its end; the message says
                why. The motors stay where they are.
            FitError: no rig with these motors moves as the hand does.
            OutputError: the record cannot be written; this is checked before a motor moves. If
                writing fails afterwards, the notes of what is returned say so.
        """
        if record is not None:
            check_outputs([Path(record)])
        routine = Routine(self._rig, options)
        shown = tuple[str, ...]()
        # the motors' travel is what the routine finds out: nothing is put into it
        self._units = LogUnits(self._rig, self._live.channels, ranged=False, doubting=False)
        begin = now()
        try:
            while not routine.done:
                self._limit()  # that of motors that stood
                time = now() - begin
                sample, _ = self._sample(time)
                for name, value in self._hot.items():
                    routine.fail(name, f"it is hot, {value:.0f} °C")
                goals = routine.step(time, dict(zip(self._units.channels, sample.tolist())))
                routine.confirm(self._write(goals))
                if show is not None and routine.moving != shown:
                    shown = routine.moving
                    if shown:
                        show(", ".join(shown))
                sleep(max(0.0, begin + time + period - now()))
        except BaseException as ended:  # Ctrl-C too, wherever it comes: no motor may go on pushing
            routine.abort("interrupted" if isinstance(ended, KeyboardInterrupt) else str(ended))
            self._write(routine.goals)
            if not isinstance(ended, KeyboardInterrupt):
                raise
        finally:
            units = self._units
            self._units = self._units.followed_by(self._rig)
        if routine.aborted:
            self._write(routine.goals)  # the first time it may have been lost
        notes = list[str]()
        if record is not None and any(map(isfinite, routine.goals.values())):
            try:
                write_log(routine.log(), self._rig, record)
            except DistalError as problem:  # it does not end a calibration
                notes.append(f"the record was not kept: {problem}")
        if routine.aborted:
            raise CommandError(f"the power-on routine was aborted: {routine.aborted}")
        if len(routine.failed) == len(self._rig.drives):
            why = "; ".join(f"{name}: {said}" for name, said in routine.failed.items())
            raise CommandError(f"no motor came to the end of its power-on routine: {why}")
        found = calibrate(routine.log(), self._rig, stopped=routine.failed)
        self._use(found.rig, units)
        return replace(found, notes=(*found.notes, *notes))


def _without_zero(rig: Rig) -> list[str]:
    """Return the motors whose zero is known to no better than `KNOWN` at their joints."""
    zeros = by_drive(rig, "position", lambda sensor: sensor.bias.total_std, inf)
    return [
        drive.name
        for drive, std in zip(rig.drives, zeros)
        if std * drive.lever / rig.tendons_of(drive.name)[0].total_arm > KNOWN
    ]
