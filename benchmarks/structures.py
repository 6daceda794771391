"""Kernels for rigs that differ in numbers, and what an estimate with another number takes as a
whole process.

    python -m benchmarks.structures counts       # 100 rigs drawn around each shipped rig
    python -m benchmarks.structures processes    # seconds, and a loop of ten million additions
    python -m benchmarks.structures steps        # numbers as inputs, over numbers as constants
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from math import inf
from pathlib import Path

import casadi as ca
import numpy as np

from distal import Log, Rig, load_rig, simulate, write_log
from distal.estimators import AdaptiveFilter
from distal.estimators.adaptive.filter_function import adaptive_function
from distal.inverse.command_trajectory import RestModel
from distal.inverse.live_inverse import LiveModel
from distal.kernels import Feed, Kernel, Structure, advance_all, lanes_here, structure_of
from distal.model import Mechanism
from distal.rig import build_rig, shipped_rigs
from distal.simulation import build_scenario
from distal.simulation.plant import plant_function

DRAWS = 100

KEPT = ("axis", "shared", "exponent", "range", "powers", "ratio", "periods", "log")
"""Keys below which nothing is drawn: structure, what must agree, and exponents, whose one is no
number.
"""

MAPS = ("map",)

LOOP = "total = 0\nfor i in range(10_000_000):\n    total += i"

SAMPLES, ROUNDS = 3000, 40
"""Samples of a run whose steps are timed, and how often each way takes its turn."""

FARTHEST = 0.03
"""Numbers are drawn within this share of what they are."""


def drawn(part: object, rng: np.random.Generator) -> object:
    """Return a raw description with other numbers; what is zero, or one for certain, stays."""
    if isinstance(part, dict) and "value" in part:
        # whether a number is known to a factor only, by its std over its value, is structure
        factor = rng.uniform(1 - FARTHEST, 1 + FARTHEST)
        return {
            key: factor * value if isinstance(value, float) else value
            for key, value in part.items()
        }
    if isinstance(part, dict):
        return {
            key: value if key in KEPT or key in MAPS else drawn(value, rng)
            for key, value in part.items()
        }
    if isinstance(part, (list, tuple)):
        return [drawn(member, rng) for member in part]
    if not isinstance(part, float):
        return part
    return part * rng.uniform(1 - FARTHEST, 1 + FARTHEST)


def rigs_like(name: str, seed: int = 1) -> Iterator[Rig]:
    """Yield rigs with other numbers than a shipped one."""
    raw = load_rig(name).model_dump(exclude_unset=True)
    rng = np.random.default_rng(seed)
    while True:
        yield build_rig(drawn(raw, rng), name)


def functions_of(rig: Rig) -> dict[str, tuple[Structure, Callable[[], ca.Function]]]:
    """Return kind → the structure of a kernel and what makes its function."""
    estimator, model = AdaptiveFilter(rig, compiled=False), RestModel(rig)
    live = LiveModel(rig, estimator.states)
    assert estimator.structure is not None  # no states by others
    plant = Mechanism(rig, remembers=True)
    functions: dict[str, tuple[Structure, Callable[[], ca.Function]]] = {
        "plant": (structure_of("plant", plant), lambda: plant_function(plant, 4)),
        "filter": (estimator.structure, lambda: adaptive_function(estimator.states)),
        "live": (live.structure, live.function),
    }
    commands = {"command": RestModel.function, "rest": RestModel.rest_function}
    for kind, make in commands.items():
        structure = structure_of(kind, model.mechanism)
        functions[kind] = structure, lambda make=make: make(model)
    return functions


def counts() -> None:
    """Print how many kernels of each kind the drawn rigs need."""
    for name in shipped_rigs():
        rigs, keys = rigs_like(name), dict[str, set[str]]()
        for _ in range(DRAWS):
            for kind, (structure, _) in functions_of(next(rigs)).items():
                keys.setdefault(kind, set()).add(structure.key)
        print(f"{name:22}", ", ".join(f"{kind} {len(found)}" for kind, found in keys.items()))


def processes() -> None:
    """Print what estimates take as whole processes."""
    begun = time.perf_counter()
    exec(LOOP, {})
    print(f"ten million additions {time.perf_counter() - begun:.2f} s")
    for rig in ("lab-bench", "finger-2n", "hand"):
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "log.csv"
            write_log(log_of(rig), load_rig(rig), log)
            changed = ("--set", "joints.0.unmodelled=0.123", "--set", "sensors.*.noise=0.002")
            cases: dict[str, tuple[str, ...]] = {
                "empty cache": (),
                "the same": (),
                "other numbers": changed,
                "other numbers, no what-if": (*changed, "--no-what-if"),
            }
            for case, words in cases.items():
                print(f"{rig:12} {case:28} {_seconds(rig, log, Path(folder), words):.2f} s")


def steps() -> None:
    """Print what a step takes with numbers as inputs, over one with them as constants."""
    ratios = dict[str, list[float]]()
    for name in shipped_rigs():
        usual = AdaptiveFilter(load_rig(name))
        both = usual, usual.folded()
        kernels = [Kernel(estimator.kernel.function) for estimator in both]
        samples = np.zeros((SAMPLES, len(usual.channels)))
        feeds = []
        for estimator in both:
            begun = estimator.initial(0.0, samples[0])
            times = estimator.interval * np.arange(1, SAMPLES + 1)
            rows, _ = estimator.checked_rows(begun, times, samples)
            feeds.append(Feed(begun.kernel_state, rows, estimator.parameters))
        for way, count in (("scan", 1), ("lanes", lanes_here())):
            least = [inf, inf]
            for _ in range(ROUNDS):
                for k, (kernel, feed) in enumerate(zip(kernels, feeds)):
                    begun_at = time.perf_counter()
                    advance_all(kernel, [feed] * count, keep=())
                    least[k] = min(least[k], time.perf_counter() - begun_at)
            ratios.setdefault(way, []).append(least[0] / least[1])
        print(f"{name:22}", ", ".join(f"{way} {found[-1]:.2f}" for way, found in ratios.items()))
    for way, found in ratios.items():
        print(f"{way}: median {np.median(found):.2f}, worst {max(found):.2f}")


def log_of(name: str) -> Log:
    """Return eight seconds of a rig without truth."""
    rig = load_rig(name)
    drives = {drive.name: {"servo": _servo(drive.kind)} for drive in rig.drives}
    raw = {"rig": name, "duration": 8.0, "drives": drives}
    log = simulate(rig, build_scenario(raw, name), 1)
    return Log(log.time, log.channels, {}, log.source)


def _servo(kind: str) -> dict[str, object]:
    if kind == "slider":
        position = {"amplitude": 1e-3, "frequency": 0.4}
        return {"position": position, "stiffness": 5e4, "damping": 100.0}
    position = {"amplitude": 0.1, "frequency": 0.4}
    return {"angle": position, "stiffness": 20.0, "damping": 0.3}


def _seconds(rig: str, log: Path, folder: Path, words: tuple[str, ...]) -> float:
    command = [sys.executable, "-m", "distal", "estimate", str(log), "--rig", rig, *words]
    environment = {**os.environ, "DISTAL_CACHE": str(folder / "cache")}
    begun = time.perf_counter()
    subprocess.run(
        [*command, "--out", str(folder / "out.csv")],
        env=environment,
        check=True,
        stdout=subprocess.DEVNULL,
    )
    return time.perf_counter() - begun


if __name__ == "__main__":
    for what in sys.argv[1:] or ["counts", "processes", "steps"]:
        {"counts": counts, "processes": processes, "steps": steps}[what]()
