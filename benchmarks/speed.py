"""How fast: simulation and one filter step, compiled and interpreted, and the same job as a user
would do it today.

`python -m benchmarks.speed` (part of `make bench`). Times are medians within one run; compare the
ratios, not the µs. `python -m benchmarks.speed emitters` compares only the C of the emitter with
that of CasADi's generator.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.limits import (
    batch_time,
    casadi_time,
    filterpy_numpy,
    handwritten_time,
    lane_time,
    live_times,
    scan_time,
)
from benchmarks.report import FOLDER, table
from distal import load_rig, load_scenario, make_estimator, scenario_rig, simulate
from distal.kernels import Kernel, find_compiler, lanes_here
from distal.logs import write_log
from distal.model import Mechanism, substeps
from distal.run import samples_of
from distal.simulation.plant import plant_function

SAMPLES = 800
ROUNDS = 5


def step_times(
    kernel: Kernel, kernel_state: np.ndarray, rows: np.ndarray, p: np.ndarray, repeats: int = 12
) -> np.ndarray:
    """Return the times of single steps over a log [µs]; the first pass warms up."""
    loop = kernel.loop(p)
    times = []
    for repeat in range(repeats):
        loop.kernel_state[:] = kernel_state
        for row in rows:
            loop.x[:] = row
            start = time.perf_counter_ns()
            loop.step()
            end = time.perf_counter_ns()
            if repeat:
                times.append(end - start)
    return np.array(times) / 1e3


def filterpy_solve_ivp(rig_samples: np.ndarray, times: np.ndarray, count: int) -> np.ndarray:
    """Return the times per step [µs] of FilterPy's EKF on the paper's equations with
    solve_ivp(RK23), as a user would.
    """
    from filterpy.kalman import ExtendedKalmanFilter
    from scipy.integrate import solve_ivp
    from tests.helpers import NaiveRig

    naive = NaiveRig()
    width = np.array([0.05, 0.05 * naive.r, 0.05 * naive.r])
    peer = ExtendedKalmanFilter(dim_x=6, dim_z=2)
    peer.x = np.array([-0.436, rig_samples[0, 0], rig_samples[0, 1], 0, 0, 0])
    peer.P, peer.R, peer.Q = np.eye(6), 1e-9 * np.eye(2), 1e-3 * np.eye(6)
    jacobian = np.eye(6)[1:3]

    def flow(state: np.ndarray, effort: np.ndarray, dt: float) -> np.ndarray:
        done = solve_ivp(
            lambda t, y: naive.derivative(y, effort, width),
            (0, dt),
            state,
            method="RK23",
            rtol=1e-3,
            atol=1e-6,
        )
        return np.asarray(done.y[:, -1])

    taken = []
    for k in range(1, count):
        start = time.perf_counter_ns()
        effort = np.array([0.0, *rig_samples[k, 2:]])
        dt = times[k] - times[k - 1]
        center = flow(peer.x, effort, dt)
        peer.F = np.column_stack(
            [(flow(peer.x + 1e-6 * e, effort, dt) - center) / 1e-6 for e in np.eye(6)]
        )
        peer.P = peer.F @ peer.P @ peer.F.T + peer.Q
        peer.x = center
        peer.update(rig_samples[k, :2], lambda x: jacobian, lambda x: x[1:3])
        taken.append((time.perf_counter_ns() - start) / 1e3)
    return np.array(taken)


def emitters() -> None:
    """Measure the same kernels in the emitter's C, one by one and in lanes, and in the C of
    CasADi's generator.
    """
    scenario = load_scenario("series-2")
    rig = scenario_rig(scenario)
    log = simulate(rig, scenario)
    rows = []
    for name in ("adaptive", "ekf", "ekf-2008"):
        estimator = make_estimator(name, rig)
        ways = {
            "CasADi's C": casadi_time,
            "own C": scan_time,
            f"own C, {lanes_here()} lanes": lane_time,
        }
        rounds = [[way(estimator, log, np.min) for way in ways.values()] for _ in range(ROUNDS)]
        least = np.min(rounds, axis=0)  # others on the machine only ever make it slower
        for what, taken in zip(ways, least):
            rows.append([name, what, f"{taken:.2f}", f"{least[0] / taken:.2f}"])
    columns = ["estimator", "C", "per sample and run [µs]", "times as fast as CasADi's"]
    table("emitters", "Whole logs in one thread, paper-2008-printed", columns, rows)


def main() -> None:
    """Measure, print and save."""
    if sys.argv[1:] != ["emitters"]:
        everything()
    if not isinstance(find_compiler(), str):
        emitters()


def everything() -> None:
    """Measure simulation, filters, batches, peers and whole processes."""
    scenario = load_scenario("series-2")
    rig = scenario_rig(scenario)
    log = simulate(rig, scenario)
    print(f"C compiler: {find_compiler()}")
    compiles = not isinstance(find_compiler(), str)
    found: list[tuple[str, float, float | None]] = []
    if compiles:
        taken, difference = handwritten_time(rig, log)
        found.append(("ekf by hand in C, whole log", taken, None))
        print(f"largest difference of the hand-written ekf: {difference:.1e} rad")
        for name in ("ekf", "adaptive"):
            estimator = make_estimator(name, rig)
            found.append((f"{name}, compiled, whole log", scan_time(estimator, log), None))
            found.append(
                (f"{name}, in CasADi's own C, whole log", casadi_time(estimator, log), None)
            )
    for name in ("ekf", "ekf-2008", "adaptive", "inextensible"):
        for compiled in (True, False) if compiles else (False,):
            estimator = make_estimator(name, rig, compiled)
            samples = samples_of(log, estimator.channels)
            rows, _ = estimator.rows(np.diff(log.time, prepend=0.0), samples)
            times = step_times(
                estimator.kernel,
                estimator.initial(0.0, samples[0]).kernel_state,
                rows,
                estimator.parameters,
            )
            found.append((f"{name}, {estimator.kernel.backend}, one step", *_both(times)))
    found.append(("adaptive, LiveEstimator.step in Python", *_both(live_times(rig, log))))
    logs = [simulate(rig, scenario, seed) for seed in range(8)]
    batch_time(rig, logs, 16, 1)  # builds the kernel
    for workers in (1, 2):
        taken = batch_time(rig, logs, 1000, workers)
        found.append(
            (f"adaptive, batch of 1000 logs, {workers} worker{'s'[: workers - 1]}", taken, None)
        )
    mechanism = Mechanism(load_rig("paper-2008-printed"))
    count = substeps(mechanism, 0.01)
    for compiled in (True, False) if compiles else (False,):
        kernel = Kernel(plant_function(mechanism, count), compiled)
        x = np.zeros((SAMPLES, kernel.sizes.x))
        x[:, 1], x[:, 2], x[:, -1] = 3.0, 2.0, 0.01
        kernel_state = np.array([0.0, 2.5e-3, 2.5e-3, 0, 0, 0])
        times = step_times(kernel, kernel_state, x, mechanism.parameters.values)
        found.append((f"simulation of 10 ms, {kernel.backend}", *_both(times)))
    estimator = make_estimator("ekf", rig)
    order = [estimator.channels.index(name) for name in ("x1", "x2", "u1", "u2")]
    samples = samples_of(log, estimator.channels)[:, order]
    found.append(
        ("FilterPy EKF, sub-steps in NumPy", *_both(filterpy_numpy(samples, log.time, 400)))
    )
    peer = filterpy_solve_ivp(samples, log.time, 200)
    found.append(("FilterPy EKF, solve_ivp(RK23), numerical Jacobian", *_both(peer)))
    found.append(("of that, one solve_ivp(RK23)", *_both(peer / 7)))
    first = found[0][1]
    rows = [
        [name, f"{median:.2f}", "" if high is None else f"{high:.1f}", f"{median / first:.2f}"]
        for name, median, high in found
    ]
    columns = ["what", "median [µs]", "99 % [µs]", "ratio to the first"]
    table("speed", "One sample of 10 ms on paper-2008-printed", columns, rows)
    picture([(name, median) for name, median, _ in found])
    processes()


def _both(times: np.ndarray) -> tuple[float, float]:
    return float(np.median(times)), float(np.percentile(times, 99))


def processes() -> None:
    """Measure whole processes: `distal estimate` of a log of 12 s, with a warm cache and without a
    compiler.
    """
    scenario = load_scenario("series-2").model_copy(update={"duration": 12.0})
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        rig = scenario_rig(scenario)
        write_log(simulate(rig, scenario), rig, path)
        settings = [f"--set={key}={json.dumps(value)}" for key, value in scenario.set.items()]
        plain = path.with_name("plain.csv")  # without truth: one estimator, as in use
        plain.write_text(
            "\n".join(",".join(line.split(",")[:5]) for line in path.read_text().splitlines())
            + "\n"
        )
        for what, file, extra in (
            ("adaptive, warm cache", plain, {}),
            ("adaptive, without a compiler", plain, {"DISTAL_COMPILE": "0"}),
            ("compared with the truth, five estimators, warm cache", path, {}),
            ("the same, without a compiler", path, {"DISTAL_COMPILE": "0"}),
        ):
            command = [
                sys.executable,
                "-m",
                "distal",
                "estimate",
                str(file),
                "--rig",
                "paper-2008-printed",
                *settings,
            ]
            taken = []
            for _ in range(6):
                start = time.perf_counter()
                subprocess.run(
                    command, check=True, capture_output=True, env={**os.environ, **extra}
                )
                taken.append(time.perf_counter() - start)
            rows.append([what, f"{np.median(taken[1:]):.2f}", f"{max(taken[1:]):.2f}"])
    table(
        "processes",
        "`distal estimate` of a log of 12 s, the whole process",
        ["what", "median [s]", "longest [s]"],
        rows,
    )


def _ratio(value: float) -> str:
    return f"{value:,.0f} ×" if value >= 100 else f"{value:.3g} ×"


def picture(found: list[tuple[str, float]]) -> None:
    """Draw the medians as bars on a logarithmic scale."""
    from distal.results import COLOURS, figure, save_figure

    with figure(1, 1, (7.2, 4.6)) as (made, (axes,)):
        names, medians = [name for name, _ in found], [median for _, median in found]
        peers = ("solve_ivp", "FilterPy")
        colours = [
            COLOURS[1]
            if any(peer in name for peer in peers)
            else COLOURS[2]
            if "by hand" in name
            else COLOURS[0]
            for name in names
        ]
        axes.barh(names[::-1], medians[::-1], color=colours[::-1], height=0.6)
        for i, median in enumerate(medians[::-1]):
            axes.text(median * 1.1, i, _ratio(median / medians[0]), va="center", fontsize=8)
        axes.set_xscale("log")
        axes.set_xlim(right=max(medians) * 12)
        axes.set_xlabel("time per sample of 10 ms [µs]; × = ratio to the first")
        axes.grid(axis="y", visible=False)
    save_figure(made, FOLDER / "speed.svg")
    save_figure(made, FOLDER / "speed.png")


if __name__ == "__main__":
    main()
