"""Speed and size of `adaptive` against another checkout of distal, in one run: `python -m benchmarks.versus OTHER_SRC`.

OTHER_SRC is the `src` folder of the other checkout. Each checkout has a process of its own; measurements alternate, and the
least of each is taken, so that what else a machine does falls on both. Flash, RAM, instructions need gcc-arm-none-eabi and
qemu-system-arm. Without them the sizes of the exported state, stack and operations are compared.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from tests.export.helpers import missing_tools
from tests.export.test_microcontroller import cases, measure

from benchmarks.report import table

HERE = Path(__file__).resolve().parents[1]
ROUNDS = 8
RIGS = ("paper-2008", "capstan-joint", "da-vinci-grasper")

_WORKER = """
import json, sys, time, tempfile
from pathlib import Path
import numpy as np
import distal
from distal import LiveEstimator, estimate_batch, load_rig, load_scenario, make_estimator, scenario_rig, simulate
from distal.simulation import build_scenario

def made_log(name):
    printed = "paper-2008-printed"  # what release 0.1 calls paper-2008
    rig = load_rig(printed if name == "paper-2008" and printed in distal.shipped_rigs() else name)
    rig = rig.bare() if hasattr(rig, "bare") else rig  # the filter alone, in both
    if name == "paper-2008":
        scenario = load_scenario("series-2")
        return rig, simulate(scenario_rig(scenario), scenario, 1)
    servo = {"angle": {"amplitude": 0.5, "frequency": 0.4}, "stiffness": 20.0, "damping": 0.2}
    drive = rig.drives[0].name
    raw = {"rig": name, "duration": 8.0, "drives": {drive: {"servo": servo}}}
    return rig, simulate(rig, build_scenario(raw, "turn"), 1)

cases = {}
for name in sys.argv[1].split(","):
    rig, log = made_log(name)
    runner = make_estimator("adaptive", rig)
    samples = np.column_stack([log.channels[channel] for channel in runner.channels])
    start = runner.initial(log.time[0], samples[0])
    rows, _ = runner.checked_rows(start, log.time, samples)
    cases[name] = (rig, log, runner, samples, start, rows, LiveEstimator(rig, runner))

def step(name):
    rig, log, runner, samples, start, rows, live = cases[name]
    best = 1e9
    for _ in range(5):
        t = time.perf_counter_ns(); runner.kernel.scan(start.carry, rows, runner.numbers)
        best = min(best, (time.perf_counter_ns() - t) / len(rows))
    return best / 1e3

def live(name):
    rig, log, runner, samples, start, rows, live = cases[name]
    stamps, best = [float(t) for t in log.time], 1e9
    for _ in range(3):
        live.reset()
        t = time.perf_counter_ns()
        for stamp, sample in zip(stamps, samples):
            live.step(stamp, sample)
        best = min(best, (time.perf_counter_ns() - t) / len(stamps))
    return best / 1e3

def batch(name):
    rig, log, runner, samples, start, rows, live = cases[name]
    t = time.perf_counter_ns(); count = 0
    for result in estimate_batch([log] * 240, rig, runner, workers=2):
        count += len(result)
    return (time.perf_counter_ns() - t) / count / 1e3

def size(name):
    from distal.export.source import c_filter
    made = c_filter(cases[name][0], "adaptive", True, "filter")
    return {"sizes": [made.state_bytes, made.scratch_bytes, made.operations], "source": made.source, "header": made.header}

for line in sys.stdin:
    what, name = line.split()
    print(json.dumps({"step": step, "live": live, "batch": batch, "size": size}[what](name)), flush=True)
"""


class Worker:
    """A process that measures with one checkout.

    Args:
        source: its `src` folder.
    """

    def __init__(self, source: Path) -> None:
        environment = {**os.environ, "PYTHONPATH": str(source), "PYTHONWARNINGS": "ignore"}
        command = [sys.executable, "-c", _WORKER, ",".join(RIGS)]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self._process = subprocess.Popen(command, env=environment, cwd=tempfile.gettempdir(), **pipes)

    def ask(self, what: str, name: str) -> Any:
        """Return one measurement."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{what} {name}\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())


BOARD = ("flash, Cortex-M4F [bytes]", "RAM, Cortex-M4F [bytes]", "instructions per step, Cortex-M4F")


def on_board(name: str, exported: dict[str, Any]) -> list[float]:
    """Return flash, RAM and mean instructions of an exported filter on an emulated Cortex-M4F."""
    rig, scenario = next((rig, scenario) for case, rig, scenario in cases() if case in (name, f"{name}-printed"))
    with tempfile.TemporaryDirectory() as folder:
        made: Any = SimpleNamespace(source=exported["source"], header=exported["header"])
        found, _ = measure(rig, scenario, "adaptive", Path(folder), made)
    return [found.flash, found.ram, round(found.instructions[0])]


def main() -> None:
    """Print the table."""
    if len(sys.argv) != 2 or not (Path(sys.argv[1]) / "distal").is_dir():
        sys.exit("usage: python -m benchmarks.versus OTHER_SRC (the src folder of another checkout)")
    before, after = Worker(Path(sys.argv[1]).resolve()), Worker(HERE / "src")
    rows = []
    for name in RIGS:
        for what in ("step", "live", "batch"):
            taken: dict[Worker, list[float]] = {before: [], after: []}
            for _ in range(ROUNDS):
                for worker in (before, after):
                    taken[worker].append(worker.ask(what, name))
                time.sleep(0.05)
            old, new = min(taken[before]), min(taken[after])
            rows.append([name, f"{what} [µs]", f"{old:.3f}", f"{new:.3f}", f"{new / old:.3f}"])
        names = ("state, float [bytes]", "scratch, float [bytes]", "operations")
        exported = [worker.ask("size", name) for worker in (before, after)]
        sizes = [one["sizes"] for one in exported]
        if not missing_tools():
            names, sizes = (*names, *BOARD), [[*known, *on_board(name, one)] for known, one in zip(sizes, exported)]
        for label, old, new in zip(names, *sizes):
            rows.append([name, label, f"{old}", f"{new}", f"{new / old:.3f}"])
    table("versus", "adaptive, before and after", ["rig", "what", "before", "after", "ratio"], rows)


if __name__ == "__main__":
    main()
