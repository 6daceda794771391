"""Fits of rigs that newcomers wrote: time, work, convergence, and the angle on logs that no fit has
seen.

`python -m benchmarks.newcomers` (part of `make accuracy`) prints a line for each rig and saves the
table; each fit runs in a process of its own, with an empty cache of kernels, in the environment
that a user has. Machines differ, so its time is also given in loops of ten million additions in
Python. `--busy 8` fits beside eight busy processes, `--longer` with ten times the iterations. The
joint and the finger of `newcomer` need the folder of logs in `DISTAL_DATA`.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from tests.support.foreign_plants import finger_log, finger_rig, hand_log, hand_rig
from tests.support.hands_plants import bowden_log, bowden_rig, ropes_log, ropes_rig

from benchmarks.report import table
from benchmarks.shell import estimate
from distal import DistalError, Log, Rig, fit, load_rig, read_log
from distal.confidence import BAND
from distal.fitting import parameter_search
from distal.fitting.likelihood import Problem
from distal.kernels import Kernel, LaneKernel

Logs = tuple[Rig, list[Log], dict[str, list[Log]]]
FIRST = 9000
"""Seeds begin here: nothing was chosen on these logs."""


TWICE = 185
"""At this angle the spring of the given joint pulls with twice its largest torque in calibration
[°].
"""


def given(name: str, folder: Path) -> Logs:
    """Return rig, calibration logs and other logs of one of the two rigs in `newcomer`, drawn by
    its plant.
    """
    home = Path(os.environ["DISTAL_DATA"]) / "newcomer"
    spec = importlib.util.spec_from_file_location(name, home / f"{name}_plant.py")
    assert spec is not None
    assert spec.loader is not None
    plant: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(plant)
    rig = load_rig(home / f"{name}.toml")
    calibration, others = list[Path](), dict[str, list[Path]]()

    def path(kind: str, own: list[Path]) -> str:
        own.append(folder / f"{kind}_{len(own)}.csv")
        return str(own[-1])

    if name == "finger":
        for k in range(4):
            plant.write(path("calibration", calibration), FIRST + k)
        for k in range(2):
            plant.write(path("motion", others.setdefault("motion", [])), FIRST + 40 + k, noise=0)
    else:
        for k in range(5):
            plant.write(
                path("calibration", calibration),
                *plant.traj_random(30, -5, 75, FIRST + k),
                FIRST + 50 + k,
            )
        for k in range(2):
            plant.write(
                path("ramps", others.setdefault("ramps", [])),
                *plant.traj_random(30, 0, 70, FIRST + 100 + k),
                k,
                0,
            )
        plant.write(path("sine", others.setdefault("sine", [])), *plant.traj_sine(30, FIRST), 60, 0)
        for kind, high in {
            "ten times faster": 70,
            "twice the torque, ten times faster": TWICE,
        }.items():
            for k in range(2):
                time_, wish = plant.traj_random(300, 0, high, FIRST + 200 + k)
                fast = path(kind, others.setdefault(kind, []))
                plant.write(fast, time_[: len(time_) // 10], wish[::10], 70 + k, 0)
    read = {kind: [read_log(one, rig) for one in paths] for kind, paths in others.items()}
    return rig, [read_log(one, rig) for one in calibration], read


def drawn(log_of: Callable[..., Log], rig_of: Callable[[], Rig], kinds: tuple[str, ...]) -> Logs:
    """Return rig, three calibration logs and three others of each kind of a plant in these
    benchmarks.
    """
    first = (("calibration",), kinds) if kinds else ((), ())
    others = {kind: [log_of(FIRST + s, kind) for s in range(3, 6)] for kind in kinds}
    if not kinds:
        others = {"motion": [log_of(FIRST + s) for s in range(3, 6)]}
    return rig_of(), [log_of(FIRST + s, *first[0]) for s in range(3)], others


CASES: dict[str, Callable[[Path], Logs]] = {
    "given joint": lambda folder: given("joint", folder),
    "given finger": lambda folder: given("finger", folder),
    "Bowden finger": lambda _: drawn(bowden_log, bowden_rig, ("ramps", "stops")),
    "two motors": lambda _: drawn(ropes_log, ropes_rig, ("ramps", "holds")),
    "foreign finger": lambda _: drawn(finger_log, finger_rig, ()),
    "foreign hand": lambda _: drawn(hand_log, hand_rig, ()),
}


class Counted:
    """Counts the rows that go through kernels: one that has a sample of one number is a play of a
    map, not a filter.
    """

    def __init__(self) -> None:
        self.rows, lanes, alone = 0, LaneKernel.scan, Kernel.scan

        def in_lanes(kernel: LaneKernel, feeds: Any, keep: Any) -> Any:
            self.rows += sum(len(feed.rows) for feed in feeds)
            return lanes(kernel, feeds, keep)

        def one_by_one(kernel: Kernel, kernel_state: Any, xs: Any, p: Any) -> Any:
            self.rows += len(xs) if kernel.sizes.x > 1 else 0
            return alone(kernel, kernel_state, xs, p)

        LaneKernel.scan, Kernel.scan = in_lanes, one_by_one  # type: ignore[method-assign]


def judged(rig: Rig, logs: list[Log], estimator: str = "adaptive") -> dict[str, float]:
    """Return RMS error over all joints, in the first second and after two [°], share inside the
    band, its half-width.
    """
    errors, parts = (
        list[dict[str, float]](),
        {"rms": (0.0, np.inf), "first second": (0.0, 1.0), "after 2 s": (2.0, np.inf)},
    )
    for log in logs:
        try:
            found = estimate(log, rig, estimator)
        except DistalError:
            return {"rms": np.inf}
        since, error = log.time - log.time[0], np.rad2deg(found.errors()).reshape(len(log), -1)
        own = {
            n: float(np.sqrt(np.nanmean(error[(since >= a) & (since < b)] ** 2)))
            for n, (a, b) in parts.items()
        }
        errors.append(
            {
                **own,
                "inside": found.inside_band(),
                "half": float(np.rad2deg(BAND * np.mean(found.angle_stds))),
            }
        )
    return {name: float(np.mean([one[name] for one in errors])) for name in errors[0]}


def loop() -> float:
    """Return the processor time of ten million additions in Python [s]: machines differ by eight
    times.
    """
    begun, total = time.process_time(), 0
    for i in range(10_000_000):
        total += i
    return time.process_time() - begun


def run(case: str, longer: bool) -> dict[str, Any]:
    """Return what a fit took and gave, for one rig, in this process."""
    if longer:
        real = parameter_search.search

        def search(problem: Problem, *further: Any, most: int | None = None, **named: Any) -> Any:
            return real(problem, *further, most=10 * (most or parameter_search.ITERATIONS), **named)

        parameter_search.search = search
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rig, logs, others = CASES[case](Path(folder))
        before = loop()
        counted = Counted()
        begun = time.process_time()
        found = fit(logs, rig)
        children = os.times()
        taken = time.process_time() - begun + children.children_user + children.children_system
        searched = (candidate.parameters for candidate in found.candidates)
        size = next(each.problem.size for each in searched if each is not None)
        passes = counted.rows / (sum(len(log) for log in logs) * (size + 1))
        parameters = [p for p in found.fitted if not p.noise]
        return {
            "seconds": taken,
            "loops": 2 * taken / (before + loop()),
            "gradients": passes,
            "converged": found.converged,
            "chosen": found.candidates[0].name,
            "far": max(
                (abs(p.value - p.start) / p.prior_std for p in parameters if p.prior_std > 0),
                default=0.0,
            ),
            "numbers": {p.name: (p.value, p.error) for p in parameters},
            "angles": {
                kind: {
                    "fitted": judged(found.rig, own),
                    "numbers alone": judged(found.rig.bare(), own),
                    "regression": judged(found.rig, own, "regression"),
                    "as it came": judged(rig, own),
                }
                for kind, own in others.items()
            },
        }


def busy(count: int) -> list[subprocess.Popen[bytes]]:
    """Start processes that use a processor each."""
    return [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]


def asked(case: str, longer: bool) -> dict[str, Any]:
    """Return `run` from a process of its own, with an empty cache of kernels."""
    with tempfile.TemporaryDirectory() as cache:
        words = [
            sys.executable,
            "-m",
            "benchmarks.newcomers",
            "--case",
            case,
            *(["--longer"] if longer else []),
        ]
        done = subprocess.run(
            words,
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "DISTAL_CACHE": cache},
        )
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def main() -> None:
    """Fit each rig, print a line, save the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--case", choices=CASES)
    parser.add_argument("--busy", type=int, default=0)
    parser.add_argument("--longer", action="store_true")
    words = parser.parse_args()
    if words.case:
        print(json.dumps(run(words.case, words.longer)))
        return
    cases = [case for case in CASES if "given" not in case or "DISTAL_DATA" in os.environ]
    work, angles = list[list[str]](), list[list[str]]()
    for case in cases:
        alone = asked(case, False)
        row = [
            case,
            f"{alone['seconds']:.1f}",
            f"{alone['loops']:.0f}",
        ]
        row.append(f"{alone['gradients']:.0f}")
        row += ["yes" if alone["converged"] else "no", f"{alone['far']:.1f}", alone["chosen"]]
        if words.longer:
            other = asked(case, True)["numbers"]
            both = [
                (v, e, other[name][0]) for name, (v, e) in alone["numbers"].items() if name in other
            ]
            row.append(f"{max((abs(v - w) / e for v, e, w in both if e > 0), default=0.0):.2f}")
        if words.busy:
            beside = busy(words.busy)
            row.append(f"{asked(case, False)['seconds'] / alone['seconds']:.2f}")
            for process in beside:
                process.kill()
        print(" | ".join(row), flush=True)
        work.append(row)
        for kind, own in alone["angles"].items():
            f, n, a, c = (
                own[name] for name in ("fitted", "numbers alone", "regression", "as it came")
            )
            line = [
                f"{case}, {kind}",
                *(f"{f[name]:.3f}" for name in ("rms", "first second", "after 2 s")),
            ]
            line += [
                f"{100 * f['inside']:.0f} %",
                f"{f['half']:.2f}",
                f"{n['rms']:.3f}",
                f"{a['rms']:.3f}",
                f"{c['rms']:.3f}",
            ]
            print("   " + " | ".join(line), flush=True)
            angles.append(line)
    head = [
        "rig",
        "processor [s]",
        "in loops",
        "gradients",
        "converged",
        "largest move [prior stds]",
        "written",
    ]
    head += ["moved by ten times the iterations [errors]"] if words.longer else []
    head += [f"processor beside {words.busy} busy processes / alone"] if words.busy else []
    table("newcomers", "fits of rigs that newcomers wrote", head, work)
    columns = [
        "logs never seen",
        "RMS [°]",
        "first second",
        "after 2 s",
        "inside",
        "half-width",
        "numbers alone",
        "regression",
    ]
    table(
        "newcomers-angles",
        "the angle, on logs that no fit has seen",
        [*columns, "as it came"],
        angles,
    )


if __name__ == "__main__":
    main()
