"""Run the benches of rigs and logs that distal was not built with, and print, store or compare
their tables.

`python -m benchmarks.strangers` runs all; `python -m benchmarks.strangers steps rigs --quick` two
of them, shortly; `--save FILE.json` stores every record, `--compare FILE.json` prints both runs
side by side.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

# read by the kernels before the first one is made: nearly every rig here is used once
os.environ["DISTAL_COMPILE"] = "0"

from rich.progress import track

from benchmarks.strangers import (
    contact,
    foreign,
    glitches,
    hands,
    homing,
    kinds,
    mistakes,
    poses,
    rigs,
    series,
    steps,
)
from benchmarks.strangers.scoring import Job, Record
from benchmarks.strangers.storage import common, load, moved, save, show, show_beside

BENCHES: dict[str, ModuleType] = {
    bench.NAME: bench
    for bench in (
        steps,
        glitches,
        rigs,
        series,
        poses,
        homing,
        kinds,
        foreign,
        hands,
        contact,
        mistakes,
    )
}


def run(job: Job) -> list[Record]:
    """Return the records of a job; the warning that kernels are interpreted, as asked for, is left
    out.
    """
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return job()


def main() -> None:
    """Run, print, store, compare."""
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
    parser.add_argument("--save", type=Path, metavar="FILE.json", help="store every record")
    parser.add_argument(
        "--compare", type=Path, metavar="FILE.json", help="print an earlier run beside this one"
    )
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    unknown = [name for name in arguments.benches if name not in BENCHES]
    if unknown:
        parser.error(f"unknown bench {', '.join(unknown)}; there are {', '.join(BENCHES)}")
    names = arguments.benches or list(BENCHES)
    then = load(arguments.compare) if arguments.compare else []
    started = time.perf_counter()
    jobs = [
        (name, job)
        for name in names
        for job in BENCHES[name].jobs(arguments.quick, arguments.first_seed)
    ]
    records: list[Record] = []
    with ProcessPoolExecutor(arguments.processes) as pool:
        made = pool.map(run, [job for _, job in jobs])
        for part in track(
            made,
            total=len(jobs),
            description="simulating and estimating",
            disable=not sys.stderr.isatty(),
        ):
            records.extend(part)
    before, after = common(then, records)
    for name in names:
        found = BENCHES[name].tables([one for one in records if one.bench == name])
        if not then:
            for each in found:
                show(each)
            continue
        pair = (
            BENCHES[name].tables([one for one in part if one.bench == name])
            for part in (before, after)
        )
        for old, new in zip(*pair):
            show_beside(old, new)
    if then:
        show(moved(before, after))
        missing = len(records) - len(after)
        print(
            f"{len(after)} records stand in both runs; {missing} of this run are not in "
            f"{arguments.compare}"
        )
    if arguments.save:
        command = " ".join(
            ["python -m benchmarks.strangers", *arguments.benches, *(["--quick"] * arguments.quick)]
        )
        save(
            records,
            arguments.save,
            f"distal {version('distal')}: {command} --first-seed {arguments.first_seed}",
        )
    print(f"{len(jobs)} jobs, {len(records)} records in {time.perf_counter() - started:.0f} s")


if __name__ == "__main__":
    main()
