"""The exported filters on an emulated Cortex-M4F: size, memory, instructions, and the error against
double precision.

`python -m benchmarks.microcontroller` (part of `make bench`); needs gcc-arm-none-eabi and
qemu-system-arm. Names of tables (float-errors, microcontroller, casadi) leave out the others;
`casadi` compares with the C of CasADi's own generator.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
from tests.export.helpers import missing_tools

from benchmarks.report import table
from distal import (
    Log,
    Rig,
    estimate,
    load_rig,
    load_scenario,
    make_estimator,
    scenario_rig,
    shipped_scenarios,
    simulate,
)
from distal.codegen import Emitter, Plain
from distal.codegen.operations_and_number_types import CALLED
from distal.export import Exported, c_filter
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
    """Compare the float filters with double precision on the shipped scenarios, compiled for this
    machine.
    """
    from tests.export.helpers import build, replayed

    errors: dict[str, list[float]] = {}
    changes: dict[str, list[float]] = {}
    for shipped in shipped_scenarios():
        scenario = load_scenario(shipped)
        rig = scenario_rig(scenario)
        if len(rig.joints) > 1:  # chains are in the table of rigs
            continue
        logs = [simulate(rig, scenario, seed) for seed in range(SEEDS)]
        for name in ("adaptive", "ekf-2008", "ekf"):
            with tempfile.TemporaryDirectory() as made:
                folder = Path(made)
                program = build(c_filter(rig, name, True), folder, "-O2")
                for log in logs:
                    write_log(log, rig, folder / "log.csv")
                    rows = replayed(program, folder / "log.csv")
                    error = np.abs(rows[:, 1] - estimate(log, rig, name).theta).max()
                    errors.setdefault(name, []).append(float(np.rad2deg(error)))
                    change = np.abs(
                        estimate(nudged(log), rig, name).theta - estimate(log, rig, name).theta
                    ).max()
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
    columns = [
        "estimator",
        "median [°]",
        "largest [°]",
        "logs within 0.02°",
        "double, inputs × (1 ± 1e-7) [°]",
    ]
    table("float-errors", "Largest error of float against double, shipped scenarios", columns, rows)


_PRIOR = """
static void {name}_called(const float* known, const float* mask, const float* p, float* mean, float* spread, float* rest) {{
  const float* arg[{sz_arg}];
  float* res[{sz_res}];
  casadi_int iw[{sz_iw}];
  float w[{sz_w}];
  arg[0] = known; arg[1] = mask; arg[2] = p;
  res[0] = mean; res[1] = spread; res[2] = rest;
  {name}(arg, res, iw, w, 0);
}}
"""
_STEP = """
static void {name}_called(float* state, const float* x, const float* p, float* y) {{
  const float* arg[{sz_arg}];
  float* res[{sz_res}];
  casadi_int iw[{sz_iw}];
  float w[{sz_w}], next[{n_kernel_state}];
  arg[0] = state; arg[1] = x; arg[2] = p;
  res[0] = next; res[1] = y;
  {name}(arg, res, iw, w, 0);
  memcpy(state, next, sizeof next);
}}
"""


def in_casadis_c(rig: Rig, estimator: str) -> Exported:
    """Return the float filter with its two functions in the C of CasADi's generator, and all the
    rest as it is.

    CasADi knows only the names of functions of double precision: those of float are put in their
    place.
    """
    made = c_filter(rig, estimator, True, "filter")
    chosen = make_estimator(estimator, rig, compiled=False)
    functions = chosen.prior_function(), chosen.kernel.function
    emitter = Emitter(Plain(True))
    names = emitter.add(functions[0]), emitter.add(functions[1], in_place=True)
    assert emitter.text in made.source
    generator = ca.CodeGenerator(
        "casadi.c", {"casadi_real": "float", "casadi_int": "int", "with_header": False}
    )
    calls = []
    for function, template in zip(functions, (_PRIOR, _STEP)):
        generator.add(function)
        sizes = {
            "sz_arg": function.sz_arg(),
            "sz_res": function.sz_res(),
            "n_kernel_state": function.numel_out(0),
        }
        work = {"sz_iw": function.sz_iw() + 1, "sz_w": function.sz_w() + 1}
        calls.append(template.format(name=function.name(), **sizes, **work))
    floats = "\n".join(
        f"#define {function} {function}f" for function in sorted(set(CALLED.values()))
    )
    text = f"{floats}\n{generator.dump()}\n{''.join(calls)}"
    before, after = made.source.split(emitter.text)
    for name, function in zip(names, functions):
        after = after.replace(f" {name}(", f" {function.name()}_called(")
    return replace(made, source=before + text + after)


def against_casadi() -> None:
    """Compare the emitter with CasADi's generator: the same functions, compiler, flags and
    frame.
    """
    from tests.export.test_microcontroller import measure

    rows = []
    for rig_name, rig, scenario in cases():
        for estimator in ("adaptive", "ekf-2008"):
            found = []
            for made in (None, in_casadis_c(rig, estimator)):
                with tempfile.TemporaryDirectory() as folder:
                    flags = (
                        [] if made is None else ["-fsingle-precision-constant", "-w", "-Wno-error"]
                    )
                    measured, _ = measure(rig, scenario, estimator, Path(folder), made, flags)
                assert measured.error_degrees < 0.02  # both are the same filter
                found.append((measured.flash / 1024, measured.ram / 1024, measured.instructions[0]))
            for whose, (flash, ram, instructions) in zip(("own", "CasADi"), found):
                rows.append(
                    [
                        rig_name,
                        estimator,
                        whose,
                        f"{flash:.1f}",
                        f"{ram:.1f}",
                        f"{instructions:,.0f}",
                    ]
                )
            ratios = [f"{other / own:.2f} ×" for own, other in zip(*found)]
            rows.append(["", "", "ratio", *ratios])
    columns = ["rig", "estimator", "C", "flash [kB]", "RAM [kB]", "instructions"]
    table(
        "casadi",
        "The emitter and CasADi's generator: float, -Os, Cortex-M4F, as in the table before",
        columns,
        rows,
    )


def main() -> None:
    """Measure, print and save."""
    desired = sys.argv[1:] or ["float-errors", "microcontroller", "casadi"]
    if "float-errors" in desired and not isinstance(find_compiler(), str):
        float_errors()
    missing = missing_tools()
    if missing:
        print(f"no Cortex-M here: {missing} is not installed")
        return
    if "microcontroller" in desired:
        sizes()
    if "casadi" in desired:
        against_casadi()


def sizes() -> None:
    """Measure flash, RAM, instructions and the error of the exported filters."""
    from tests.export.test_microcontroller import measure

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
