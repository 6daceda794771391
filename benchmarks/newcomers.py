"""Rigs that newcomers wrote, with their logs, and the time of their fits beside busy processes.

`python -m benchmarks.newcomers --busy 8` (part of `make accuracy`) fits each in a process of its
own, with an empty cache of kernels, in the environment that a user has: alone, and beside eight
processes that use a processor each. The joint and the finger of `newcomer` need the folder of logs
in `DISTAL_DATA`.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.support.foreign_plants import finger_log, finger_rig, hand_log, hand_rig
from tests.support.hands_plants import bowden_log, bowden_rig, ropes_log, ropes_rig

from benchmarks.report import table
from distal import Log, Rig, fit, load_rig, read_log

Logs = tuple[Rig, list[Log], dict[str, list[Log]]]
FIRST = 9000
"""Seeds begin here: nothing was chosen on these logs."""


TWICE = 185
"""At this angle the spring of the given joint pulls with twice its largest torque in calibration
[°].
"""


def newcomer(name: str) -> Any:
    """Return the module of a plant in the folder of logs."""
    path = Path(os.environ["DISTAL_DATA"]) / "newcomer" / f"{name}_plant.py"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    plant: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(plant)
    return plant


def given(name: str, folder: Path) -> Logs:
    """Return rig, calibration logs and other logs of one of the two rigs in `newcomer`, drawn by
    its plant.
    """
    home = Path(os.environ["DISTAL_DATA"]) / "newcomer"
    plant = newcomer(name)
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


def run(case: str) -> float:
    """Return the processor time of a fit of one rig, in this process and its children [s]."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rig, logs, _ = CASES[case](Path(folder))
        begun = time.process_time()
        fit(logs, rig)
        children = os.times()
        taken = time.process_time() - begun
        return taken + children.children_user + children.children_system


def busy(count: int) -> list[subprocess.Popen[bytes]]:
    """Start processes that use a processor each."""
    return [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]


def asked(case: str) -> float:
    """Return `run` from a process of its own, with an empty cache of kernels."""
    with tempfile.TemporaryDirectory() as cache:
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.newcomers", "--case", case],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "DISTAL_CACHE": cache},
        )
    return float(done.stdout.splitlines()[-1])


def main() -> None:
    """Fit each rig, print a line, save the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--case", choices=CASES)
    parser.add_argument("--busy", type=int, default=8)
    words = parser.parse_args()
    if words.case:
        print(run(words.case))
        return
    rows = list[list[str]]()
    for case in CASES:
        if "given" in case and "DISTAL_DATA" not in os.environ:
            continue
        alone = asked(case)
        beside = busy(words.busy)
        rows.append([case, f"{alone:.1f}", f"{asked(case) / alone:.2f}"])
        for process in beside:
            process.kill()
        print(" | ".join(rows[-1]), flush=True)
    head = ["rig", "processor [s]", f"beside {words.busy} busy processes / alone"]
    table("newcomers", "fits of rigs that newcomers wrote", head, rows)


if __name__ == "__main__":
    main()
