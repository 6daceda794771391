"""How well a fit finds a plant, and a real instrument.

`python -m benchmarks.fitting` (part of `make accuracy`); the tables are saved in out/bench.
"""

from __future__ import annotations

import argparse
import os
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from tests.support.plant_and_rig import FREE, drawn_plant, logs_of, start_rig

from benchmarks.report import table
from distal import fit, load_rig
from distal.errors import DistalError
from distal.fitting import AS_GIVEN, WRITTEN

START = Path("examples/da_vinci/start.toml")


def with_truth(seed: int) -> list[tuple[float, float, float]]:
    """Return (value, standard error, truth) of k, μ and b, fitted to three logs with truth."""
    rig = start_rig()
    plant, true = drawn_plant(seed)
    found = fit(logs_of(rig, plant, seed), rig, FREE, workers=1)
    return [(found[name].value, found[name].error, value) for name, value in zip(FREE, true)]


def parameters(seeds: int, processes: int) -> None:
    """Print how well k, μ and b are found, and how honest their standard errors are."""
    with ProcessPoolExecutor(processes) as pool:
        fitted = np.array(list(pool.map(with_truth, range(seeds))))
    rows = []
    for i, name in enumerate(("stiffness k", "friction coefficient μ", "damping b")):
        value, error, true = fitted[:, i, :].T
        z = (value - true) / error
        rows.append(
            [
                name,
                f"{100 * np.mean(np.abs(z) < 2):.0f} %",
                f"{np.sqrt(np.mean(z**2)):.2f}",
                f"{np.std(z):.2f}",
                f"{np.mean(z):+.2f}",
                f"{100 * np.sqrt(np.mean((value / true - 1) ** 2)):.2f} %",
                f"{100 * np.mean(error / true):.2f} %",
            ]
        )
    columns = [
        "",
        "within 2 errors",
        "RMS error / std. error",
        "spread / std. error",
        "mean / std. error",
        "RMS",
        "std. error",
    ]
    table(
        "fit-parameters",
        f"Three 10 s logs with truth, {seeds} plants and seeds (`distal fit`)",
        columns,
        rows,
    )


def instrument() -> None:
    """Print the errors on a real instrument, one motion class left out at a time."""
    from examples.da_vinci.logs import da_vinci_grasper

    from distal.logs import read_log

    try:
        paths = da_vinci_grasper()
    except DistalError as problem:
        print(f"the da Vinci logs are left out: {problem}")
        return
    rig = load_rig(START)
    logs = [read_log(path, rig) for path in paths]
    started = time.perf_counter()
    whole = fit(logs, rig, homing=3.0, groups=r"run_(.)")
    took = time.perf_counter() - started
    rows = []
    for one in whole.compared:
        before, fitted = one.scores[AS_GIVEN], one.scores[WRITTEN]
        assert before is not None
        assert fitted is not None
        errors = np.rad2deg([before.rms, fitted.rms])
        rows.append(
            [Path(one.log).stem, *(f"{e:.3f}" for e in errors), f"{100 * fitted.inside:.0f} %"]
        )
    pairs = [(one.scores[AS_GIVEN], one.scores[WRITTEN]) for one in whole.compared]
    said = [(alone.rms, fitted.rms, fitted.inside) for alone, fitted in pairs if alone and fitted]
    first, after, inside = (np.array(column) for column in zip(*said))
    for name, of in (("mean", np.mean), ("worst", np.max)):
        rows.append([name, *(f"{np.rad2deg(of(each)):.3f}" for each in (first, after)), ""])
    rows[-2][-1] = f"{100 * np.mean(inside):.0f} %"
    columns = [
        "run",
        "move, before [°]",
        "homing move [°]",
        "band, move",
    ]
    title = (
        f"da Vinci grasper, fitted without the run's motion class (all {len(logs)} runs at once: "
        f"{took:.0f} s, "
        f"{len(whole.fitted)} numbers)"
    )
    table("fit-da-vinci", title, columns, rows)


def main() -> None:
    """Run, print and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    started = time.perf_counter()
    fit(logs_of(start_rig(), {}, 0, ("ramps",), 2.0), start_rig(), FREE, workers=1)  # compiled once
    parameters(arguments.seeds, arguments.processes)
    instrument()
    print(f"{time.perf_counter() - started:.0f} s")


if __name__ == "__main__":
    main()
