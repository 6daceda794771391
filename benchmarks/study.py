"""What a design study costs and whether its answer holds: `python -m benchmarks.study [DESIGNS]`;
tables in out/bench.

The paper's rig, 3 rigs as built of each design, 10 s at 100 Hz with `adaptive`, from the command's
start to the page.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from math import sqrt
from pathlib import Path
from typing import Any

from benchmarks.report import table

STUDY = """
rig = "paper-2008-observed"
scenarios = ["series-2"]
duration = "10 s"
designs = {designs}
seeds = {seeds}
draw = {draw}

[vary]
"tendons.*.stiffness" = {{ from = "500 N/m", to = "4 N/mm", scale = "log" }}
"sensors.u1.noise" = {{ from = "0.2 N", to = "0.4 N" }}
"joints.link.friction.coefficient" = {{ from = 0.2, to = 0.6 }}

[requirement]
joint = "link"
within = "1 deg"
"""

LARGE = 100_000
"""Rows of the study whose memory is measured."""


def run(
    folder: Path, name: str, *options: str, designs: int, seeds: int = 3, draw: int = 1
) -> dict[str, Any]:
    """Run a study as a command and return its answer, with wall time and processor time [s]."""
    file = folder / f"{name}.toml"
    file.write_text(STUDY.format(designs=designs, seeds=seeds, draw=draw), encoding="utf-8")
    before, begun = os.times(), time.perf_counter()
    command = [
        sys.executable,
        "-m",
        "distal",
        "study",
        str(file),
        "--out",
        str(folder / name),
        *options,
    ]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    wall, after = time.perf_counter() - begun, os.times()
    answer = json.loads((folder / name / "answer.json").read_text(encoding="utf-8"))
    return {**answer, "wall": wall, "cpu": after.children_user - before.children_user}


def same(folder: Path, one: str, other: str) -> str:
    """Return whether two studies have the same rows but for their times."""
    import polars as pl

    first, second = (
        pl.read_parquet(folder / name / "rows.parquet").drop("seconds") for name in (one, other)
    )
    return "the same" if first.equals(second) else "OTHERS"


def large(folder: Path) -> tuple[float, float]:
    """Return peak memory [MB] and time [s] of the answer to a study of `LARGE` rows, made of those
    of a small one.
    """
    import polars as pl

    each = LARGE // 3
    file = folder / "large.toml"
    file.write_text(STUDY.format(designs=each, seeds=3, draw=1), encoding="utf-8")
    from distal.study import load_study, open_folder, space_of

    plan = load_study(file)
    rows = pl.read_parquet(folder / "two" / "rows.parquet")
    opened, chunks = open_folder(plan, folder / "large"), space_of(plan).chunks(3)
    for number, chunk in enumerate(chunks):
        part = rows[: 3 * len(chunk)].with_columns(
            pl.Series("design", [i for i in chunk for _ in range(3)])
        )
        opened.write(number, part.to_dict(as_series=False))  # type: ignore[arg-type]
    begun = time.perf_counter()
    code = (
        "import resource, sys; from distal.cli.app import app\n"
        f"app(['study', {str(file)!r}, '--out', {str(folder / 'large')!r}], "
        "standalone_mode=False)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return int(done.stdout.split()[-1]) / 1024, time.perf_counter() - begun


def interval(one: dict[str, Any], other: dict[str, Any]) -> float:
    """Return the half-width of the 95 % interval of the difference of two shares."""
    return 1.96 * sqrt(
        sum(a["share"] * (1 - a["share"]) / a["rigs"] for a in (one["overall"], other["overall"]))
    )


def main() -> None:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("designs", type=int, nargs="?", default=1000)
    parser.add_argument("--folder", type=Path, help="where the studies go; default a temporary one")
    options = parser.parse_args()
    with ExitStack() as stack:
        folder = options.folder or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=True)
        run(
            folder, "first", "--workers", "1", designs=96
        )  # kernels are compiled here, once per computer
        begun = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
        two = run(folder, "two", "--workers", "2", designs=options.designs)
        one = run(folder, "one", "--workers", "1", designs=options.designs)
        memory = max(begun, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss) / 1024
        fresh = run(folder, "fresh", "--workers", "2", designs=1000, seeds=1, draw=7)
        peak, seconds = large(folder)
        rows = [
            ("two processes", f"{two['wall']:.0f}", f"{two['cpu']:.0f}", ""),
            (
                "one",
                f"{one['wall']:.0f}",
                f"{one['cpu']:.0f}",
                f"{one['wall'] / two['wall']:.2f} × two",
            ),
        ]
        title = f"{options.designs} designs × 3 rigs × 10 s, the paper's rig, from start to page"
        table("study", title, ["", "wall [s]", "processor [s]", ""], rows)
        checks = [
            ("rows of one and two processes", same(folder, "one", "two")),
            ("largest process [MB]", f"{memory:.0f}"),
            (f"answer to {LARGE:,} rows: memory [MB], time [s]", f"{peak:.0f}, {seconds:.0f}"),
            ("share that is met [%]", f"{100 * two['overall']['share']:.1f}"),
            ("share of 1,000 fresh rigs [%]", f"{100 * fresh['overall']['share']:.1f}"),
            ("95 % interval of the difference [%]", f"±{100 * interval(two, fresh):.1f}"),
        ]
        table("study-checks", "Do the rows and the answer hold?", ["", ""], checks)


if __name__ == "__main__":
    main()
