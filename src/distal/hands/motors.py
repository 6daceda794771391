"""Motors of a hand through its own SDK: readings, temperatures, goals. `distal` imports no SDK."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import inf
from typing import Protocol, runtime_checkable

from distal.errors import EstimationError
from distal.rig import Rig, log_factor


@runtime_checkable
class Motors(Protocol):
    """Interface of the motors to a `Hand`: for a hand of another kind, write an object with these
    three methods.
    """

    def read(self) -> Mapping[str, float]:
        """Return column of the rig → reading, in the unit of the log; columns of a motor that does
        not answer are left out.
        """

    def temperatures(self) -> Mapping[str, float]:
        """Return motor → temperature [°C]; motors without a measured one are left out."""

    def write(self, goals: Mapping[str, float]) -> None:
        """Send goals: motor → angle, in the unit in which its position is read."""


class Numbered(Protocol):
    """Part of an ORCA hand's configuration that is used here."""

    motor_ids: Sequence[int]
    max_current: float


@runtime_checkable
class TorqueLimited(Protocol):
    """Interface of motors whose servos can limit their own torques; `Motors` may have it too."""

    def limit_torques(self, limits: Mapping[str, float]) -> None:
        """Limit the torques of these motors [N m], and of all others to their usual limits."""


@runtime_checkable
class OrcaLike(Protocol):
    """Part of `orca_core.OrcaHand` (0.4 on) that is used here: motors by number, radians,
    milliamperes.
    """

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


ORCA_METHODS = (
    "get_motor_pos",
    "get_motor_current",
    "get_motor_temp",
    "write_motor_pos",
    "set_max_current",
)

LEAST_ORCA = "0.4.0"
"""First release of orca_core that has all `ORCA_METHODS`."""


class OrcaMotors:
    """The motors of an ORCA hand, as columns of a rig made by `from_orca`."""

    def __init__(self, hand: OrcaLike, rig: Rig) -> None:
        self._hand = hand
        self._ids = [int(number) for number in hand.config.motor_ids]
        self._names = _known(rig, [f"motor_{number}" for number in self._ids])
        self._torque_of = {s.of: abs(log_factor(s)) for s in rig.sensors_of("force")}

    def read(self) -> dict[str, float]:
        """Return positions [rad] and currents [mA] by column; none where a read failed."""
        positions = list(self._hand.get_motor_pos())
        answered = self._answered()
        currents = list(self._hand.get_motor_current())
        return _columns(self._names, positions, currents) if answered and self._answered() else {}

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
        return _named(self._names, self._hand.get_motor_temp())

    def write(self, goals: Mapping[str, float]) -> None:
        """Send goals: motor → angle [rad]."""
        sent = [
            (number, goals[name]) for number, name in zip(self._ids, self._names) if name in goals
        ]
        self._hand.write_motor_pos([number for number, _ in sent], [goal for _, goal in sent])


def motors_of(hand: object, rig: Rig) -> Motors:
    """Return the motors of a hand, whose kind is known by its methods.

    Raises:
        EstimationError: the hand is of no known kind, its SDK is too old, or its motors are not the
            rig's.
    """
    if isinstance(hand, Motors):
        return hand
    if isinstance(hand, OrcaLike):
        return OrcaMotors(hand, rig)
    lacks = [name for name in ORCA_METHODS if not hasattr(hand, name)]
    if hasattr(getattr(hand, "config", None), "motor_ids"):
        raise EstimationError(
            f"{type(hand).__name__} has no {lacks[0]}: it needs orca_core {LEAST_ORCA} or newer"
        )
    raise EstimationError(
        f"{type(hand).__name__} is no hand that distal knows: it takes OrcaHand of orca_core, "
        "or an object with read, temperatures and write (distal.hands.Motors), as "
        "examples/hands/aero_motors.py has for an AeroHand"
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
