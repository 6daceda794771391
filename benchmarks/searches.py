"""How far and how fast searches come: steps of four fixed dampings, of dampings around the last one, and with bends.

`python -m benchmarks.searches` (part of `make accuracy`) catches what a fit of each rig of `benchmarks.newcomers` searches
with all logs by the equations, and searches each anew from the same start, 200 iterations at most. Work is in gradients:
runs over all logs / (coordinates + 1).
"""

from __future__ import annotations

import argparse
import os
import tempfile
import warnings
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from benchmarks.newcomers import CASES
from benchmarks.report import table
from distal import fit
from distal.fitting import inverse, numbers, search

PLAIN = mock.patch.object(search, "_bent", return_value=[])
FIXED = mock.patch.multiple(
    search, FIRST_DAMPING=0.1, LEAST_DAMPING=0.1, MOST_DAMPING=0.1, DAMPINGS=(1.0, 10.0, 1000.0)
)
WAYS = {"four fixed dampings": (PLAIN, FIXED), "around the last": (PLAIN,), "with bends": ()}
MOST = 200


def caught(case: str, folder: Path, most: int) -> list[tuple[Any, Any, dict[str, Any]]]:
    """Return problem, start and options of the first searches of a fit with all logs."""
    rig, logs, _ = CASES[case](folder)
    found = list[tuple[Any, Any, dict[str, Any]]]()
    real = search.search

    def spy(problem: Any, start: Any, progress: Any = None, **options: Any) -> Any:
        whole = isinstance(problem, inverse.InverseProblem) and len(problem.data) == len(logs)
        if whole and options.get("most") is None and len(found) < most:
            found.append((problem, start, {k: v for k, v in options.items() if k in ("fixed", "near")}))
        return real(problem, start, progress, **options)

    with mock.patch.object(search, "search", spy), mock.patch.object(numbers, "search", spy):
        fit(logs, rig)
    return found


def searched(problem: Any, start: Any, options: dict[str, Any]) -> tuple[float, float]:
    """Return −ln p at the end and the work in gradients."""
    rows, real = [0], type(problem).run

    def run(self: Any, tasks: Any) -> Any:
        rows[0] += len(tasks)
        return real(self, tasks)

    with mock.patch.object(type(problem), "run", run):
        end = search.search(problem, start, most=MOST, **options)
    return end.cost, rows[0] / len(problem.data) / (problem.size + 1)


def main() -> None:
    """Print and save what each way takes and where it ends, over the searches of each rig."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--most", type=int, default=12, help="searches of a rig")
    most, rows = parser.parse_args().most, list[list[str]]()
    for case in (case for case in CASES if "given" not in case or "DISTAL_DATA" in os.environ):
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            problems = caught(case, Path(folder), most)
        ends = []
        for patches in WAYS.values():
            for patch in patches:
                patch.start()
            ends.append([searched(*each) for each in problems])
            for patch in patches:
                patch.stop()
        costs, work = np.moveaxis(np.array(ends), -1, 0)
        above = costs - costs.min(axis=0)
        row = [f"{a:.0f}, {b:.1f}" for a, b in zip(work.sum(axis=1), above.max(axis=1))]
        rows.append([case, str(len(problems)), *row])
        print(" | ".join(rows[-1]), flush=True)
    columns = ["rig", "searches", *(f"{way}: gradients, most above the best of −ln p" for way in WAYS)]
    table("searches", "where searches end", columns, rows)


if __name__ == "__main__":
    main()
