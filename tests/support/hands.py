"""Hands of `servo_hands` calibrated by their power-on routine, and logs of what they do then."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from distal import Rig
from distal.hands import Calibrated, Routine, RoutineOptions, calibrate
from distal.logs import Log
from distal.rig.hand_tables import Row, hand_of
from tests.support.servo_hands import PERIOD, TORQUE_CONSTANT, Hands, Known

SECONDS = 30.0
"""Of a motion [s]."""


def rig_of(known: Known) -> Rig:
    """Return the rig as an owner has it from drawings: radii, ranges, which way motors turn."""
    m, rows = len(known.motors), []
    for t, motor in enumerate(known.motors):
        crossed = np.flatnonzero(known.arms[t])
        pair = any(
            np.any(known.arms[k] * known.arms[t] < 0)
            and not np.any(known.arms[k] * known.arms[t] > 0)
            for k in range(m, len(known.arms))
            if np.any(known.arms[k, crossed])
        )
        for j in crossed:
            rows.append(
                Row(
                    joint=known.joints[j],
                    motor=motor,
                    low=float(known.low[j]),
                    high=float(known.high[j]),
                    spool_radius=float(abs(known.spools[t, t])),
                    joint_radius=float(abs(known.arms[t, j])),
                    direction=1 if known.arms[t, j] > 0 else -1,
                    back="tendon" if pair and len(crossed) == 1 else "spring",
                )
            )
    return hand_of(rows, "hand", "table").rig


class Driven:
    """Some hands behind routines or goals; angles as sensors read them in the rig's sign, so that a
    motor winds by +.
    """

    def __init__(self, hands: Hands) -> None:
        self.hands, self.signs = hands, hands.d.signs

    def read(self, goals: Any) -> tuple[Any, Any]:
        """Send goals [rad], let a period pass, and return places and torques by the catalogue's
        constant.
        """
        read = self.hands.step(np.asarray(goals) * self.signs)
        return read["positions"] * self.signs, TORQUE_CONSTANT * read["currents"] * self.signs


def routines_of(known: Known, hands: Hands, rig: Rig, together: bool = False) -> list[Routine]:
    """Run the routine on all hands side by side, one motor after the other or all `together`."""
    driven, count = Driven(hands), len(hands.angles)
    routines = [
        Routine(rig, RoutineOptions(order=[known.motors] if together else None))
        for _ in range(count)
    ]
    names = [(f"{motor}_position", f"{motor}_current") for motor in known.motors]
    positions = hands.positions + hands.d.zeros * hands.d.signs
    torques, k = np.zeros_like(positions), 0
    while not all(routine.done for routine in routines):
        goals = positions.copy()
        for a, routine in enumerate(routines):
            sample = {position: positions[a, m] for m, (position, _) in enumerate(names)}
            sample |= {torque: torques[a, m] for m, (_, torque) in enumerate(names)}
            sent = routine.step(k * PERIOD, sample)
            goals[a] = [sent[motor] for motor in known.motors]
        positions, torques = driven.read(goals)
        k += 1
    for routine in routines:
        if routine.aborted:
            print("aborted:", routine.aborted)
    print(f"routine: {k * PERIOD:.0f} s")
    return routines


def calibrated(
    known: Known, hands: Hands, rig: Rig, together: bool = False
) -> list[tuple[Calibrated, Log]]:
    """Calibrate all hands by their routines, see `routines_of`."""
    routines = routines_of(known, hands, rig, together)
    return [(calibrate(routine.log(), rig), routine.log()) for routine in routines]


def motion(
    known: Known,
    hands: Hands,
    ends: Any,
    seed: int,
    seconds: float = SECONDS,
    at_ends: float = 0.0,
    happens: Callable[[Hands, float], None] = lambda hands, time: None,
) -> dict[str, Any]:
    """Let all motors follow smooth steps between random places within their travel, and record.

    A share of the steps goes to an end of it; `happens` is called before each period.
    """
    rng, driven = np.random.default_rng([seed, 9]), Driven(hands)
    low, high = ends
    positions = hands.positions + hands.d.zeros * hands.d.signs
    begin, goals, left = positions.copy(), positions.copy(), np.zeros_like(positions)
    span, rows = np.ones_like(positions), {"positions": [], "torques": [], "angles": []}
    for k in range(round(seconds / PERIOD)):
        happens(hands, k * PERIOD)
        fresh = left <= 0
        begin = np.where(fresh, goals, begin)
        to = rng.uniform(0.05, 0.95, positions.shape)
        if at_ends:
            to = np.where(rng.random(positions.shape) < at_ends, np.round(to), to)
        goals = np.where(fresh, low + (high - low) * to, goals)
        span = np.where(fresh, rng.uniform(0.6, 2.2, positions.shape), span)
        left = np.where(fresh, span, left) - PERIOD
        share = np.clip((1 - left / span) * 1.2, 0, 1)
        smooth = share**3 * (10 - 15 * share + 6 * share**2)
        positions, torques = driven.read(begin + (goals - begin) * smooth)
        for name, value in (
            ("positions", positions),
            ("torques", torques),
            ("angles", hands.angles.copy()),
        ):
            rows[name].append(value)
    return {name: np.array(values) for name, values in rows.items()}


def log_of(known: Known, run: dict[str, Any], a: int) -> Log:
    """Return the log of one hand."""
    time_ = np.arange(len(run["positions"])) * PERIOD
    channels = {
        f"{motor}_position": run["positions"][:, a, m].copy()
        for m, motor in enumerate(known.motors)
    }
    channels |= {
        f"{motor}_current": run["torques"][:, a, m].copy() for m, motor in enumerate(known.motors)
    }
    return Log(time_, channels, {}, f"hand {a}")


def ratio(known: Known, positions: Any, ends: tuple[Any, Any]) -> Any:
    """Return angles as a hand's own software makes them: each joint's range over the motor's travel
    between its stops.
    """
    low, high = ends
    angles = np.zeros((len(positions), len(known.joints)))
    of_joint = {}
    for t in range(len(known.motors)):
        for j in np.flatnonzero(known.arms[t]):
            # a joint is its own motor's: the one in whose tendon it has the largest share
            arm = abs(known.arms[t, j]) / np.abs(known.arms[t]).sum()
            if arm > of_joint.get(j, (0.0, 0))[0]:
                of_joint[j] = (arm, t)
    for j, (_, t) in of_joint.items():
        share = np.clip((positions[:, t] - low[t]) / (high[t] - low[t]), 0, 1)
        angles[:, j] = known.low[j] + share * (known.high[j] - known.low[j])
    return angles
