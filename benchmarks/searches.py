"""How far and how fast searches come: that of a fit, and SciPy's `least_squares`.

`python -m benchmarks.searches` (part of `make accuracy`) catches what a fit of each rig of
`benchmarks.newcomers`, and of some of `benchmarks.strangers.lacking`, searches with all logs by the
equations, and searches each anew from the same start, 200 iterations at most. Work is in gradients:
runs over all logs / (coordinates + 1).
"""

from __future__ import annotations

import argparse
import os
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from tests.support.drawn_logs import FITTED
from tests.support.drawn_rigs import drawn_rig

from benchmarks.newcomers import CASES
from benchmarks.report import table
from benchmarks.strangers.lacking import logs_of
from distal import Log, Rig, fit
from distal.fitting import inverse_dynamics, likelihood, parameter_search
from distal.rig import build_rig

Floats = NDArray[np.float64]

WAYS = ("of a fit", "by SciPy")
MOST = 200
ROUNDS = 3
FIRST_LACKING = 100


def caught(rig: Rig, logs: Sequence[Log], most: int) -> list[tuple[Any, Any, dict[str, Any]]]:
    """Return problem, start and options of the first searches of a fit with all logs."""
    found = list[tuple[Any, Any, dict[str, Any]]]()
    real = parameter_search.search

    def spy(problem: Any, start: Any, progress: Any = None, **options: Any) -> Any:
        whole = isinstance(problem, inverse_dynamics.InverseProblem) and len(problem.data) == len(
            logs
        )
        if whole and options.get("most") is None and len(found) < most:
            found.append(
                (problem, start, {k: v for k, v in options.items() if k in ("fixed", "near")})
            )
        return real(problem, start, progress, **options)

    with mock.patch.object(parameter_search, "search", spy):
        fit(logs, rig)
    return found


def searched(problem: Any, start: Any, options: dict[str, Any], way: str) -> tuple[float, float]:
    """Return −ln p at the end and the work in gradients."""
    rows, real = [0], type(problem).run

    def run(self: Any, tasks: Any) -> Any:
        rows[0] += len(tasks)
        return real(self, tasks)

    with mock.patch.object(type(problem), "run", run):
        if way == WAYS[1]:
            end = by_scipy(problem, start, options.get("fixed"))
        else:
            end = parameter_search.search(problem, start, most=MOST, **options).z
    return float(problem.costs([end])[0]), rows[0] / len(problem.data) / (problem.size + 1)


def by_scipy(problem: Any, start: Any, fixed: Any) -> Floats:
    """Return where SciPy's trust region ends in three rounds, each with the channels' scales as
    found at its beginning.
    """
    low, high = problem.bounds.T
    z = np.clip(start, low, high)
    free = np.ones(problem.size, dtype=bool) if fixed is None else ~fixed
    widths = parameter_search.first_widths(problem)[free]
    for _ in range(ROUNDS):
        scale = problem.scales(problem.at(z))

        def residuals(at: Floats, z: Floats = z, scale: Floats = scale) -> Floats:
            whole = z.copy()
            whole[free] = at
            runs = problem.at(whole)
            parts = [
                residuals_of(run, problem._weighing(log, scale)) for log, run in enumerate(runs)
            ]
            return np.concatenate([*parts, whole / problem.prior_stds])

        def slopes(at: Floats, residuals: Any = residuals) -> Floats:
            base = residuals(at)
            ends = np.where(at + widths <= high[free], at + widths, at - widths)
            columns = []
            for k, end in enumerate(ends):
                moved = at.copy()
                moved[k] = end
                columns.append((residuals(moved) - base) / (end - at[k]))
            return np.column_stack(columns)

        bounds = (low[free], high[free])
        found = least_squares(residuals, z[free], slopes, bounds, x_scale="jac", max_nfev=MOST)
        z = z.copy()
        z[free] = found.x
    return z


def residuals_of(run: Any, weighing: Any) -> Floats:
    """Return values of which half the squares sum up to −ln p of a run, less its scales."""
    compared = np.isfinite(run.values)
    ratio = np.where(compared, run.values, 0.0) ** 2 / np.where(compared, run.variances, 1.0)
    ratio /= weighing.scale
    beyond = np.maximum(1.0, ratio / weighing.tolerance)
    weights = weighing.share * likelihood.evened(run, weighing)
    whole = np.sign(np.nan_to_num(run.values)) * np.sqrt(
        weights * (ratio / beyond + np.log(beyond))
    )
    return np.asarray(whole).ravel()


def rigs(folder: Path, lacking: int) -> Iterator[tuple[str, Rig, Sequence[Log]]]:
    """Return name, rig and logs to fit of the newcomers' rigs and of drawn rigs that lack
    something.
    """
    for case in (case for case in CASES if "given" not in case or "DISTAL_DATA" in os.environ):
        rig, logs, _ = CASES[case](folder)
        yield case, rig, logs
    for seed in range(FIRST_LACKING, FIRST_LACKING + lacking):
        drawn = drawn_rig(2 * seed, False)
        yield (
            f"lacking {seed}",
            build_rig(drawn.raw, f"lacking {seed}"),
            logs_of(drawn, seed)[0][:FITTED],
        )


def main() -> None:
    """Print and save what each way takes and where it ends, over the searches of each rig."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--most", type=int, default=12, help="searches of a rig")
    parser.add_argument("--lacking", type=int, default=10, help="drawn rigs that lack something")
    given, rows, whole = parser.parse_args(), list[list[str]](), np.zeros((2, len(WAYS)))
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, rig, logs in rigs(Path(folder), given.lacking):
            problems = caught(rig, logs, given.most)
            ends = [[searched(*each, way) for each in problems] for way in WAYS]
            costs, work = np.moveaxis(np.array(ends), -1, 0)
            above = costs - costs.min(axis=0)
            whole += [work.sum(axis=1), above.sum(axis=1)]
            rows.append([name, str(len(problems)), *said(work.sum(axis=1), above.sum(axis=1))])
            print(" | ".join(rows[-1]), flush=True)
    rows.append(["all", str(sum(int(row[1]) for row in rows)), *said(*whole)])
    columns = ["rig", "searches", *(f"{way}: gradients, −ln p above the best" for way in WAYS)]
    table("searches", "where searches end", columns, rows)


def said(work: Floats, above: Floats) -> list[str]:
    """Return the cells of all ways."""
    return [f"{a:.0f}, {b:.1f}" for a, b in zip(work, above)]


if __name__ == "__main__":
    main()
