"""The exported filters on an emulated Cortex-M4F: size, memory, instructions, and the error against
double precision.

`python -m benchmarks.microcontroller` (part of `make bench`); needs gcc-arm-none-eabi and
qemu-system-arm.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from tests.export.helpers import missing_tools

from benchmarks.report import table
from distal import (
    Log,
    Rig,
    estimate,
    load_rig,
    load_scenario,
    scenario_rig,
    shipped_scenarios,
    simulate,
)
from distal.export import c_filter
from distal.kernels import find_compiler
from distal.logs import write_log
from distal.simulation import Scenario, build_scenario

SEEDS = 4


def nudged(log: Log) -> Log:
    """Return the log with values that differ as much as a float's rounding makes them."""
    rng = np.random.default_rng(0)
    channels = {
        name: values * (1 + 1e-7 * rng.normal(size=len(values)))
        for name, values in log.channels.items()
    }
    return Log(log.time, channels, log.truth, log.source, log.truth_source)


def cases() -> list[tuple[str, Rig, Scenario]]:
    """Return rigs to measure, and what moves them."""
    made = []
    for name in ("paper-2008-printed", "pulley-antagonist", "capstan-joint", "da-vinci-grasper"):
        if name == "paper-2008-printed":
            scenario = load_scenario("series-2")
        else:
            servo = {
                "angle": {"amplitude": 0.5, "frequency": 0.4},
                "stiffness": 20.0,
                "damping": 0.3,
            }
            pull = {"weight": {"mean": "3 N", "amplitude": "1 N", "frequency": "0.5 Hz"}}
            drives = (
                {"left": pull, "right": {"weight": "3 N"}}
                if name == "pulley-antagonist"
                else {"motor": {"servo": servo}}
            )
            scenario = build_scenario({"rig": name, "duration": 4.0, "drives": drives}, name)
        made.append((name, scenario_rig(scenario), scenario))
    return [*made, *chains()]


def chains() -> list[tuple[str, Rig, Scenario]]:
    """Return chains of joints, and what moves them."""
    made = [
        (name, scenario_rig(scenario), scenario)
        for name, scenario in (
            ("wrist-instrument", load_scenario("wrist")),
            ("finger-2n", load_scenario("finger")),
        )
    ]
    rig = load_rig("finger-n-plus-1")
    drives = {}
    for k, drive in enumerate(rig.drives):
        position = {"amplitude": "2 mm" if k % 2 else "-2 mm", "frequency": "0.4 Hz"}
        drives[drive.name] = {
            "force": "10 N",
            "servo": {"position": position, "stiffness": 5000.0, "damping": 10.0},
        }
    described = {"rig": "finger-n-plus-1", "duration": 4.0, "drives": drives}
    return [*made, ("finger-n-plus-1", rig, build_scenario(described, "finger-n-plus-1"))]


def float_errors() -> None:
    """Compare the float filter with double precision on the shipped scenarios, compiled for this
    machine.
    """
    from tests.export.helpers import build, replayed

    errors, changes = list[float](), list[float]()
    for shipped in shipped_scenarios():
        scenario = load_scenario(shipped)
        rig = scenario_rig(scenario)
        if len(rig.joints) > 1:  # chains are in the table of rigs
            continue
        with tempfile.TemporaryDirectory() as made:
            folder = Path(made)
            program = build(c_filter(rig, "adaptive", True), folder, "-O2")
            for log in (simulate(rig, scenario, seed) for seed in range(SEEDS)):
                write_log(log, rig, folder / "log.csv")
                angles = estimate(log, rig).theta
                error = np.abs(replayed(program, folder / "log.csv")[:, 1] - angles).max()
                change = np.abs(estimate(nudged(log), rig).theta - angles).max()
                errors.append(float(np.rad2deg(error)))
                changes.append(float(np.rad2deg(change)))
    row = [
        "adaptive",
        f"{np.median(errors):.5f}",
        f"{max(errors):.4f}",
        f"{sum(e <= 0.02 for e in errors)} of {len(errors)}",
        f"{max(changes):.5f}",
    ]
    rows = [row]
    columns = [
        "estimator",
        "median [°]",
        "largest [°]",
        "logs within 0.02°",
        "double, inputs × (1 ± 1e-7) [°]",
    ]
    table("float-errors", "Largest error of float against double, shipped scenarios", columns, rows)


def main() -> None:
    """Measure, print and save."""
    if not isinstance(find_compiler(), str):
        float_errors()
    missing = missing_tools()
    if missing:
        print(f"no Cortex-M here: {missing} is not installed")
        return
    sizes()


def sizes() -> None:
    """Measure flash, RAM, instructions and the error of the exported filters."""
    from tests.export.test_microcontroller import measure

    rows = []
    for rig_name, rig, scenario in cases():
        with tempfile.TemporaryDirectory() as folder:
            measured, made = measure(rig, scenario, "adaptive", Path(folder))
        mean, most = measured.instructions
        rows.append(
            [
                rig_name,
                "adaptive",
                f"{len(made.estimator.state_names)}",
                f"{measured.flash / 1024:.1f}",
                f"{measured.ram / 1024:.1f}",
                f"{mean:,.0f}",
                f"{most:,.0f}",
                f"{measured.error_degrees:.5f}",
            ]
        )
    columns = [
        "rig",
        "estimator",
        "states",
        "flash [kB]",
        "RAM [kB]",
        "instructions",
        "most",
        "error [°]",
    ]
    table(
        "microcontroller",
        "Float, -Os, Cortex-M4F: with startup, state, stack and mathematics library",
        columns,
        rows,
    )


if __name__ == "__main__":
    main()
