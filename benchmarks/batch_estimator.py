"""Estimators step by step together, beside whole logs in a batch and one after the other: `python
-m benchmarks.batch_estimator [--n 1024] [--rig finger-2n] [--scenario finger] [--device cuda]`.

Times are of a sample of one estimator [µs], in one run on this machine.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

import numpy as np

from benchmarks.report import table
from distal import LiveEstimator, estimate_batch, load_rig, simulate
from distal.bridges.torch import BatchEstimator

SAMPLES = 200


def seconds(work: Callable[[], object]) -> float:
    """Return the time that some work takes [s]."""
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=1024)
    parser.add_argument("--rig", default="finger-2n")
    parser.add_argument("--scenario", default="finger")
    parser.add_argument("--device", default="cpu")
    asked = parser.parse_args()
    rig = load_rig(asked.rig)
    log = simulate(rig, asked.scenario, 0).select(slice(0, SAMPLES))
    count = asked.n * len(log.time)
    estimator = BatchEstimator(rig, asked.n, device=asked.device)
    dt = float(np.median(np.diff(log.time)))
    row = np.array([log.channels[name] for name in estimator.channels]).T
    samples = [estimator._xp.asarray(np.tile(each, (asked.n, 1))) for each in row]
    estimator.step(dt, samples[0])

    def together() -> None:
        for each in samples:
            found = estimator.step(dt, each)
        estimator._here(found.angles)  # when they have come

    live = LiveEstimator(rig)

    def alone() -> None:
        for k, each in enumerate(row):
            live.step(float(log.time[k]), each)

    list(estimate_batch([log] * 16, rig))
    few = [log] * min(asked.n, 256)
    times = {
        f"BatchEstimator, {asked.n} on {asked.device}": seconds(together) / count,
        f"estimate_batch, {len(few)} logs": seconds(lambda: list(estimate_batch(few, rig)))
        / (len(few) * len(log.time)),
        "LiveEstimator, one core": seconds(alone) / len(log.time),
    }
    one = times["LiveEstimator, one core"]
    rows = [[name, f"{1e6 * each:.2f}", f"{one / each:.1f}"] for name, each in times.items()]
    columns = ["way", "a sample [µs]", "one core / this"]
    table("batch_estimator", f"{asked.rig}, {os.cpu_count()} cores", columns, rows)


if __name__ == "__main__":
    main()
