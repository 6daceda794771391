"""Hostile rigs, logs and streams, 20,000 of each: what came of them, and the memory that it took.

`python -m benchmarks.reliability [inputs] [--first-seed N]`; the table is saved in out/bench. A
promise that does not hold is printed with its seed, and the exit code is 1. The fast part, with the
same code, is tests/test_fuzzing.py.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tests.fuzzing.logs import Logs, good_log
from tests.fuzzing.outcome import Outcome
from tests.fuzzing.rigs import attempt
from tests.fuzzing.streams import Stream

from benchmarks.report import table
from distal import load_rig, load_scenario, scenario_rig

WORKERS = 2
MOST = 2.0
"""Memory that no process may have [GB]."""


def rigs(folder: Path) -> Callable[[int], Outcome]:
    """Return what tries a rig file of a seed."""
    return lambda seed: attempt(seed, folder)


def logs(folder: Path) -> Callable[[int], Outcome]:
    """Return what tries a log of a seed."""
    scenario = load_scenario("template")
    rig = scenario_rig(scenario)
    return Logs(good_log(rig, scenario), rig, folder).attempt


def streams(folder: Path) -> Callable[[int], Outcome]:
    """Return what tries a stream's input of a seed: CSV and JSON, two estimators and
    `LiveEstimator.step`.
    """
    rig = load_rig("paper-2008-printed")
    made = [Stream(rig, csv, name) for csv in (True, False) for name in ("adaptive", "ekf")]
    return lambda seed: made[seed % len(made)].attempt(seed)


KINDS = {"rig files": rigs, "logs": logs, "stream inputs": streams}


def run(kind: str, first: int, count: int) -> tuple[Counter[str], list[str], float]:
    """Try inputs of one kind, and return how many came to what, promises that did not hold, and the
    peak memory [GB].
    """
    warnings.simplefilter("ignore")
    came, failed = Counter[str](), list[str]()
    with tempfile.TemporaryDirectory() as folder:
        one = KINDS[kind](Path(folder))
        for seed in range(first, first + count):
            outcome = one(seed)
            came[outcome.kind] += 1
            if not outcome.kept:
                failed.append(f"{kind}, seed {seed}: {outcome.why}")
    return came, failed, peak()


def peak() -> float:
    """Return the largest memory of this process and of those that it started [GB]."""
    return (
        max(
            resource.getrusage(who).ru_maxrss
            for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        )
        / 1e6
    )


def main() -> None:
    """Try everything, print a table, and end with 1 where a promise did not hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("inputs", type=int, nargs="?", default=20_000)
    parser.add_argument("--first-seed", type=int, default=0)
    given = parser.parse_args()
    share, rows, failed = given.inputs // WORKERS, [], list[str]()
    for kind in KINDS:
        began = time.perf_counter()
        with ProcessPoolExecutor(WORKERS) as pool:
            firsts = [given.first_seed + share * worker for worker in range(WORKERS)]
            parts = list(pool.map(run, [kind] * WORKERS, firsts, [share] * WORKERS))
        came = sum((part[0] for part in parts), Counter[str]())
        failed += [line for part in parts for line in part[1]]
        memory = max(part[2] for part in parts)
        if memory > MOST:
            failed.append(f"{kind}: a process had {memory:.1f} GB")
        parameters = [f"{came[word]:,}" for word in ("taken", "refused", "broken")]
        rows.append(
            (
                kind,
                f"{sum(came.values()):,}",
                *parameters,
                f"{memory:.2f}",
                f"{time.perf_counter() - began:.0f}",
            )
        )
    columns = (
        "input",
        "tried",
        "taken",
        "refused in one line",
        "promises broken",
        "most memory [GB]",
        "time [s]",
    )
    table("reliability", f"Hostile inputs, seeds from {given.first_seed} on", columns, rows)
    for line in failed[:50]:
        print(line)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
