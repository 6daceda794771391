"""The exported filters on an emulated Cortex-M4F: size, memory, instructions, and the error against double precision.

`python -m benchmarks.microcontroller` (part of `make bench`); needs gcc-arm-none-eabi and qemu-system-arm.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from tests.export.helpers import missing_tools

from benchmarks.report import table
from distal import Log, estimate, load_scenario, scenario_rig, shipped_scenarios, simulate_batch
from distal.export import c_filter
from distal.kernels import find_compiler
from distal.logs import write_log

SEEDS = 4


def nudged(log: Log) -> Log:
    """Return the log with values that differ as much as a float's rounding makes them."""
    rng = np.random.default_rng(0)
    channels = {name: values * (1 + 1e-7 * rng.normal(size=len(values))) for name, values in log.channels.items()}
    return Log(log.time, channels, log.truth, log.source, log.truth_source)


def float_errors() -> None:
    """Compare the float filters with double precision on the shipped scenarios, compiled for this machine."""
    from tests.export.test_export import build, replayed

    errors: dict[str, list[float]] = {}
    changes: dict[str, list[float]] = {}
    for shipped in shipped_scenarios():
        scenario = load_scenario(shipped)
        rig = scenario_rig(scenario)
        logs = list(simulate_batch(rig, ((scenario, seed) for seed in range(SEEDS))))
        for name in ("adaptive", "ekf-2008", "ekf"):
            with tempfile.TemporaryDirectory() as made:
                folder = Path(made)
                program = build(c_filter(rig, name, True), folder, "-O2")
                for log in logs:
                    write_log(log, rig, folder / "log.csv")
                    rows = replayed(program, folder / "log.csv")
                    error = np.abs(rows[:, 1] - estimate(log, rig, name).theta).max()
                    errors.setdefault(name, []).append(float(np.rad2deg(error)))
                    change = np.abs(estimate(nudged(log), rig, name).theta - estimate(log, rig, name).theta).max()
                    changes.setdefault(name, []).append(float(np.rad2deg(change)))
    rows = [
        [
            name,
            f"{np.median(found):.5f}",
            f"{max(found):.4f}",
            f"{sum(e <= 0.02 for e in found)} of {len(found)}",
            f"{max(changes[name]):.5f}",
        ]
        for name, found in errors.items()
    ]
    columns = ["estimator", "median [°]", "largest [°]", "logs within 0.02°", "double, inputs × (1 ± 1e-7) [°]"]
    table("float-errors", "Largest error of float against double, shipped scenarios", columns, rows)


def main() -> None:
    """Measure, print and save."""
    if not isinstance(find_compiler(), str):
        float_errors()
    missing = missing_tools()
    if missing:
        print(f"no Cortex-M here: {missing} is not installed")
        return
    from tests.export.test_microcontroller import cases, measure

    rows = []
    for rig_name, rig, scenario in cases():
        for estimator in ("adaptive", "ekf-2008"):
            with tempfile.TemporaryDirectory() as folder:
                measured, made = measure(rig, scenario, estimator, Path(folder))
            mean, most = measured.instructions
            rows.append(
                [
                    rig_name,
                    estimator,
                    f"{len(made.states)}",
                    f"{measured.flash / 1024:.1f}",
                    f"{measured.ram / 1024:.1f}",
                    f"{mean:,.0f}",
                    f"{most:,.0f}",
                    f"{measured.error_degrees:.5f}",
                ]
            )
    columns = ["rig", "estimator", "states", "flash [kB]", "RAM [kB]", "instructions", "most", "error [°]"]
    table(
        "microcontroller", "Float, -Os, Cortex-M4F: with startup, state, stack and mathematics library", columns, rows
    )


if __name__ == "__main__":
    main()
