"""Faults during the power-on routine: what becomes of the joints without one, and what is said.
`python -m benchmarks.power_on_faults [--hands N] [--first-seed N]`.

Hands of two joints from `tests.support.servo_hands`. Each hand is run twice side by side: as it is,
and with a fault, of its first motor unless reads are lost, which is of both.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from math import nan, pi

import numpy as np
from tests.support.hands import Driven, rig_of
from tests.support.servo_hands import PERIOD, Known, orca_like

from benchmarks.report import table
from distal import Rig
from distal.errors import DistalError
from distal.hands import Calibrated, Routine, calibrate

JOINTS = ("index_mcp", "ring_abd")
KINDS = ("lost reads", "blocked", "other radius", "stands still", "restart", "no current")
TRUE_WORDS = {
    "blocked": ("side",),
    "other radius": ("side", "slack"),
    "stands still": ("stopped",),
    "restart": ("stopped", "slipped"),
    "no current": ("stopped",),
}
"""Kinds of fault that are a true word."""

RADII = ("drives", "radius"), ("sensors", "bias")
MOST = 120.0
"""No routine of two motors lasts longer [s]."""


@dataclass(frozen=True)
class Spoiled:
    """What goes wrong, how much, and when [s]."""

    kind: str
    size: float
    at: float
    rng: np.random.Generator


def drawn(seed: int) -> Spoiled:
    """Return the fault of a hand."""
    rng = np.random.default_rng([seed, 61])
    kind = KINDS[seed % len(KINDS)]
    size = {
        "lost reads": rng.uniform(0.05, 0.3),
        "blocked": rng.uniform(0.6, 0.85),
        "other radius": rng.choice([rng.uniform(0.6, 0.8), rng.uniform(1.2, 1.4)]),
    }.get(kind, 1.0)
    return Spoiled(kind, float(size), float(rng.uniform(1.0, 6.0)), rng)


def run(seeds: Sequence[int]) -> list[tuple[Spoiled, Calibrated | None, Calibrated | None, Rig]]:
    """Return for each hand its fault, its calibrations without and with it, and its rig."""
    known, hands = orca_like([seed for seed in seeds for _ in range(2)], JOINTS)
    faults, rig = [drawn(seed) for seed in seeds], rig_of(known)
    rigs = [rig] * (2 * len(seeds))
    for k, fault in enumerate(faults):
        row = 2 * k + 1
        if fault.kind == "blocked":
            hands.d.high[row, 0] *= fault.size
            hands.d.low[row, 0] *= fault.size
        if fault.kind == "other radius":
            radius = rig.drives[0].radius.value
            rigs[row] = rig.with_values({f"drives.{known.motors[0]}.radius": fault.size * radius})
    routines = [Routine(one) for one in rigs]
    driven = Driven(hands)
    positions = hands.positions + hands.d.zeros * hands.d.signs
    torques, held, k = np.zeros_like(positions), positions.copy(), 0
    while not all(routine.done for routine in routines) and k < MOST / PERIOD:
        goals = held.copy()
        for row, routine in enumerate(routines):
            fault = faults[row // 2] if row % 2 else None
            sample = sample_of(known, positions[row], torques[row], fault, k * PERIOD)
            sent = routine.step(k * PERIOD, sample)
            for m, motor in enumerate(known.motors):
                turned = turned_by(fault, m, k * PERIOD)
                if np.isfinite(sent[motor]) and not (
                    fault and fault.kind == "stands still" and not m
                ):
                    goals[row, m] = sent[motor] - turned
        held = goals
        positions, torques = driven.read(goals)
        k += 1
    return [
        (
            fault,
            *(found_of(routines[2 * k + i], rigs[2 * k + i]) for i in range(2)),
            rigs[2 * k + 1],
        )
        for k, fault in enumerate(faults)
    ]


def turned_by(fault: Spoiled | None, motor: int, time: float) -> float:
    """Return by how much a motor that restarted counts anew [rad]."""
    restarted = fault is not None and fault.kind == "restart" and motor == 0 and time >= fault.at
    return 2 * pi if restarted else 0.0


def sample_of(
    known: Known, positions: np.ndarray, torques: np.ndarray, fault: Spoiled | None, time: float
) -> dict[str, float]:
    """Return what a routine reads of one hand."""
    sample = {}
    for m, motor in enumerate(known.motors):
        sample[f"{motor}_position"] = float(positions[m]) + turned_by(fault, m, time)
        sample[f"{motor}_current"] = float(torques[m])
        if fault is None:
            continue
        if fault.kind == "lost reads" and fault.rng.random() < fault.size:
            sample[f"{motor}_position"] = sample[f"{motor}_current"] = nan
        if fault.kind == "no current" and m == 0:
            sample[f"{motor}_current"] = 0.0
    return sample


def found_of(routine: Routine, rig: Rig) -> Calibrated | None:
    """Return what a routine found; None where it found nothing."""
    try:
        return calibrate(routine.log(), rig, stopped=routine.failed)
    except DistalError as problem:
        print(problem)
        return None


def apart(one: Rig, other: Rig, motor: int) -> float:
    """Return by how many stds of the first the numbers of a motor differ, the most."""
    worst = 0.0
    name = one.drives[motor].name
    pairs = [(a.radius, b.radius) for a, b in zip(one.drives, other.drives) if a.name == name]
    pairs += [
        (a.bias, b.bias)
        for a, b in zip(one.sensors_of("position"), other.sensors_of("position"))
        if a.of == name
    ]
    for was, now in pairs:
        worst = max(worst, abs(now.value - was.value) / max(was.std, 1e-12))
    return worst


def main() -> None:
    """Print what was found."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.power_on_faults", description=__doc__
    )
    parser.add_argument("--hands", type=int, default=60)
    parser.add_argument("--first-seed", type=int, default=0)
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = dict[str, list[list[float]]]()
    for fault, twin, found, _ in run(range(asked.first_seed, asked.first_seed + asked.hands)):
        assert twin is not None
        sound = (0, 1) if fault.kind == "lost reads" else (1,)
        names = [twin.rig.drives[m].name for m in sound]
        words = [] if found is None else list(found.faults)
        of_first = [one for one in words if one.drive not in names]
        false = [one for one in words if one.drive in names] + [
            one
            for one in of_first
            if one.kind not in TRUE_WORDS.get(fault.kind, ())
            and not (fault.kind == "other radius" and "radii are others" in one.sentence)
        ]
        kept = [found is not None and apart(twin.rig, found.rig, m) <= 2.0 for m in sound]
        named = bool(of_first) and not false if fault.kind != "lost reads" else not false
        rows.setdefault(fault.kind, []).append([np.mean(kept), named, len(false)])
        for one in false:
            print(fault.kind, round(fault.size, 2), one.sentence)
        if not all(kept):
            away = [nan if found is None else apart(twin.rig, found.rig, m) for m in sound]
            print(fault.kind, round(fault.size, 2), "stds apart:", np.round(away, 1))
    lines = [
        [kind, str(len(held)), *(f"{100 * np.mean(column):.0f}" for column in zip(*held))]
        for kind, held in rows.items()
    ]
    columns = (
        "fault",
        "hands",
        "other joints within two stds [%]",
        "right words [%]",
        "false words [%]",
    )
    table("power-on-faults", "Faults during the power-on routine", columns, lines)


if __name__ == "__main__":
    main()
