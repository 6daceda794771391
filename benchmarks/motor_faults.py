"""Faults of a hand's readings and goals while it moves: `python -m benchmarks.motor_faults
[--episodes N] [--first-seed N]`.

Two joints of the hands in `tests.support.servo_hands`, which share no code with the model, behind
`distal.hands.Hand`. Each goes to two drawn angles; something goes wrong at a drawn time, and the
plant says what came of it, beside its twin to which nothing happened.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from tests.support.hands import rig_of
from tests.support.servo_hands import PERIOD, TORQUE_CONSTANT, Hands, Known, orca_like

from benchmarks.report import table
from distal import Rig
from distal.hands import Hand

JOINTS = ("index_mcp", "index_pip")
BATCH, SECONDS = 40, 4.0
PLANTS = 20
"""So many plants: a kernel is compiled for each."""

FIRST, SECOND = 0.5, 2.0
"""When the two angles are wanted [s]."""

STANDS, LIMIT = 0.05, 0.8
"""A motor that is slower stands [rad/s]; its largest torque [N m]."""

LOST = ("lost reads", "lost bursts")


@dataclass
class Fault:
    """What goes wrong from `begin` for `lasts` [s], at a motor, or at all where it is −1."""

    kind: str
    begin: float
    lasts: float
    motor: int
    size: float
    rng: np.random.Generator = field(repr=False)

    def at(self, time: float) -> bool:
        """Return whether it is there."""
        return self.begin <= time < self.begin + self.lasts

    def strikes(self, motor: int) -> bool:
        """Return whether it is at a motor."""
        return self.motor in (-1, motor)


def drawn(seed: int) -> Fault:
    """Return a fault; single lost reads are the usual."""
    rng = np.random.default_rng([seed, 31])
    kind = str(rng.choice([*KINDS, "lost reads"]))
    lasts = float(np.exp(rng.uniform(np.log(0.02), np.log(3.0))))
    size = float(rng.choice([-1, 1]) * np.exp(rng.uniform(np.log(0.3), np.log(6.0))))
    if kind == "lost reads":
        lasts, size = SECONDS, float(rng.uniform(0.02, 0.2))
    motor = int(rng.integers(-1, len(JOINTS)))
    return Fault(kind, float(rng.uniform(0.3, 3.0)), lasts, motor, size, rng)


class Wired:
    """One hand of the plant as an SDK of one's own; its reads and writes go through a fault."""

    def __init__(self, plant: Plant, row: int, fault: Fault | None) -> None:
        self.plant, self.row, self.fault = plant, row, fault
        self.time, self.old = 0.0, [dict[str, float]()]

    def _now(self, *kinds: str) -> bool:
        fault = self.fault
        return fault is not None and fault.kind in kinds and fault.at(self.time)

    def read(self) -> Mapping[str, float]:
        """Return what is read."""
        fault = self.fault
        if self._now("exception"):
            raise OSError("no answer")
        found = self.plant.readings(self.row)
        self.old.append(found)
        if fault is None:
            return found
        if self._now("stale"):
            before = next(k for k, one in enumerate(self.old) if one)
            since = max(before, len(self.old) - 1 - round((self.time - fault.begin) / PERIOD))
            return self.old[since]
        if self._now("wrong order") and len(self.old) > 8 and fault.rng.random() < 0.3:
            return self.old[-int(fault.rng.integers(2, 8))]
        for m, name in enumerate(self.plant.known.motors):
            if not fault.strikes(m):
                continue
            position = f"{name}_position"
            if self._now("lost reads") and fault.rng.random() < fault.size:
                found = {key: value for key, value in found.items() if not key.startswith(name)}
            if self._now("lost bursts"):
                found = {key: value for key, value in found.items() if not key.startswith(name)}
            if self._now("NaN"):
                found[position] = float("nan")
            if self._now("jump"):
                found[position] += fault.size
            if fault.kind == "restart" and self.time >= fault.begin:
                turned = found[position] + self._turned(m)
                found[position] = float("nan") if self._boots(m) else turned
        return found

    def _boots(self, motor: int) -> bool:
        """Return whether a motor restarts now: it does not answer, takes no goal, and holds."""
        fault = self.fault
        if fault is None or fault.kind != "restart" or not fault.strikes(motor):
            return False
        return 0.0 <= self.time - fault.begin < min(fault.lasts, 1.0)

    def _turned(self, motor: int) -> float:
        """Return by how much a motor counts anew, both ways of which are one turn."""
        fault = self.fault
        if fault is None or fault.kind != "restart" or not fault.strikes(motor):
            return 0.0
        return float(np.sign(fault.size) * 2 * np.pi) if self.time >= fault.begin else 0.0

    def temperatures(self) -> Mapping[str, float]:
        """Return none."""
        if self._now("exception"):
            raise OSError("no answer")
        return {}

    def write(self, goals: Mapping[str, float]) -> None:
        """Send goals, unless something goes wrong."""
        if self._now("write fails"):
            raise OSError("no answer")
        if self._now("lies"):
            return
        for m, name in enumerate(self.plant.known.motors):
            if name in goals and not self._boots(m):
                self.plant.goals[self.row, m] = goals[name] - self._turned(m)


class Plant:
    """Hands side by side."""

    def __init__(self, seeds: range, copies: int) -> None:
        each = [seed % PLANTS for seed in seeds for _ in range(copies)]
        self.known, self.hands = orca_like(each, JOINTS)
        self.signs = self.hands.d.signs
        self.goals = self.hands.positions + self.hands.d.zeros * self.signs
        self.positions, self.torques = self.goals.copy(), np.zeros_like(self.goals)

    def step(self) -> None:
        """Let a period pass."""
        read = self.hands.step(self.goals * self.signs)
        self.positions = read["positions"] * self.signs
        self.torques = TORQUE_CONSTANT * read["currents"] * self.signs

    def readings(self, row: int) -> dict[str, float]:
        """Return what one hand reads."""
        found = {}
        for m, name in enumerate(self.known.motors):
            found[f"{name}_position"] = float(self.positions[row, m])
            found[f"{name}_current"] = float(self.torques[row, m])
        return found


def identified(known: Known, hands: Hands, row: int) -> Rig:
    """Return the rig with what a calibration would find of one hand."""
    d, values = hands.d, dict[str, object]()
    for m, name in enumerate(known.motors):
        ratio = d.spools[row, m, m] / d.arms[row, m, m] * known.arms[m, m]
        values[f"drives.{name}.radius"] = {"value": float(ratio), "std": 0.01 * float(ratio)}
        zero = float(d.zeros[row, m] * d.signs[row, m])
        values[f"sensors.{name}_position.bias"] = {"value": zero, "std": 0.02}
    rig = rig_of(known)
    for tendon in rig.tendons:
        m = known.motors.index(tendon.drive)
        t = m if tendon.winding > 0 else m + len(known.motors)
        slack = max(float(d.slack[row, t]), 0.0)
        values[f"tendons.{tendon.name}.slack"] = {"value": slack, "std": 1e-4}
    return rig.with_values(values)


def run(
    seeds: range, fault_of: Callable[[int], Fault | None], compiled: bool = True
) -> dict[str, Any]:
    """Return what hands did, each beside its twin without a fault: rows 2 k and 2 k + 1."""
    plant = Plant(seeds, 2)
    faults = [fault_of(seed) for seed in seeds]
    wires = [
        Wired(plant, row, faults[row // 2] if row % 2 else None) for row in range(2 * len(seeds))
    ]
    rigs = [identified(plant.known, plant.hands, 2 * k) for k in range(len(seeds))]
    owned = [Hand(wire, rigs[wire.row // 2], compiled=compiled) for wire in wires]
    desired = [np.random.default_rng([seed, 37]).uniform(0.05, 0.95, (2, 2)) for seed in seeds]
    low, high = np.rad2deg(plant.known.low), np.rad2deg(plant.known.high)
    steps = round(SECONDS / PERIOD)
    rows = {name: [] for name in ("angles", "torques", "speeds", "goals")}
    said = np.zeros((steps, len(owned)), dtype=bool)
    for k in range(steps):
        time = k * PERIOD
        for row, (wire, hand) in enumerate(zip(wires, owned)):
            wire.time = time
            if wire._now("late"):
                continue
            reading = hand.update(time)
            health = hand.health()
            said[k, row] = reading.health not in ("ok", "untested") or bool(
                health.held_back or health.silent
            )
            for at, targets in zip((FIRST, SECOND), desired[row // 2]):
                if k == round(at / PERIOD) or (
                    wire.fault is not None and wire.fault.kind == "late" and at < time < at + 3.2
                ):
                    angles = low + (high - low) * targets
                    ask(hand, dict(zip(JOINTS, angles.tolist())))
        plant.step()
        rows["angles"].append(plant.hands.angles.copy())
        rows["torques"].append(plant.hands.torques.copy())
        rows["speeds"].append(plant.hands.speeds.copy())
        rows["goals"].append(plant.goals.copy())
    return {"faults": faults, "said": said} | {name: np.array(one) for name, one in rows.items()}


def ask(hand: Hand, angles: Mapping[str, float]) -> None:
    """Want angles; a hand that does not know where it is refuses."""
    from distal.errors import CommandError

    try:
        hand.set_joint_positions(angles)
    except CommandError:
        return


@dataclass(frozen=True)
class Episode:
    """What came of a fault: motion that nobody asked for [deg], torque at the limit beyond the
    twin's [s], whether it was said, and how far the end is from the twin's [deg].
    """

    kind: str
    unasked: float
    pushed: float
    said: bool
    away: float
    seed: int = 0


def judged(found: dict[str, Any], seeds: range) -> list[Episode]:
    """Return the episodes of a run."""
    episodes = []
    for k, (seed, fault) in enumerate(zip(seeds, found["faults"])):
        begin = int(np.ceil(fault.begin / PERIOD))
        twin, own = (np.rad2deg(found["angles"][:, 2 * k + i]) for i in range(2))
        low = np.minimum.accumulate(np.minimum(twin[begin:], own[begin]))
        high = np.maximum.accumulate(np.maximum(twin[begin:], own[begin]))
        # a motion that begins later overshoots as the twin's did
        rests = twin[[0, round(SECOND / PERIOD) - 1, -1]]
        over = np.maximum(
            twin.max(axis=0) - rests.max(axis=0), rests.min(axis=0) - twin.min(axis=0)
        )
        high, low = high + np.maximum(over, 0.0), low - np.maximum(over, 0.0)
        beyond = np.maximum(np.maximum(own[begin:] - high, low - own[begin:]), 0.0)
        rate = np.abs(np.gradient(own, PERIOD, axis=0))[max(begin - 2, 0) : begin + 1].max(axis=0)
        unasked = float((beyond.max(axis=0) - 0.1 * rate).max())
        pushes = []
        for row in (2 * k, 2 * k + 1):
            stands = np.abs(found["speeds"][:, row]) < STANDS
            pushes.append(
                PERIOD * np.sum(stands & (np.abs(found["torques"][:, row]) > 0.98 * LIMIT), axis=0)
            )
        end = min(begin + round((fault.lasts + 0.5) / PERIOD), len(own))
        # what is shorter than a motor's own lag, and what changes nothing while all stand, needs no
        # word
        ended = min(begin + round(fault.lasts / PERIOD), len(own))
        moved = np.ptp(twin[begin : ended + 1], axis=0).max() > 2.0
        said = bool(found["said"][begin:end, 2 * k + 1].any()) or fault.lasts < 0.15 or not moved
        away = float(np.abs(own[-20:] - twin[-20:]).mean(axis=0).max())
        pushed = float((pushes[1] - pushes[0]).max())
        episodes.append(Episode(fault.kind, unasked, pushed, said, away, seed))
    return episodes


KINDS = (
    "lost reads",
    "lost bursts",
    "NaN",
    "jump",
    "restart",
    "exception",
    "write fails",
    "late",
    "stale",
    "wrong order",
    "lies",
)


def summary(episodes: list[Episode]) -> list[list[str]]:
    """Return a row for each kind of fault."""
    rows, counts = [], Counter(one.kind for one in episodes)
    for kind in (*sorted(counts), "all"):
        chosen = [one for one in episodes if kind in ("all", one.kind)]
        unasked = np.array([one.unasked for one in chosen])
        pushed = np.array([one.pushed for one in chosen])
        away = np.array([one.away for one in chosen])
        rows.append(
            [
                kind,
                str(len(chosen)),
                f"{np.median(unasked):.1f} / {unasked.max():.1f}",
                str(int(np.sum(unasked > 2.0))),
                f"{pushed.max():.2f}",
                str(int(np.sum(pushed > 0.2))),
                str(sum(not one.said for one in chosen)),
                f"{100 * np.mean(away > 0.5):.0f}",
            ]
        )
    return rows


COLUMNS = (
    "fault",
    "episodes",
    "unasked motion, median / worst [°]",
    "above 2°",
    "longest push [s]",
    "above 0.2 s",
    "not said",
    "end 0.5° off [%]",
)


def main() -> None:
    """Print what came of the faults."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.motor_faults", description=__doc__)
    parser.add_argument("--episodes", type=int, default=2000)
    parser.add_argument("--first-seed", type=int, default=2000)
    asked = parser.parse_args()
    episodes = list[Episode]()
    for first in range(asked.first_seed, asked.first_seed + asked.episodes, BATCH):
        last = min(first + BATCH, asked.first_seed + asked.episodes)
        seeds = range(first, last)
        episodes += judged(run(seeds, drawn), seeds)
    table("motor-faults", "Faults while a hand moves", COLUMNS, summary(episodes))


if __name__ == "__main__":
    main()
