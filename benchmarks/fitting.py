"""How well a fit finds a plant, with and without truth, on another simulator, and on a real
instrument.

`python -m benchmarks.fitting` (part of `make accuracy`); the tables are saved in out/bench.
"""

from __future__ import annotations

import argparse
import os
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
from tests.support.plant_and_rig import FREE, drawn_plant, logs_of, start_rig, without_truth

from benchmarks.report import table
from benchmarks.shell import estimate
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


def blind(seed: int) -> tuple[float, float, float]:
    """Return the RMS error on two new logs [°]: rig as it came, fitted without truth, true rig."""
    rig = start_rig()
    plant, _ = drawn_plant(seed)
    found = fit([without_truth(log) for log in logs_of(rig, plant, seed)], rig, workers=1)
    held = logs_of(rig, plant, seed + 1000, ("ramps", "servo"))
    rigs = (rig, found.rig, rig.with_values(plant))
    errors = [
        np.sqrt(np.mean([estimate(log, each).rms_error() ** 2 for log in held])) for each in rigs
    ]
    return tuple(float(np.rad2deg(error)) for error in errors)  # type: ignore[return-value]


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


def next_log(seeds: int, processes: int) -> None:
    """Print the errors on new logs after a fit without truth."""
    with ProcessPoolExecutor(processes) as pool:
        fitted = np.array(list(pool.map(blind, range(seeds))))
    pooled = np.sqrt(np.mean(fitted**2, axis=0))
    ratio = fitted[:, 1] / fitted[:, 2]
    row = [
        *(f"{value:.3f}" for value in pooled),
        f"{pooled[1] / pooled[2]:.2f}",
        f"{ratio.max():.2f}",
    ]
    columns = ["rig as it came [°]", "fitted [°]", "true rig [°]", "fitted / true", "worst seed"]
    table(
        "fit-blind",
        f"Fitted to three logs without truth, RMS on new logs, {seeds} plants",
        columns,
        [row],
    )


def other_simulator() -> None:
    """Print errors on MuJoCo logs after a fit to one of them."""
    try:
        from tests import mujoco_plant
    except ImportError:
        print("MuJoCo is not installed: its table is left out")
        return
    rig, rows = load_rig("pulley-antagonist"), []
    for share, sensors in ((0.8, 50), (1.0, 51), (1.2, 52)):
        made = partial(
            mujoco_plant.log, sensors=sensors, link_friction=share * mujoco_plant.LINK_FRICTION
        )
        try:
            logs = [made(seed) for seed in range(6)]
        except ImportError:
            print("MuJoCo is not installed: its table is left out")
            return
        cells = [f"friction × {share:g}"]
        for each in (rig, fit(logs[:1], rig).rig):
            estimates = [estimate(log, each) for log in logs[1:]]
            rms = np.sqrt(np.mean([one.rms_error() ** 2 for one in estimates]))
            cells += [
                f"{np.rad2deg(rms):.3f}",
                f"{100 * np.mean([one.inside_band() for one in estimates]):.0f} %",
            ]
        rows.append(cells)
    columns = [
        "plant",
        "as it came [°]",
        "band",
        "fitted [°]",
        "band",
    ]
    table(
        "fit-mujoco",
        "MuJoCo: fitted to one servo log, RMS on five others of the same sensors",
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
    parser.add_argument("--blind-seeds", type=int, default=12)
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    started = time.perf_counter()
    fit(logs_of(start_rig(), {}, 0, ("ramps",), 2.0), start_rig(), FREE, workers=1)  # compiled once
    parameters(arguments.seeds, arguments.processes)
    next_log(arguments.blind_seeds, arguments.processes)
    other_simulator()
    instrument()
    print(f"{time.perf_counter() - started:.0f} s")


if __name__ == "__main__":
    main()
