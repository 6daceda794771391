"""`distal estimate` of several logs, `distal simulate --runs`: all cores, a progress bar, a table."""

from __future__ import annotations

import shlex
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from distal.cli.console import err, say, table
from distal.errors import DistalError, DistalWarning, EstimationError, OutputError, did_you_mean

if TYPE_CHECKING:
    from distal.rig import Rig
    from distal.simulation import Scenario


FILES = (".csv", ".parquet", ".pq")


@contextmanager
def _progress(what: str, total: int) -> Iterator[Any]:
    """Show a progress bar on a terminal; a file or a pipe shows none."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = err()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(what, total=total)
        yield lambda done: progress.update(task, completed=done)


FEW = 4
"""Warnings that are printed of many logs; of the others, how many there were."""


@contextmanager
def _few_warnings() -> Iterator[None]:
    """Print the first warnings, and how many more came: a thousand logs may all have the same."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DistalWarning)
        yield
    said = list(dict.fromkeys(str(one.message) for one in caught))
    for text in said[:FEW]:
        print(f"warning: {text}", file=sys.stderr)
    if len(said) > FEW:
        print(
            f"warning: and {len(said) - FEW} more of the other logs (estimate one alone to see its own)",
            file=sys.stderr,
        )


def estimate_many(
    logs: list[Path], rig: Rig, estimator: str, truth: str | None, homing: float | None, out: Path | None
) -> None:
    """Estimate over many logs, write each estimate to a folder, and print a line for each.

    A log that cannot be estimated is said and left out; the others go on, and the command ends with code 2.

    Args:
        logs: their paths.
        rig: the description.
        estimator: its name.
        truth: the true angle's column.
        homing: for how long the truth is used [s].
        out: folder for the estimates, or None.
    """
    from distal.estimators import ESTIMATORS
    from distal.logs import write_columns
    from distal.results import BAND, diagnose
    from distal.running import estimate_batch

    if estimator not in ESTIMATORS:
        raise EstimationError(f"unknown estimator '{estimator}'{did_you_mean(estimator, ESTIMATORS)}")
    targets = _targets(logs, out)
    failed: dict[Path, str] = {}

    def skip(source: str, problem: DistalError) -> None:
        failed[Path(source)] = str(problem)

    rows: list[tuple[Path, str, str, str, str, str]] = []
    with _few_warnings(), _progress("estimating", len(logs)) as advance:
        results = estimate_batch(logs, rig, estimator, truth, homing, progress=advance, skip=skip)
        for result in results:
            path = next(p for p in logs if p not in failed and p not in {row[0] for row in rows})
            if out is not None:
                try:
                    write_columns(result.columns(), targets[path])
                except OutputError as problem:
                    failed[path] = str(problem)
                    continue
            half = np.rad2deg(BAND * float(np.median(result.angle_stds)))
            error, inside = "–", "–"
            if result.truths is not None:
                error, inside = f"{np.rad2deg(result.rms_error()):.3f}", f"{100 * result.inside_band():.0f} %"
            rows.append((path, f"{len(result)}", f"±{half:.2f}", error, inside, diagnose(result).text.split(":")[0]))
    if rows:
        named = [(path.name, *rest) for path, *rest in rows]
        table(
            f"{estimator} over {len(rows)} logs",
            ["log", "samples", "median band [°]", "RMS [°]", "inside the band", "innovations"],
            named,
        )
        if out is not None:
            say(f"wrote {len(rows)} estimates to {out}")
    for text in failed.values():
        print(f"error: {text}", file=sys.stderr)
    if failed:
        raise typer.Exit(2)


def _targets(logs: list[Path], out: Path | None) -> dict[Path, Path]:
    """Return where each estimate goes, before anything is computed.

    Raises:
        OutputError: two would have one name, or one would replace a log.
    """
    if len({path.resolve() for path in logs}) < len(logs):
        raise OutputError("a log came more than once; give each once")
    if out is None:
        return {}
    if (out.exists() and not out.is_dir()) or out.suffix.lower() in FILES:
        raise OutputError(f"{out}: is a file, or named like one; of several logs, --out is a folder")
    targets = {path: out / f"{path.stem}.csv" for path in logs}
    names = list(targets.values())
    for path, target in targets.items():
        if names.count(target) > 1:
            raise OutputError(f"{path}: another log has the name '{path.stem}' too; rename one, or estimate them apart")
        if target.resolve() in {each.resolve() for each in logs}:
            raise OutputError(f"{target}: is an input of this command; give another folder")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise OutputError(f"{out}: cannot be made ({problem.strerror})") from None
    return targets


def simulate_many(rig: Rig, scenario: Scenario, seed: int, runs: int, out: Path, settings: list[str]) -> None:
    """Simulate a scenario with seeds from `seed` on, and write each log to a folder.

    Args:
        rig: the description.
        scenario: what is done.
        seed: of the first run.
        runs: how many.
        out: the folder.
        settings: options that `distal estimate` needs.
    """
    from distal.logs import write_log
    from distal.simulation import simulate_batch

    if (out.exists() and not out.is_dir()) or out.suffix.lower() in FILES:
        raise OutputError(f"{out}: is a file, or named like one; with --runs, --out is a folder")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise OutputError(f"{out}: cannot be made ({problem.strerror})") from None
    seeds = range(seed, seed + runs)
    with _progress("simulating", runs) as advance:
        jobs = ((scenario, number) for number in seeds)
        for number, log in zip(seeds, simulate_batch(rig, jobs, progress=advance)):
            write_log(log, rig, out / f"run_{number:0{len(str(seeds[-1]))}d}.csv")
    say(f"{rig.name}: {runs} runs of {scenario.duration:g} s, seeds {seeds[0]} to {seeds[-1]}")
    say(f"wrote {runs} logs to {out}")
    say(
        "estimate from them: "
        + " ".join(["distal estimate", f"{shlex.quote(str(out))}/*.csv", "--rig", scenario.rig, *settings])
    )
