"""The motors of a hand as its own SDK gives them: readings, temperatures, goals. `distal` imports
no SDK.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import inf, isfinite, nan
from typing import Protocol, runtime_checkable

from distal.errors import EstimationError
from distal.rig import Rig, log_factor


@runtime_checkable
class Motors(Protocol):
    """What a `Hand` needs of any other hand: write these three methods for it."""

    def read(self) -> Mapping[str, float]:
        """Return column of the rig → what is read, in the unit of the log; a motor that does not
        answer is left out.
        """

    def temperatures(self) -> Mapping[str, float]:
        """Return motor → temperature [°C]; none where nothing measures it."""

    def write(self, goals: Mapping[str, float]) -> None:
        """Send goals: motor → angle, in the unit in which its position is read."""


class Numbered(Protocol):
    """The part of an ORCA hand's configuration that is used."""

    motor_ids: Sequence[int]
    max_current: float


@runtime_checkable
class TorqueLimited(Protocol):
    """What `Motors` may have too, where the servos have a limit of their own."""

    def limit_torques(self, limits: Mapping[str, float]) -> None:
        """Let these motors pull no more than that [N m], and all others what they usually may."""


@runtime_checkable
class OrcaLike(Protocol):
    """What is used of `orca_core.OrcaHand` (0.4 on): motors by number, radians, milliamperes."""

    config: Numbered

    def get_motor_pos(self) -> Iterable[float]:
        """Return positions [rad], in the order of `config.motor_ids`."""

    def get_motor_current(self) -> Iterable[float]:
        """Return currents [mA], in that order."""

    def set_max_current(self, current: list[float]) -> None:
        """Limit the motors' currents [mA]."""

    def get_motor_temp(self) -> Iterable[float]:
        """Return temperatures [°C], in that order."""

    def write_motor_pos(self, motor_ids: list[int], positions: list[float]) -> None:
        """Send angles [rad], the `positions` of these motors."""


@runtime_checkable
class AeroLike(Protocol):
    """What is used of `aero_open_sdk.AeroHand`: actuations in degrees, milliamperes."""

    def get_actuations(self) -> Sequence[float]:
        """Return the motors' angles [deg]."""

    def get_actuator_currents(self) -> Sequence[float]:
        """Return their currents [mA]."""

    def get_actuator_temperatures(self) -> Sequence[float]:
        """Return their temperatures [°C]."""

    def set_actuations(self, actuations: list[float]) -> None:
        """Send angles [deg]."""


ORCA_METHODS = (
    "get_motor_pos",
    "get_motor_current",
    "get_motor_temp",
    "write_motor_pos",
    "set_max_current",
)

LEAST_ORCA = "0.4.0"
"""The first release of orca_core with all of them."""


class OrcaMotors:
    """The motors of an ORCA hand, as columns of a rig made by `from_orca`."""

    def __init__(self, hand: OrcaLike, rig: Rig) -> None:
        self._hand = hand
        self._ids = [int(number) for number in hand.config.motor_ids]
        self._names = _known(rig, [f"motor_{number}" for number in self._ids])
        self._torque_of = {s.of: abs(log_factor(s)) for s in rig.sensors_of("force")}

    def read(self) -> dict[str, float]:
        """Return positions [rad] and currents [mA]; a read that failed gives none."""
        positions = list(self._hand.get_motor_pos())
        answered = self._answered()
        currents = list(self._hand.get_motor_current())
        return _columns(self._names, positions, currents) if answered and self._answered() else {}

    def _answered(self) -> bool:
        """Return whether the last read was one: the SDK returns old values where it failed."""
        parts = (self._hand, getattr(self._hand, "motor_client", None))
        return all(getattr(part, "last_read_ok", True) for part in parts)

    def limit_torques(self, limits: Mapping[str, float]) -> None:
        """Limit the currents of motors by torques [N m]; of the others to what the SDK has."""
        most = float(self._hand.config.max_current)
        currents = [
            limits.get(name, inf) / self._torque_of.get(name, 1e-300) for name in self._names
        ]
        self._hand.set_max_current([min(current, most) for current in currents])

    def temperatures(self) -> dict[str, float]:
        """Return motor → temperature [°C]."""
        return _named(self._names, self._hand.get_motor_temp())

    def write(self, goals: Mapping[str, float]) -> None:
        """Send angles [rad]."""
        sent = [
            (number, goals[name]) for number, name in zip(self._ids, self._names) if name in goals
        ]
        self._hand.write_motor_pos([number for number, _ in sent], [goal for _, goal in sent])


class AeroMotors:
    """The motors of an Aero Hand, as columns of a rig made by `from_aero`."""

    def __init__(self, hand: AeroLike, rig: Rig) -> None:
        self._hand = hand
        self._names = rig.drive_names
        self._last = dict.fromkeys(self._names, nan)
        self._sent = dict[str, float]()

    def read(self) -> dict[str, float]:
        """Return actuations [deg] and currents [mA]."""
        found = _columns(
            self._names, self._hand.get_actuations(), self._hand.get_actuator_currents()
        )
        self._last |= {
            name: found[f"{name}_position"] for name in self._names if f"{name}_position" in found
        }
        return found

    def temperatures(self) -> dict[str, float]:
        """Return motor → temperature [°C]."""
        return _named(self._names, self._hand.get_actuator_temperatures())

    def write(self, goals: Mapping[str, float]) -> None:
        """Send actuations [deg]; a motor without a goal keeps the one that it was sent last.

        The SDK sends all motors at once. One that was never sent a goal is sent where it was read
        last; while one has neither, nothing is sent. Where a motor is read is not sent again and
        again: it gives way under its load, and would sink a little each time.
        """
        for name in self._names:
            goal = goals.get(name, nan)
            if isfinite(goal):
                self._sent[name] = float(goal)
            elif name not in self._sent and isfinite(self._last[name]):
                self._sent[name] = self._last[name]
        if len(self._sent) == len(self._names):
            self._hand.set_actuations([self._sent[name] for name in self._names])


def motors_of(hand: object, rig: Rig) -> Motors:
    """Return the motors of a hand by what it can do.

    Raises:
        EstimationError: it is no hand that is known, of a version that is too old, or not the
            rig's.
    """
    if isinstance(hand, Motors):
        return hand
    if isinstance(hand, OrcaLike):
        return OrcaMotors(hand, rig)
    if isinstance(hand, AeroLike):
        return AeroMotors(hand, rig)
    lacks = [name for name in ORCA_METHODS if not hasattr(hand, name)]
    if hasattr(getattr(hand, "config", None), "motor_ids"):
        raise EstimationError(
            f"{type(hand).__name__} has no {lacks[0]}: it needs orca_core {LEAST_ORCA} or newer"
        )
    raise EstimationError(
        f"{type(hand).__name__} is no hand that distal knows: it takes OrcaHand of orca_core, "
        "AeroHand of its SDK, or an "
        "object with read, temperatures and write (distal.hands.Motors)"
    )


def _known(rig: Rig, names: list[str]) -> list[str]:
    drives = rig.drive_names
    unknown = [name for name in drives if name not in names]
    if unknown:
        raise EstimationError(
            f"the rig '{rig.name}' has a motor '{unknown[0]}' that this hand has not: "
            f"{', '.join(names)}"
        )
    return names


def _columns(
    names: Sequence[str], positions: Iterable[float], currents: Iterable[float]
) -> dict[str, float]:
    found = dict[str, float]()
    for name, position, current in zip(names, positions, currents):
        for column, value in ((f"{name}_position", position), (f"{name}_current", current)):
            if value is not None and float(value) == float(value):
                found[column] = float(value)
    return found


def _named(names: Sequence[str], values: Iterable[float]) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, values) if value is not None}
