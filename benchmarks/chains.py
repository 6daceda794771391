"""Chains of joints: accuracy on plants in another simulator, what a step costs, how the coupled
stick–slip is solved.

`python -m benchmarks.chains` prints all; `python -m benchmarks.chains accuracy --first-seed 500
--seeds 5` one table. The plants are those of `tests/support/chain_plants`. Logs with a contact are
read with a torque that may occur.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from tests.support.chain_plants import SHIPPED

from benchmarks.chain_logs import make_log
from benchmarks.limits import scan_time
from benchmarks.report import table
from benchmarks.shell import Found, estimate
from distal import Log, Rig, load_rig
from distal.confidence import BAND
from distal.errors import DistalWarning
from distal.estimators import AdaptiveFilter
from distal.model import Mechanism, friction, interval_step, slipping, solver, stiffest_frequency
from distal.model import stepping as model_stepping
from distal.rig import build_rig, step_of
from distal.simulation import build_scenario
from distal.simulation.simulate import motions_of, prepare

KINDS = ("servo", "step", "contact")
BEGIN = 0.5
"""The first half second is left out [s]."""

COLUMNS = (
    "plant",
    "log",
    "estimator",
    "mean [°]",
    "inside [%]",
    "seen sum [°]",
)


@dataclass(frozen=True)
class Score:
    """Errors of one estimate [°]: of each joint, the share inside, and of what the tendons see."""

    rms: np.ndarray
    inside: float
    seen: float


def score(result: Found, arms: np.ndarray) -> Score:
    """Return the errors of an estimate after `BEGIN`; `arms` weigh the joints in the sum that is
    seen.
    """
    assert result.truths is not None
    late = result.time - result.time[0] >= BEGIN
    errors, half = (
        np.rad2deg(result.angles - result.truths)[late],
        np.rad2deg(BAND * result.angle_stds)[late],
    )
    rms = np.sqrt(np.mean(errors**2, axis=0))
    seen = float(np.sqrt(np.mean((errors @ arms / arms.sum()) ** 2)))
    return Score(rms, float(np.mean(np.abs(errors) <= half)), seen)


def without_forces(rig: Rig) -> Rig:
    """Return the rig without its sensors of force, nothing being known of the pulls: the filter's
    prediction alone.
    """
    raw = rig.model_dump()
    raw["sensors"] = [sensor for sensor in raw["sensors"] if sensor["measures"] != "force"]
    for drive in raw["drives"]:
        drive["nominal_force"] = {"value": drive["nominal_force"]["value"], "std": 0.0}
    return build_rig(raw, rig.name)


def described(name: str, kind: str) -> Rig:
    """Return a shipped rig as its user runs it on logs of a kind."""
    rig = load_rig(name)
    return (
        rig.with_values({"joints.*.external_torque.std": SHIPPED[name][1]})
        if kind == "contact"
        else rig
    )


def simulated(name: str, kind: str, seed: int) -> Log:
    """Return a log of a plant of our own, in another simulator."""
    columns, truth = make_log(SHIPPED[name][0], kind, seed)
    channels = {sensor.name: columns[sensor.log_column] for sensor in load_rig(name).sensors}
    known = {key: values for key, values in truth.items() if key.startswith("theta")}
    return Log(columns["time"], channels, known, f"{name} {kind} {seed}", "the simulation")


def rows_of(logs: Sequence[Log], name: str, kind: str) -> list[list[str]]:
    """Return a row for each estimator, means over the logs."""
    rig, bare = described(name, kind), without_forces(load_rig(name))
    arms = np.abs([load_rig(name).tendons[0].arms().get(joint.name, 0.0) for joint in rig.joints])
    runs = {
        "adaptive": (rig, "adaptive"),
        "without forces": (bare, "adaptive"),
        "elastic": (rig, "elastic"),
        "inextensible": (rig, "inextensible"),
    }
    rows = []
    for label, (used, estimator) in runs.items():
        scores = [score(estimate(log, used, estimator), arms) for log in logs]
        rms = np.mean([one.rms for one in scores], axis=0)
        rows.append(
            [
                name,
                kind,
                label,
                f"{rms.mean():.2f}",
                f"{100 * np.mean([one.inside for one in scores]):.0f}",
                f"{np.mean([one.seen for one in scores]):.2f}",
            ]
        )
    return rows


def accuracy(first: int, count: int) -> None:
    """Print the table of accuracy."""
    rows = []
    for name in SHIPPED:
        for kind in KINDS:
            logs = [simulated(name, kind, first + seed) for seed in range(count)]
            rows += rows_of(logs, name, kind)
    table(
        "chains", f"Chains: plants in MuJoCo, seeds {first} to {first + count - 1}", COLUMNS, rows
    )


def least_errors(rig: Rig, angles: np.ndarray) -> np.ndarray:
    """Return the least RMS error of each joint [°] if only moment arms are unsure, (n_joints,); see
    `bounds`.

    Rows of y = E s − R θ = 0 are the drives, of an antagonistic pair the mean. The information of a
    whole log about the arms is P⁻¹ + Σ ∂yᵀ W ∂y, W without what θ can explain (posterior Cramér–Rao
    bound: van Trees, 1968).
    """
    joints, drives = [joint.name for joint in rig.joints], [drive.name for drive in rig.drives]
    arms, slopes, stds = (
        np.zeros((len(drives), len(joints))),
        list[tuple[int, int, float]](),
        list[float](),
    )
    for tendon in rig.tendons:
        row, share = (
            drives.index(tendon.drive),
            1.0 / sum(one.drive == tendon.drive for one in rig.tendons),
        )
        winding = float(getattr(tendon, "winding", 1))
        for crossing in tendon.crossings:
            side = share * winding * crossing.side
            arms[row, joints.index(crossing.joint)] += side * crossing.radius.value
            slopes.append((row, joints.index(crossing.joint), side))
            stds.append(crossing.radius.std)
    lever = {
        drive.name: drive.radius.value if drive.kind == "capstan" else 1.0 for drive in rig.drives
    }
    noise = max(
        lever[sensor.of] * (sensor.noise + step_of(sensor)) for sensor in rig.sensors_of("position")
    )
    solved = np.linalg.pinv(arms)
    apart = (np.eye(len(drives)) - arms @ solved) / noise**2
    identified = np.diag(1.0 / np.array(stds) ** 2)
    by_arm = np.zeros((len(angles), len(drives), len(stds)))
    for k, (row, joint, side) in enumerate(slopes):
        by_arm[:, row, k] = side * angles[:, joint]
    identified += np.einsum("tik,ij,tjl->kl", by_arm, apart, by_arm)
    shift = np.einsum("ji,tik->tjk", solved, by_arm)
    return np.rad2deg(
        np.sqrt(np.einsum("tjk,kl,tjl->j", shift, np.linalg.inv(identified), shift) / len(angles))
    )


def bounds(first: int, count: int) -> None:
    """Print errors beside what unknown moment arms alone leave, if tensions, friction and stiffness
    were known exactly.
    """
    rows = []
    for name in SHIPPED:
        rig = load_rig(name)
        if len(rig.drives) < len(rig.joints):
            continue
        for kind in KINDS:
            logs = [simulated(name, kind, first + seed) for seed in range(count)]
            used, least = described(name, kind), []
            scores = [score(estimate(log, used), np.ones(len(rig.joints))) for log in logs]
            for log in logs:
                late = log.time - log.time[0] >= BEGIN
                least.append(least_errors(rig, np.column_stack(list(log.truth.values()))[late]))
            error, bound = (
                np.mean([one.rms for one in scores]),
                np.sqrt(np.mean(np.square(least), axis=0)).mean(),
            )
            rows.append([name, kind, f"{error:.2f}", f"{bound:.2f}", f"{error / bound:.1f}"])
    title = f"Chains: errors and what moment arms alone leave, seeds {first} to {first + count - 1}"
    table("chains-bounds", title, ("plant", "log", "adaptive [°]", "bound [°]", "ratio"), rows)


def straight_chain(joints: int) -> Rig:
    """Return a finger of so many joints with two tendons each, as finger-2n has them."""
    raw = load_rig("finger-2n").model_dump()
    first, last = raw["joints"]
    raw["joints"] = [
        {**(first if i == 0 else last), "name": f"j{i}", "parent": None if i == 0 else f"j{i - 1}"}
        for i in range(joints)
    ]
    drive, sensors = raw["drives"][0], {sensor["measures"]: sensor for sensor in raw["sensors"]}
    parts: dict[str, list[dict[str, Any]]] = {"drives": [], "tendons": [], "sensors": []}
    for i in range(joints):
        for side, word in ((1, "f"), (-1, "e")):
            name = f"j{i}_{word}"
            friction = {
                key: {**drive["friction"][key], "shared": None, "std": 0.0}
                for key in ("constant", "load")
            }
            parts["drives"].append({**drive, "name": name, "friction": friction})
            radii = [("j" + str(j), 7e-3 if j < i else 6e-3) for j in range(i + 1)]
            crossings = [
                {"joint": j, "kind": "pulley", "radius": r, "side": side} for j, r in radii
            ]
            parts["tendons"].append(
                {**raw["tendons"][0], "name": name, "drive": name, "crossings": crossings}
            )
            for measures, column in (("position", "x"), ("force", "F")):
                sensor = {
                    **sensors[measures],
                    "name": f"{column}_{name}",
                    "of": name,
                    "column": None,
                }
                parts["sensors"].append(
                    {key: value for key, value in sensor.items() if key != "si"}
                )
    return build_rig(
        {**raw, **parts, "name": f"chain of {joints}, arms known"}, f"chain of {joints}"
    )


def step_time(rig: Rig, repeats: int = 5) -> tuple[AdaptiveFilter, float, float]:
    """Return the filter, its time per sample over a log [µs], and how long it took to build [s]."""
    begun = time.perf_counter()
    estimator = AdaptiveFilter(rig)
    rng, count = np.random.default_rng(0), 1000
    time_ = np.arange(count) / rig.sensors[0].rate
    channels = {}
    for i, sensor in enumerate(rig.sensors):
        # a slow motion, as joints make it, with the sensors' own noise
        wave = np.sin(2 * np.pi * 0.5 * time_ + i)
        size, mean = {"m": (2e-3, 2e-3), "rad": (0.3, 0.0), "N": (1.0, 6.0), "N m": (5e-3, 0.0)}[
            sensor.si
        ]
        channels[sensor.name] = mean + size * wave + sensor.noise * rng.normal(size=count)
    log = Log(time_, channels, {}, "slow motion", "")
    best = min(scan_time(estimator, log, np.min) for _ in range(repeats))
    built = time.perf_counter() - begun
    return estimator, best, built


def cost() -> None:
    """Print what a compiled step of adaptive costs, beside the paper's rig in the same run."""
    step_time(load_rig("paper-2008-printed"))  # the processor wakes up
    _, paper, _ = step_time(load_rig("paper-2008-printed"))
    rigs = [load_rig(name) for name in ("paper-2008-printed", *SHIPPED)] + [
        straight_chain(n) for n in range(1, 7)
    ]
    rows = []
    for rig in rigs:
        estimator, each, built = step_time(rig)
        rows.append(
            [
                rig.name,
                f"{len(rig.joints)}",
                f"{len(estimator.states)}",
                f"{estimator.substeps}",
                f"{each:.2f}",
                f"{each / paper:.1f}",
                f"{built:.1f}",
            ]
        )
    title = "Chains: one step of adaptive, compiled"
    table(
        "chains-cost",
        title,
        ("rig", "joints", "states", "sub-steps", "µs", "ratio to the paper's rig", "built in [s]"),
        rows,
    )


def stepping() -> None:
    """Print the error of a finger's motion with stick and slip, and its cost, by the sub-step."""
    rig, arms = (
        load_rig("finger-n-plus-1"),
        np.array([[8, 7, 6], [7.5, -6.5, -5.5], [-8, 7, 0], [-7.5, -7, 0]]),
    )
    stamps = [f"{t:g} s" for t in (0.0, 0.3, 0.9, 1.2, 1.6, 2.0)]
    postures = np.deg2rad(
        [(20, 25, 15), (20, 25, 15), (50, 60, 35), (50, 60, 35), (10, 70, 20), (10, 70, 20)]
    )
    drives = {}
    for i, row in enumerate(arms):
        points = [[stamp, f"{row @ posture:.4f} mm"] for stamp, posture in zip(stamps, postures)]
        servo = {"position": {"points": points}, "stiffness": "20000 N/m", "damping": "30 kg/s"}
        drives[f"t{i + 1}"] = {"force": "8 N", "servo": servo}
    ready = prepare(
        rig, build_scenario({"rig": "finger-n-plus-1", "duration": "2 s", "drives": drives})
    )
    fastest = stiffest_frequency(ready.plant)
    known = motions_of([replace(ready, count=128)])[0][:, :3]
    cells: list[list[str]] = [[], [], []]
    counts = (1, 2, 4, 8, 16)
    for count in counts:
        run = [replace(ready, count=count)]
        motions_of(run)  # compiles it
        begun = time.perf_counter()
        found = motions_of(run)[0][:, :3]
        taken = time.perf_counter() - begun
        away = np.rad2deg(found - known)
        cells[0].append(f"{np.sqrt(np.mean(away**2)):.4f}")
        cells[1].append(f"{np.abs(away).max():.4f}")
        cells[2].append(f"{1e6 * taken / len(found):.1f}")
    names = ("RMS error [°]", "largest error [°]", "µs per millisecond")
    title = (
        "finger-n-plus-1, 2 s through three postures: error against 128 sub-steps per millisecond"
    )
    columns = [
        "h ω of the stiffest mode",
        *(f"{ready.dt / count * fastest:.2f}" for count in counts),
    ]
    table("chains-stepping", title, columns, [[name, *row] for name, row in zip(names, cells)])


def energy() -> None:
    """Print how the energy of three links that swing freely changes in 3 s, by where Coriolis
    torques are taken.
    """
    raw = load_rig("finger-n-plus-1").model_dump()
    for joint in raw["joints"]:
        joint.update(friction=None, damping=0.0, stops=None)
    for tendon in raw["tendons"]:
        tendon["slack"] = 50.0
    raw["base"] = {"gravity": (0.0, 0.0, 0.0)}
    mechanism = Mechanism(build_rig(raw, "free"))
    n, p = mechanism.n_bodies, mechanism.parameters
    q, v = ca.SX.sym("q", n), ca.SX.sym("v", n)
    kinetic = ca.Function(
        "E", [q, v, p.symbols], [ca.bilin(mechanism.mass_matrix(q), v[:3], v[:3]) / 2]
    )
    own, rows = model_stepping._middle, []
    for label, middle in (
        ("before the kick", lambda matrix, load, v, up, down: v),
        ("in the middle (in use)", own),
    ):
        cells = []
        for count in (5, 10, 20, 40):
            model_stepping._middle = middle
            try:
                step = interval_step(mechanism, count)
            finally:
                model_stepping._middle = own
            at, speed, still = np.zeros(n), np.zeros(n), np.zeros(n)
            at[:3], speed[:3] = (0.3, 0.5, 0.2), (12.0, -20.0, 30.0)
            first = float(kinetic(at, speed, p.values))
            for _ in range(300):
                at, speed = step(at, speed, still, still, np.zeros((n, 3)), 0.01, p.values)
            cells.append(f"{100 * (float(kinetic(at, speed, p.values)) / first - 1):+.2f} %")
        rows.append([label, *cells])
    title = "Three links swing freely: change of their energy in 3 s, by the sub-step"
    table("chains-energy", title, ("Coriolis torques", "2 ms", "1 ms", "0.5 ms", "0.25 ms"), rows)


def stick_slip(cases: int = 20_000) -> None:
    """Print in how many random loads the coupled stick–slip is not solved, by sweeps before and by
    events followed.
    """
    from tests.model.test_stick_slip import random_case

    rows = []
    for n in range(2, 7):
        rng = np.random.default_rng(n)
        drawn = [random_case(rng, n) for _ in range(cases)]
        matrices = np.hstack([case[0] for case in drawn])
        loads, ups, downs = (np.column_stack([case[k] for case in drawn]) for k in (1, 2, 3))
        for sweeps in (0, 2, 4):
            failures = []
            for events in (0, n - 1, n, 2 * n):
                wrong = _violation(n, sweeps, events).map(cases)(matrices, loads, ups, downs).full()
                failures.append(f"{int((wrong > 1e-9).sum())}")
            rows.append([str(n), str(sweeps), *failures, str(_operations(n, sweeps, 2 * n))])
    title = f"Coupled stick–slip: {cases} random loads, how many are not solved to 1e-9"
    columns = (
        "joints",
        "sweeps",
        "no event",
        "n − 1 events",
        "n",
        "2n (in use)",
        "operations at 2n",
    )
    table("chains-stick-slip", title, columns, rows)


def _solved(n: int, sweeps: int, events: int) -> tuple[list[ca.SX], Any, ca.SX]:
    """Return the arguments (A, r, up, down), which joints slip, and their velocities."""
    matrix, load, up, down = (
        ca.SX.sym("A", n, n),
        ca.SX.sym("r", n),
        ca.SX.sym("u", n),
        ca.SX.sym("d", n),
    )
    before, friction.SWEEPS = friction.SWEEPS, sweeps
    try:
        slip = slipping(matrix, load, up, down, events=events)
    finally:
        friction.SWEEPS = before
    return (
        [matrix, load, up, down],
        slip,
        solver(matrix, slip.moving)(load - slip.friction(up, down)),
    )


def _violation(n: int, sweeps: int, events: int) -> ca.Function:
    (matrix, load, up, down), slip, v = _solved(n, sweeps, events)
    held, worst = load - ca.mtimes(matrix, v), ca.SX(0)
    for j in range(n):
        stuck = ca.fmax(held[j] - up[j], 0) + ca.fmax(-down[j] - held[j], 0)
        wrong = ca.if_else(
            slip.forward[j], ca.fmax(-v[j], 0), ca.if_else(slip.back[j], ca.fmax(v[j], 0), 0)
        )
        broken = ca.if_else(slip.moving[j], wrong * matrix[j, j], stuck)
        worst = ca.fmax(worst, broken / (ca.fabs(load[j]) + up[j]))
    return ca.Function("violation", [matrix, load, up, down], [ca.cse(worst)])


def _operations(n: int, sweeps: int, events: int) -> int:
    arguments, _, v = _solved(n, sweeps, events)
    function = ca.Function("solve", arguments, [ca.cse(v)])
    return int(function.n_instructions()) - sum(function.numel_in(i) for i in range(4)) - n


def main() -> None:
    """Print the tables that are asked for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.chains", description=__doc__)
    parser.add_argument("tables", nargs="*", metavar="TABLE", help=f"{', '.join(TABLES)}; all")
    parser.add_argument("--first-seed", type=int, default=500, help="of the plants")
    parser.add_argument("--seeds", type=int, default=6, help="how many")
    arguments = parser.parse_args()
    unknown = set(arguments.tables) - set(TABLES)
    if unknown:
        parser.error(f"unknown table {', '.join(unknown)}; there are {', '.join(TABLES)}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DistalWarning)
        for name in arguments.tables or TABLES:
            TABLES[name](arguments.first_seed, arguments.seeds)


TABLES: dict[str, Callable[[int, int], None]] = {
    "cost": lambda first, count: cost(),
    "stick-slip": lambda first, count: stick_slip(),
    "energy": lambda first, count: energy(),
    "stepping": lambda first, count: stepping(),
    "accuracy": accuracy,
    "bounds": bounds,
}

if __name__ == "__main__":
    main()
