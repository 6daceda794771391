"""`distal estimate` with several logs and `distal simulate --runs`: all cores, a progress bar and a
table.
"""

from __future__ import annotations

import os
import shlex
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from distal.cli.console import failure, progress_bar, say, table, warn
from distal.cli.paths import to_folder
from distal.confidence import COVERED
from distal.errors import DistalError, DistalWarning, EstimationError, OutputError
from distal.suggestions import did_you_mean

if TYPE_CHECKING:
    from distal.logs import Episode, Output
    from distal.rig import Rig
    from distal.simulation import Scenario


FEW = 4
"""Number of warnings printed for many logs; the others are counted. Source: layout."""


@contextmanager
def _few_warnings() -> Iterator[None]:
    """Print the first warnings and the number of the others, since many logs may have the same."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DistalWarning)
        yield
    messages = list(dict.fromkeys(str(warning.message) for warning in caught))
    for message in messages[:FEW]:
        warn(message)
    if len(messages) > FEW:
        warn(
            f"and {len(messages) - FEW} more of the other logs (estimate one log alone to see its "
            "warnings)"
        )


def estimate_many(
    logs: Sequence[Path | Episode],
    rig: Rig,
    estimator: str,
    truth: str | None,
    homing: float | None,
    out: Path | None,
    *,
    unit: str = "rad",
    every: bool = False,
    level: float = COVERED,
    scheduler: str | None = None,
) -> None:
    """Estimate over many logs, write each estimate to a folder, and print a line for each.

    A log that cannot be estimated is reported and skipped, and the command then ends with exit code
    2.

    Args:
        estimator: name of the estimator.
        truth: the true angle: a column of the logs, or a file; or None.
        homing: time for which the truth is used [s], or None.
        out: the folder; with None nothing is written.
        unit: unit of the angles that are written, rad or deg.
        every: whether all states are written.
        level: share of the errors that bands are to hold.
        scheduler: address of a Dask scheduler whose workers estimate instead.

    Raises:
        EstimationError: the estimator is unknown.
    """
    import numpy as np

    from distal.diagnosis import diagnose_estimate
    from distal.estimators import ESTIMATORS
    from distal.logs import write_columns
    from distal.results import make_folder
    from distal.run import estimate_batch, estimate_on_cluster

    if estimator not in ESTIMATORS:
        raise EstimationError(
            f"unknown estimator '{estimator}'{did_you_mean(estimator, ESTIMATORS)}"
        )
    if out is not None:
        make_folder(out)
    failed: dict[str, str] = {}

    def skip(source: str, problem: DistalError) -> None:
        failed[source] = str(problem)

    rows = list[tuple[str, ...]]()
    waiting = iter(logs)
    with _few_warnings(), progress_bar("estimating", len(logs)) as advance:
        found = (
            estimate_batch(logs, rig, estimator, truth, homing, progress=advance, skip=skip)
            if scheduler is None
            else estimate_on_cluster(
                logs, rig, scheduler, estimator, truth, homing, progress=advance, skip=skip
            )
        )
        for result in found:
            path = next(
                p for p in waiting if str(p) not in failed
            )  # results come in the order of the logs
            if out is not None:
                try:
                    write_columns(result.columns(unit, every=every), out / f"{path.stem}.csv")
                except OutputError as problem:
                    failed[str(path)] = str(problem)
                    continue
            result = replace(result, level=level)
            half = np.rad2deg(result.stds_of_band * float(np.median(result.angle_stds)))
            error = "–"
            inside = "–"
            if result.truths is not None:
                error = f"{np.rad2deg(result.rms_error()):.3f}"
                inside = f"{100 * result.inside_band():.0f} %"
            headline = diagnose_estimate(result).headline
            rows.append((path.name, f"{len(result)}", f"±{half:.2f}", error, inside, headline))
    if rows:
        columns = ["log", "samples", "median band [°]", "RMS [°]", "inside the band", "innovations"]
        table(f"{estimator} over {len(rows)} logs", columns, rows)
        if out is not None:
            say(f"wrote {len(rows)} estimates to {out}")
    for text in failed.values():
        failure(text)
    if failed:
        raise typer.Exit(2)


def estimates_of(logs: Sequence[Path | Episode], out: Path | None) -> list[Output]:
    """Return the file of each log's estimate.

    Raises:
        OutputError: a log came twice, two logs have the same name, or `out` is a file.
    """
    if len(
        {
            (os.path.realpath(path if isinstance(path, Path) else path.path), str(path.stem))
            for path in logs
        }
    ) < len(logs):
        raise OutputError("a log came more than once; give each once")
    if out is None:
        return []
    _check_folder(out, "of several logs")
    names = [f"{path.stem}.csv" for path in logs]
    for path, name in zip(logs, names):
        if names.count(name) > 1:
            raise OutputError(
                f"{path}: another log has the name '{path.stem}' too; rename one, or estimate "
                "them apart"
            )
    return [
        file
        for path, name in zip(logs, names)
        for file in to_folder(f"--out for {path}", out, [name])
    ]


def runs_of(seed: int, runs: int) -> dict[int, str]:
    """Return seed → name of the log's file, for as many seeds as `runs` from `seed` on."""
    digits = len(str(seed + runs - 1))
    return {number: f"run_{number:0{digits}d}.csv" for number in range(seed, seed + runs)}


def logs_of(seed: int, runs: int, out: Path) -> list[Output]:
    """Return the files of as many simulated logs as `runs`, with seeds from `seed` on.

    Raises:
        OutputError: `out` is a file.
    """
    _check_folder(out, "with --runs")
    return to_folder("--out", out, runs_of(seed, runs).values())


def _check_folder(out: Path, when: str) -> None:
    from distal.logs import TABLES

    if os.path.isfile(out) or out.suffix.lower() in TABLES:
        raise OutputError(f"{out}: is a file, or named like one; {when}, --out is a folder")


def simulate_many(
    rig: Rig,
    scenario: Scenario,
    seed: int,
    runs: int,
    out: Path,
    settings: list[str],
    *,
    truth: bool = True,
) -> None:
    """Simulate a scenario with several seeds, and write each log to a folder.

    Args:
        seed: the first seed.
        runs: number of seeds.
        settings: ``--set`` options, for the command that is printed as a hint.
        truth: whether the truth is written.
    """
    from distal.logs import write_log
    from distal.results import make_folder
    from distal.simulation import simulate_batch

    make_folder(out)
    names = runs_of(seed, runs)
    with progress_bar("simulating", runs) as advance:
        logs = simulate_batch(rig, ((scenario, number) for number in names), progress=advance)
        for name, log in zip(names.values(), logs):
            write_log(log if truth else replace(log, truth={}), rig, out / name)
    say(f"{rig.name}: {runs} runs of {scenario.duration:g} s, seeds {seed} to {seed + runs - 1}")
    say(f"wrote {runs} logs to {out}")
    command = [
        "distal estimate",
        f"{shlex.quote(str(out))}/*.csv",
        "--rig",
        scenario.rig,
        *settings,
    ]
    say(f"estimate from them: {' '.join(command)}")
