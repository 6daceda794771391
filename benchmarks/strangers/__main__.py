"""Run the benches of rigs and logs that distal was not built with, and print their tables.

`python -m benchmarks.strangers` runs all; `python -m benchmarks.strangers steps rigs --quick` two
of them, shortly.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from types import ModuleType

# read by the kernels before the first one is made: nearly every rig here is used once
os.environ["DISTAL_COMPILE"] = "0"

import numpy as np
from rich.progress import track

from benchmarks.report import table
from benchmarks.strangers import foreign, glitches, hands, homing, kinds, poses, rigs, series, steps
from benchmarks.strangers.scoring import Job, Record, Table

BENCHES: dict[str, ModuleType] = {
    bench.NAME: bench
    for bench in (steps, glitches, rigs, series, poses, homing, kinds, foreign, hands)
}


def run(job: Job) -> list[Record]:
    """Return the records of a job; the warning that kernels are interpreted, as asked for, is left
    out.
    """
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return job()


def show(made: Table) -> None:
    """Print a table, and save it in out/bench."""
    rows = [
        [
            *labels,
            *(
                f"{number:.{decimals}f}" if np.isfinite(number) else "–"
                for number, (_, decimals) in zip(row, made.columns)
            ),
        ]
        for labels, row in made.rows.items()
    ]
    table(made.name, made.title, [*made.labels, *(name for name, _ in made.columns)], rows)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.strangers", description=__doc__)
    parser.add_argument(
        "benches", nargs="*", metavar="BENCH", help=f"of {', '.join(BENCHES)}; default all"
    )
    parser.add_argument("--quick", action="store_true", help="few seeds, under a minute")
    parser.add_argument(
        "--first-seed",
        type=int,
        default=0,
        help="other seeds give rigs and plants not looked at before",
    )
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    unknown = [name for name in arguments.benches if name not in BENCHES]
    if unknown:
        parser.error(f"unknown bench {', '.join(unknown)}; there are {', '.join(BENCHES)}")
    names = arguments.benches or list(BENCHES)
    started = time.perf_counter()
    jobs = [
        job for name in names for job in BENCHES[name].jobs(arguments.quick, arguments.first_seed)
    ]
    records: list[Record] = []
    with ProcessPoolExecutor(arguments.processes) as pool:
        for part in track(
            pool.map(run, jobs),
            total=len(jobs),
            description="simulating and estimating",
            disable=not sys.stderr.isatty(),
        ):
            records.extend(part)
    for name in names:
        for each in BENCHES[name].tables([one for one in records if one.bench == name]):
            show(each)
    print(f"{len(jobs)} jobs, {len(records)} records in {time.perf_counter() - started:.0f} s")


if __name__ == "__main__":
    main()
