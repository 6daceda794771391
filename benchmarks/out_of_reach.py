"""Wanted angles that drives, stops and limits do not allow: is it said, and is the angle that is
reached the stated one? `python -m benchmarks.out_of_reach [--cases N] [--first-seed N]`.

Each case is a shipped rig with drives that end early, go slowly or pull little, and a wanted angle
that may be beyond what they can do. A servo without limits takes the plant's drives to the places
that are sent, as the drives' own ranges allow.
"""

from __future__ import annotations

import argparse
import warnings
from dataclasses import dataclass

import numpy as np

from benchmarks.report import table
from distal import Inverse, Rig, load_rig, simulate
from distal.confidence import BAND
from distal.errors import DistalError
from distal.inverse import Commands
from distal.rig import angle_names
from distal.simulation import build_scenario

RIGS = (
    "capstan-joint",
    "finger-2n",
    "finger-n-plus-1",
    "finger-underactuated",
    "lab-bench",
    "paper-2008",
    "pulley-antagonist",
    "wrist-instrument",
)
GETS_THERE, RESTS = 1.5, 1.5
"""Time of the motion, and of the rest after it [s]."""

SERVO = {
    "slider": {"stiffness": 3e5, "damping": 120.0},
    "capstan": {"stiffness": 60.0, "damping": 0.03},
}
"""Gains of servos that leave drives where they are sent."""

MISSES = float(np.deg2rad(0.5))
"""A joint that is off by more has to be spoken of [rad]."""


@dataclass(frozen=True)
class Case:
    """One case: whether what is wanted is missed in the plant, whether that was said, and whether
    the angles are in their stated bands.
    """

    name: str
    kind: str
    missed: bool
    said: bool
    inside: bool
    away: float


def case_of(seed: int) -> Case | None:
    """Return what came of a case; None where the rig cannot be like that."""
    rng = np.random.default_rng([seed, 53])
    name, kind = str(rng.choice(RIGS)), str(rng.choice(["drive stops", "force limit", "wide"]))
    rig = load_rig(name)
    free = Inverse(rig, compiled=False)
    ends = [joint.stops or (-0.8, 0.8) for joint in rig.joints]
    low, high = np.array([ends[j] for j in free.model.free]).T
    reach = 1.3 if kind == "wide" else 0.9
    middle, half = (low + high) / 2, (high - low) / 2
    desired = middle + reach * half * rng.uniform(-1, 1, len(low))
    time = np.linspace(0.0, GETS_THERE, 60)
    way = 0.5 - 0.5 * np.cos(np.pi * time / GETS_THERE)
    begin = np.clip(0.0, low, high)
    angles = begin + way[:, None] * (desired - begin)
    full = free(time, angles)
    changed = narrowed(rig, full, kind, float(rng.uniform(0.2, 0.9)))
    inverse = Inverse(changed, compiled=False)
    commands = inverse(time, angles)
    reached = plant(changed, commands)
    if reached is None:
        return None
    error = reached - commands.angles[-1]
    missed = bool(
        np.abs(reached - commands.desired[-1]).max() > MISSES + 2 * commands.stds[-1].max()
    )
    inside = np.abs(error) <= BAND * commands.stds[-1] + 1e-3
    away = float(np.rad2deg(np.abs(error)).max())
    return Case(name, kind, missed, bool(commands.notes), bool(inside.all()), away)


def narrowed(rig: Rig, full: Commands, kind: str, share: float) -> Rig:
    """Return the rig with drives that end, or pull, at a share of what the motion needs."""
    values = dict[str, object]()
    for i, drive in enumerate(rig.drives):
        if kind == "drive stops":
            positions = full.positions[:, i]
            low, high = float(positions.min()), float(positions.max())
            first = float(positions[0])
            ends = sorted((first + share * (low - first), first + share * (high - first)))
            values[f"drives.{drive.name}.stops"] = [ends[0] - 1e-4, ends[1] + 1e-4]
        elif kind == "force limit":
            values[f"drives.{drive.name}.limit"] = share * float(np.abs(full.forces[:, i]).max())
    return rig.with_values(values) if values else rig


def plant(rig: Rig, commands: Commands) -> np.ndarray | None:
    """Return where the joints rest, (n_joints,) [rad]."""
    drives = {}
    for i, drive in enumerate(rig.drives):
        unit = "m" if drive.kind == "slider" else "rad"
        rows = zip(commands.time, commands.positions[:, i])
        way = [[f"{t:.6g} s", f"{position:.9g} {unit}"] for t, position in rows]
        key = "position" if drive.kind == "slider" else "angle"
        drives[drive.name] = {"servo": {key: way, **SERVO[drive.kind]}}
    initial = {
        joint.name: f"{angle:.9g} rad" for joint, angle in zip(rig.joints, commands.angles[0])
    }
    raw = {
        "rig": "paper-2008",
        "duration": GETS_THERE + RESTS,
        "drives": drives,
        "initial": initial,
    }
    try:
        log = simulate(rig, build_scenario(raw, "out of reach"), seed=1)
    except DistalError as problem:
        print(problem)
        return None
    names = angle_names([joint.name for joint in rig.joints])
    return np.array([float(log.truth[name][-1]) for name in names])


def main() -> None:
    """Print what came of all cases."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.out_of_reach", description=__doc__)
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--first-seed", type=int, default=0)
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    seeds = range(asked.first_seed, asked.first_seed + asked.cases)
    found = [case for case in map(case_of, seeds) if case is not None]
    rows = []
    for kind in ("drive stops", "force limit", "wide", "all"):
        chosen = [case for case in found if kind in ("all", case.kind)]
        missed = [case for case in chosen if case.missed]
        rows.append(
            [
                kind,
                str(len(chosen)),
                str(len(missed)),
                str(sum(case.said for case in missed)),
                f"{100 * np.mean([case.inside for case in chosen]):.0f}",
                f"{np.median([case.away for case in chosen]):.2f}",
            ]
        )
    columns = ("kind", "cases", "missed", "said", "inside the band [%]", "median away [°]")
    table("out-of-reach", "Wanted angles out of reach", columns, rows)
    for case in found:
        if not case.inside or (case.missed and not case.said):
            print(case)


if __name__ == "__main__":
    main()
