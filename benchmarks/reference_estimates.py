"""Whether estimates are still what they were: full estimates of many logs, stored, and compared
later.

`python -m benchmarks.reference_estimates --save FILE` stores the logs and what the estimators
make of them; `--check FILE` runs the estimators again on the *stored* logs and prints the
largest differences. With DISTAL_DATA the logs of MuJoCo and of the da Vinci grasper are among them.
"""

from __future__ import annotations

import argparse
import os
import pickle
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tests.support.cases import hand_log, hand_rig, paper_log, paper_rig, spoiled

from benchmarks.report import table
from benchmarks.strangers.random_rigs import random_case
from benchmarks.strangers.rigs import spoilt
from distal import (
    DistalError,
    Log,
    Rig,
    estimate,
    load_rig,
    load_scenario,
    read_log,
    scenario_rig,
    shipped_scenarios,
    simulate,
)
from distal.simulation import build_scenario

Floats = NDArray[np.float64]

NAMES = ("adaptive", "ekf", "ekf-2008", "inextensible", "elastic")
SEEDS = (0, 1)
LONGEST = 60.0
"""Shipped scenarios of hours are left out [s]."""

DA_VINCI = ("00", "23", "41")
SPOILED = (
    ("ramps", "friction +20 %"),
    ("weights", "as the rig"),
    ("servo", "stiffness −10 %"),
    ("weights into stops", "as observed"),
)
RANDOM = 16
"""Random rigs; they are run interpreted, which gives the same numbers, because each is used for two
logs only.
"""

FIELDS = ("means", "variances", "innovations", "innovation_variances")
TOLERANCE = 1e-9
"""Largest difference of the angle [rad] that counts as the same."""


@dataclass(frozen=True)
class Case:
    """A log, the rig it is read with, for how long its truth is known, and whether its kernels are
    worth compiling.
    """

    name: str
    log: Log
    rig: Rig
    homing: float | None = None
    once: bool = False


def cases() -> Iterator[Case]:
    """Yield the logs: shipped scenarios, spoiled ones, hands, a capstan, random rigs, MuJoCo, da
    Vinci.
    """
    for name in shipped_scenarios():
        scenario = load_scenario(name)
        rig = scenario_rig(scenario)
        if scenario.duration > LONGEST:
            continue
        for seed in SEEDS:
            yield Case(f"{name}, seed {seed}", simulate(rig, scenario, seed), rig)
    for kind, plant in SPOILED:
        log, rig = paper_log(kind, plant, 0), paper_rig(plant)
        yield Case(f"{kind}, {plant}", log, rig)
        yield Case(f"{kind}, {plant}, spoiled", spoiled(log, 0), rig)
    for friction in ("given", "unknown"):
        yield Case(f"hand, friction {friction}", hand_log(0), hand_rig(friction))
    capstan = load_rig("capstan-joint")
    log = simulate(capstan, capstan_scenario(), 0)
    yield Case("capstan", log, capstan)
    yield Case("capstan, homing 1 s", log, capstan, 1.0)
    yield Case("capstan, every second torque missing", gappy(log), capstan)
    yield Case(
        "series-2 on paper-2008-observed",
        simulate("paper-2008-observed", "series-2", 0),
        load_rig("paper-2008-observed"),
    )
    for seed in range(
        RANDOM
    ):  # they have what the shipped rigs lack: one tendon, five, path friction, biases, gravity
        drawn = random_case(seed)
        yield Case(f"random rig {seed}", drawn.log, drawn.rig, once=True)
        yield Case(
            f"random rig {seed}, spoiled", spoilt(drawn.log, drawn.rig, seed), drawn.rig, once=True
        )
    yield from recorded()


def capstan_scenario() -> Any:
    """Return a motor that turns the capstan joint to and fro, with a pause."""
    points = [[0.0, 0.0], [1.0, 0.6], [2.0, 0.6], [3.5, -0.7], [4.5, 0.3], [6.0, 0.3]]
    servo = {"angle": {"points": points, "interpolation": "linear"}}
    return build_scenario(
        {
            "rig": "capstan-joint",
            "duration": 6.0,
            "drives": {"motor": {"servo": servo}},
            "name": "capstan",
        },
        "capstan",
    )


def gappy(log: Log) -> Log:
    """Return the log without every second value of its second sensor."""
    channels = dict(log.channels)
    name = list(channels)[1]
    channels[name] = np.where(np.arange(len(log)) % 2 == 1, np.nan, channels[name])
    return Log(log.time, channels, dict(log.truth), log.source, log.truth_source)


def recorded() -> Iterator[Case]:
    """Yield the logs that lie in the folder DISTAL_DATA, where it is set."""
    folder = os.environ.get("DISTAL_DATA")
    if not folder:
        print(
            "DISTAL_DATA is not set: the logs of MuJoCo and of the da Vinci grasper are left out",
            file=sys.stderr,
        )
        return
    rigs = {
        "servo": {"as shipped": load_rig("pulley-antagonist")},
        "hand": {f"friction {name}": hand_rig(name) for name in ("given", "unknown")},
    }
    for name, known in rigs.items():
        path = Path(folder) / "mujoco_rig" / f"mujoco_tension_{name}.csv"
        for label, rig in known.items():
            log = read_log(path, rig, path.with_name(f"mujoco_tension_{name}.truth.csv"))
            yield Case(f"MuJoCo {name}, {label}", log, rig)
    rig = load_rig("da-vinci-grasper")
    for run in DA_VINCI:
        log = read_log(Path(folder) / "da_vinci_grasper" / f"run_{run}.csv", rig)
        yield Case(f"da Vinci {run}", log, rig)
        yield Case(f"da Vinci {run}, homing 3 s", log, rig, 3.0)


def estimates_of(case: Case, name: str) -> dict[str, Any]:
    """Return the arrays and names of an estimate, or the refusal."""
    try:
        made = estimate(case.log, case.rig, name, compiled=not case.once, homing=case.homing)
    except DistalError as problem:
        return {"refused": str(problem)}
    arrays = {field: getattr(made, field) for field in FIELDS}
    return arrays | {"states": list(made.state_names), "measured": list(made.measured)}


def save(path: Path) -> None:
    """Store all logs and estimates."""
    held = dict[str, Any]()
    for case in cases():
        columns = case.log.time, dict(case.log.channels), dict(case.log.truth)
        held[case.name] = columns, {name: estimates_of(case, name) for name in NAMES}
        print(f"{case.name}: {len(case.log)} samples", file=sys.stderr)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(pickle.dumps(held))
    print(f"{len(held)} logs × {len(NAMES)} estimators in {path}")


def farthest(now: Floats, then: Floats) -> float:
    """Return the largest difference; infinite where shapes differ, or one has a value where the
    other has none.
    """
    if now.shape != then.shape or not np.array_equal(np.isfinite(now), np.isfinite(then)):
        return float("inf")
    return float(np.max(np.abs(now - then), initial=0.0, where=np.isfinite(then)))


def differences(now: dict[str, Any], then: dict[str, Any]) -> tuple[list[float], str]:
    """Return the largest differences of an estimate from the stored one in what `COLUMNS` says, and
    what else differs.
    """
    if "refused" in now or "refused" in then:
        if now.get("refused") == then.get("refused"):
            return [0.0] * len(COLUMNS), "refused as before"
        return [float("inf")] * len(COLUMNS), f"{now.get('refused')}, was {then.get('refused')}"
    names = ("states", "measured")
    changed = [key for key in names if now[key] != then[key]]
    note = ", ".join(f"{key} {now[key]}, were {then[key]}" for key in changed)
    angles = [farthest(now["means"][:, 0], then["means"][:, 0])]
    stds = [farthest(*(np.sqrt(np.abs(each["variances"][:, 0])) for each in (now, then)))]
    return [*angles, *stds, *(farthest(now[field], then[field]) for field in FIELDS)], note


COLUMNS = ("θ [rad]", "std of θ [rad]", *(f"{field} [SI]" for field in FIELDS))


def check(path: Path) -> bool:
    """Run the estimators on the stored logs, print the differences, and return whether the angles
    are the same.
    """
    rows, bad, held = list[list[str]](), 0, pickle.loads(path.read_bytes())
    for today in cases():
        (time, channels, truth), known = held[today.name]
        case = replace(today, log=replace(today.log, time=time, channels=channels, truth=truth))
        for name in NAMES:
            found, note = differences(estimates_of(case, name), known[name])
            same = max(found[:2]) <= TOLERANCE
            bad += not same
            said = [*(f"{each:.1e}" for each in found), note, "" if same else "DIFFERS"]
            rows.append([case.name, name, *said])
    columns = ["log", "estimator", *COLUMNS, "note", ""]
    table("reference-estimates", f"Largest differences from {path.name}", columns, rows)
    print(f"{len(rows) - bad} of {len(rows)} estimates are the same within {TOLERANCE:g} rad")
    return not bad


def main() -> None:
    """Store or compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    action = parser.add_mutually_exclusive_group(required=True)
    action.add_argument("--save", type=Path, metavar="FILE", help="run and store")
    action.add_argument("--check", type=Path, metavar="FILE", help="run again and compare")
    arguments = parser.parse_args()
    if arguments.save is not None:
        save(arguments.save)
    elif not check(arguments.check):
        sys.exit(1)


if __name__ == "__main__":
    main()
