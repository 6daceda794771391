"""Whether estimates are still what they were: full estimates of many logs, stored, and compared
later.

`python -m benchmarks.reference_estimates --save FILE.npz` stores the logs and what the estimators
make of them; `--check FILE.npz` runs the estimators again on the *stored* logs and prints the
largest differences. With DISTAL_DATA the logs of MuJoCo and of the da Vinci grasper are among them.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
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
from distal.logs import TruthKind, TruthSource
from distal.simulation import build_scenario

Floats = NDArray[np.float64]

NAMES = ("adaptive", "ekf", "ekf-2008", "inextensible", "elastic")
KINEMATIC = ("inextensible", "elastic")
"""Estimators whose columns may have other names than they had."""

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

FIELDS = ("means", "variances", "innovations", "innovation_variances", "last_covariance")
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


def estimates_of(case: Case, name: str, compiled: bool) -> dict[str, Any]:
    """Return the arrays and names of an estimate, or the refusal."""
    try:
        made = estimate(
            case.log, case.rig, name, compiled=compiled and not case.once, homing=case.homing
        )
    except DistalError as problem:
        return {"refused": str(problem)}
    last = made.covariances[-1] if made.covariances is not None else np.zeros((0, 0))
    return {
        "means": made.means,
        "variances": made.variances,
        "innovations": made.innovations,
        "innovation_variances": made.innovation_variances,
        "last_covariance": last,
        "states": list(made.state_names),
        "measured": list(made.measured),
    }


def save(path: Path, compiled: bool) -> None:
    """Store all logs and estimates."""
    arrays: dict[str, Floats] = {}
    index: list[dict[str, Any]] = []
    for i, case in enumerate(cases()):
        entry: dict[str, Any] = {
            "case": case.name,
            "homing": case.homing,
            "once": case.once,
            "rig": None if case.rig.map is not None else case.rig.model_dump_json(),
            "channels": list(case.log.channels),
            "truth": list(case.log.truth),
            "source": case.log.source,
            "truth_source": case.log.truth_source.position,
            "truth_kind": case.log.truth_kind.value,
            "estimates": {},
        }
        arrays[f"{i}/time"] = case.log.time
        for kind, columns in (("channels", case.log.channels), ("truth", case.log.truth)):
            for j, values in enumerate(columns.values()):
                arrays[f"{i}/{kind}/{j}"] = values
        for name in NAMES:
            made = estimates_of(case, name, compiled)
            for field in FIELDS:
                if field in made:
                    arrays[f"{i}/{name}/{field}"] = made.pop(field)
            entry["estimates"][name] = made
        index.append(entry)
        print(f"{case.name}: {len(case.log)} samples", file=sys.stderr)
    arrays["index"] = np.frombuffer(json.dumps(index).encode(), dtype=np.uint8)  # type: ignore[assignment]
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(path, **arrays)
    print(
        f"{len(index)} logs × {len(NAMES)} estimators in {path} ({path.stat().st_size / 1e6:.0f} "
        "MB)"
    )


def stored_log(held: Any, i: int, entry: dict[str, Any]) -> Log:
    """Return a stored log."""
    channels = {name: held[f"{i}/channels/{j}"] for j, name in enumerate(entry["channels"])}
    truth = {name: held[f"{i}/truth/{j}"] for j, name in enumerate(entry["truth"])}
    said = entry["truth_source"]
    kind = entry.get(
        "truth_kind", "sensor" if said.endswith("the reference sensor") else "unknown"
    )  # older files
    kinds = {kind.value: kind for kind in TruthKind}  # older files have others
    source = TruthSource(kinds.get(kind, TruthKind.OTHER), said)
    return Log(held[f"{i}/time"], channels, truth, entry["source"], source)


def farthest(now: Floats, then: Floats) -> float:
    """Return the largest difference; infinite where shapes differ, or one has a value where the
    other has none.
    """
    if now.shape != then.shape or not np.array_equal(np.isfinite(now), np.isfinite(then)):
        return float("inf")
    return float(np.max(np.abs(now - then), initial=0.0, where=np.isfinite(then)))


def log_difference(now: Log, then: Log) -> float:
    """Return the largest relative difference between two logs' columns."""
    if set(now.channels) != set(then.channels) or len(now) != len(then):
        return float("inf")
    pairs = [(now.channels[name], then.channels[name]) for name in then.channels]
    pairs += [(now.truth[name], then.truth[name]) for name in then.truth if name in now.truth]
    return max(
        farthest(a, b) / max(float(np.nanmax(np.abs(b), initial=0.0)), 1e-300) for a, b in pairs
    )


@dataclass(frozen=True)
class Difference:
    """The largest differences of an estimate from the stored one; `note` says what else differs."""

    theta: float
    theta_std: float
    states: float
    in_stds: float
    innovations: float
    innovation_stds: float
    note: str = ""


def difference(
    name: str, now: dict[str, Any], held: Any, i: int, entry: dict[str, Any]
) -> Difference:
    """Return how far an estimate is from the stored one: by position where names may differ, else
    by name.
    """
    if "refused" in now or "refused" in entry:
        if "refused" in now and "refused" in entry:
            same = now["refused"] == entry["refused"]
            return Difference(
                0, 0, 0, 0, 0, 0, "refused as before" if same else "refused, in other words"
            )
        inf = float("inf")
        what = f"refused now: {now['refused']}" if "refused" in now else "refused before, not now"
        return Difference(inf, inf, inf, inf, inf, inf, what)
    then = {field: held[f"{i}/{name}/{field}"] for field in FIELDS}
    means, variances, note = now["means"], now["variances"], ""
    if now["states"] != entry["states"]:
        if sorted(now["states"]) == sorted(entry["states"]):
            order = [now["states"].index(state) for state in entry["states"]]
            means, variances, note = means[:, order], variances[:, order], "states in another order"
        elif name in KINEMATIC and len(now["states"]) == len(entry["states"]):
            note = "columns renamed"
        else:
            note = f"states {now['states']} instead of {entry['states']}"
    compared = sorted(set(now["measured"]) | set(entry["measured"]))
    if sorted(now["measured"]) != compared or sorted(entry["measured"]) != compared:
        note = (
            f"{note}; innovations of {now['measured']} instead of {entry['measured']}".removeprefix(
                "; "
            )
        )
    columns = [now["measured"].index(m) for m in entry["measured"] if m in now["measured"]]
    moved = farthest(means, then["means"])
    std = np.sqrt(np.maximum(then["variances"], 1e-300))
    there = np.isfinite(then["means"]) & (then["variances"] > 0.0)
    scaled = (
        float(np.max(np.abs(means - then["means"]) / std, initial=0.0, where=there))
        if np.isfinite(moved)
        else moved
    )
    thetas = [np.sqrt(np.abs(v[:, 0])) for v in (variances, then["variances"])]
    return Difference(
        farthest(means[:, 0], then["means"][:, 0]),
        farthest(*thetas),
        moved,
        scaled,
        farthest(now["innovations"][:, columns], then["innovations"]),
        farthest(
            np.sqrt(now["innovation_variances"][:, columns]), np.sqrt(then["innovation_variances"])
        ),
        note,
    )


def check(path: Path, compiled: bool, names: tuple[str, ...], tolerance: float) -> bool:
    """Run the estimators on the stored logs, print the differences, and return whether the angles
    are the same.
    """
    from distal.rig import build_rig

    fine = True
    with np.load(path) as held:
        index = json.loads(held["index"].tobytes().decode())
        rows, made_now = [], {case.name: case for case in cases()}
        for i, entry in enumerate(index):
            log = stored_log(held, i, entry)
            today = made_now.get(entry["case"])
            # a rig with a map is not stored, and one of an older release may have keys that this
            # one does not know: then today's stands in
            try:
                rig = build_rig(json.loads(entry["rig"] or "{}"), entry["case"])
            except DistalError:
                if today is None:
                    raise
                rig = today.rig
            apart = log_difference(today.log, log) if today is not None else float("nan")
            for name in names:
                case = Case(entry["case"], log, rig, entry["homing"], entry["once"])
                found = difference(
                    name, estimates_of(case, name, compiled), held, i, entry["estimates"][name]
                )
                same = found.theta <= tolerance and found.theta_std <= tolerance
                fine = fine and same
                parameters = (
                    found.theta,
                    found.theta_std,
                    found.states,
                    found.in_stds,
                    found.innovations,
                )
                parameters += (found.innovation_stds, apart)
                rows.append(
                    [
                        entry["case"],
                        name,
                        *(f"{n:.1e}" for n in parameters),
                        found.note,
                        "" if same else "DIFFERS",
                    ]
                )
    columns = [
        "log",
        "estimator",
        "θ [rad]",
        "std of θ [rad]",
        "states [SI]",
        "states / std",
        "innovations [SI]",
    ]
    columns += ["their stds [SI]", "log itself, relative", "note", ""]
    table("reference-estimates", f"Largest differences from {path.name}", columns, rows)
    bad = sum(1 for row in rows if row[-1])
    print(f"{len(rows) - bad} of {len(rows)} estimates are the same within {tolerance:g} rad")
    return fine


def main() -> None:
    """Store or compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    action = parser.add_mutually_exclusive_group(required=True)
    action.add_argument("--save", type=Path, metavar="FILE.npz", help="run and store")
    action.add_argument("--check", type=Path, metavar="FILE.npz", help="run again and compare")
    parser.add_argument("--interpreted", action="store_true", help="without compiled kernels")
    parser.add_argument(
        "--estimators", nargs="+", choices=NAMES, default=NAMES, help="compare only these"
    )
    parser.add_argument("--tolerance", type=float, default=TOLERANCE, help="of the angle [rad]")
    arguments = parser.parse_args()
    started = time.perf_counter()
    if arguments.save is not None:
        save(arguments.save, not arguments.interpreted)
        fine = True
    else:
        fine = check(
            arguments.check,
            not arguments.interpreted,
            tuple(arguments.estimators),
            arguments.tolerance,
        )
    print(f"{time.perf_counter() - started:.0f} s")
    sys.exit(0 if fine else 1)


if __name__ == "__main__":
    main()
