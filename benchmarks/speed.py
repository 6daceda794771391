"""How fast: filter steps and whole logs, and the same job as a user would do it today.

`python -m benchmarks.speed` (part of `make bench`). Times are medians within one run; compare the
ratios, not the µs.
"""

from __future__ import annotations

import time

import numpy as np

from benchmarks.limits import batch_time, filterpy_numpy, handwritten_time, live_times, scan_time
from benchmarks.report import table
from distal import load_scenario, make_estimator, scenario_rig, simulate
from distal.estimators import KernelEstimator
from distal.kernels import find_compiler
from distal.logs import Log
from distal.run import samples_of

REPEATS = 12


def step_times(estimator: KernelEstimator, log: Log) -> np.ndarray:
    """Return the times of single steps over a log [µs]; the first pass warms up."""
    samples = samples_of(log, estimator.channels)
    rows, _ = estimator.rows(np.diff(log.time, prepend=0.0), samples)
    kernel_state = estimator.initial(0.0, samples[0]).kernel_state
    loop = estimator.kernel.loop(estimator.parameters)
    times = []
    for repeat in range(REPEATS):
        loop.kernel_state[:] = kernel_state
        for row in rows:
            loop.x[:] = row
            start = time.perf_counter_ns()
            loop.step()
            end = time.perf_counter_ns()
            if repeat:
                times.append(end - start)
    return np.array(times) / 1e3


def main() -> None:
    """Measure filters, batches and peers, print and save."""
    scenario = load_scenario("series-2")
    rig = scenario_rig(scenario)
    log = simulate(rig, scenario)
    print(f"C compiler: {find_compiler()}")
    taken, difference = handwritten_time(rig, log)
    print(f"largest difference of the hand-written ekf: {difference:.1e} rad")
    found = {"ekf by hand in C, whole log": taken}
    estimators = {name: make_estimator(name, rig) for name in ("ekf", "adaptive")}
    for name, estimator in estimators.items():
        found[f"{name}, compiled, whole log"] = scan_time(estimator, log)
    for name, estimator in estimators.items():
        found[f"{name}, compiled, one step"] = float(np.median(step_times(estimator, log)))
    found["adaptive, LiveEstimator.step in Python"] = float(np.median(live_times(rig, log)))
    logs = [simulate(rig, scenario, seed) for seed in range(8)]
    batch_time(rig, logs, 16, 1)  # builds the kernel
    for workers in (1, 2):
        what = f"adaptive, batch of 1000 logs, {workers} worker{'s'[: workers - 1]}"
        found[what] = batch_time(rig, logs, 1000, workers)
    samples = samples_of(log, ("x1", "x2", "u1", "u2"))
    peer = filterpy_numpy(samples, log.time, 400)
    found["FilterPy EKF, sub-steps in NumPy"] = float(np.median(peer))
    rows = [[what, f"{each:.2f}", f"{each / taken:.2f}"] for what, each in found.items()]
    columns = ["what", "median [µs]", "ratio to the first"]
    table("speed", "One sample of 10 ms on paper-2008-printed", columns, rows)


if __name__ == "__main__":
    main()
