"""`distal fit`: a rig's parameters and noise from its own logs."""

from __future__ import annotations

import os
import time
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from distal.cli.console import err, say, table
from distal.cli.options import MemoryOption, RigOption, SetOption, seconds
from distal.cli.outputs import check_outputs, to_file, to_folder
from distal.errors import DistalWarning, FitError, OutputError

if TYPE_CHECKING:
    from distal.fitting import CrossValidation, Fit, Score


EVERY = 5.0
"""Where progress goes to a file or a pipe, a line is written so often [s]."""


def fit_command(
    logs: Annotated[
        list[Path],
        typer.Argument(help=("Logs (CSV, Parquet, MCAP, ROS bags); some with the joint's angle, or all, or none.")),
    ],
    rig: RigOption,
    *,
    out: Annotated[Path | None, typer.Option("--out", help="Where to write the fitted rig (TOML).")] = None,
    free: Annotated[
        list[str] | None,
        typer.Option("--free", metavar="PATH", help="What is varied; repeatable. Default: all that have a std."),
    ] = None,
    per_log: Annotated[
        list[str] | None,
        typer.Option("--per-log", metavar="PATH", help="What each log has its own of, e.g. tendons.*.pretension."),
    ] = None,
    homing: Annotated[
        str | None,
        typer.Option(
            "--homing", help=("Fit to this use: the reference is known for so long (e.g. 3s), then predicted.")
        ),
    ] = None,
    truth: Annotated[str | None, typer.Option("--truth", help="True joint angle: a column of the logs.")] = None,
    noise: Annotated[bool, typer.Option("--noise/--no-noise", help="Fit the noise too.")] = True,
    curves: Annotated[
        bool,
        typer.Option(
            "--curves", help=("Learn the position sensors' systematic curves: for the same sensors, left in place.")
        ),
    ] = False,
    holdout: Annotated[
        str | None,
        typer.Option(
            "--holdout",
            help=(
                "Fit again without each log ('log') or group of logs (a regular expression, "
                "'run_(.)'): slower, and all of the fit."
            ),
        ),
    ] = None,
    units: Annotated[
        str | None,
        typer.Option(
            "--units",
            metavar="PATTERN",
            help=("Logs of several instruments of one kind: what tells them apart in a log's name, e.g. 'tool_(.)'."),
        ),
    ] = None,
    report: Annotated[Path | None, typer.Option("--report", help="Folder for a page on the fit.")] = None,
    start: Annotated[
        Path | None,
        typer.Option(
            "--start", help=("Begin the search at the values of an earlier fit; what is known before comes from --rig.")
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the starts.")] = 0,
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="How many logs are run at once.")] = 2,
    max_memory: MemoryOption = None,
    set_: SetOption = None,
) -> None:
    """Fit a rig's parameters and noise to logs, say what they can tell, and write a rig that estimates well on the next."""
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from distal.fitting import cross_validate, groups_of
    from distal.fitting import fit as fitted_to
    from distal.logs import read_log
    from distal.reports import FIT_PAGES, fit_report
    from distal.rig import edited_text, load_rig

    if out is not None and out.suffix != ".toml":
        raise OutputError(f"{out}: a rig file ends in .toml")
    outputs = [*to_file("--out", out), *to_folder("--report", report, FIT_PAGES)]
    check_outputs(outputs, logs=[*logs, *([start] if start is not None else [])], rig=rig, truth=truth)
    _check_logs(logs)
    if holdout is not None:
        groups_of([str(path) for path in logs], None if holdout == "log" else holdout)
    if units is not None:
        groups_of([str(path) for path in logs], units)
    home = seconds(homing) if homing is not None else None
    description = load_rig(rig, set_ or ())
    read = [read_log(path, description, truth) for path in logs]
    options: dict[str, Any] = {
        "free": free or (),
        "per_log": per_log or (),
        "noise": noise,
        "curves": curves,
        "seed": seed,
        "workers": jobs,
        "units": units,
        "start": start,
    }
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    # a file or a pipe shows a line now and then instead
    shown: dict[str, Any] = {"console": err(), "transient": True, "disable": not err().is_terminal}
    validation = None
    with Progress(*columns, **shown) as progress, warnings.catch_warnings():
        task = progress.add_task("reading")

        told = time.monotonic()

        def show(stage: str, iteration: int, cost: float) -> None:
            nonlocal told
            line = f"{stage}: iteration {iteration}, −ln p = {cost:.1f}"
            progress.update(task, description=line)
            if not err().is_terminal and time.monotonic() - told > EVERY:
                told = time.monotonic()
                err().print(line)

        result = fitted_to(read, description, homing=home, progress=show, **options)
        # what it warns of was said of the fit to all logs
        warnings.simplefilter("ignore", DistalWarning)
        if holdout is not None and not result.interrupted:
            pattern = None if holdout == "log" else holdout
            validation = cross_validate(read, description, pattern, home, progress=show, **options)
    _say(result)
    if validation is not None:
        _say_held_out(validation)
    if out is not None:
        result.save(out, edited_text(rig, set_ or ()))
    if report is not None:
        with Progress(*columns, **shown) as progress:
            progress.add_task("drawing")
            page = fit_report(result, read, report, validation)
    if out is not None:
        say(f"wrote {out}")
    if report is not None:
        say(f"wrote {page}")
    if result.interrupted:
        raise typer.Exit(130)


def _check_logs(logs: list[Path]) -> None:
    """Refuse a log that came twice."""
    names = [os.path.realpath(path) for path in logs]
    for path in names:
        if names.count(path) > 1:
            raise FitError(f"{path}: came more than once; a log that counts twice makes the fit too sure of itself")


def _say(result: Fit) -> None:
    rows = [
        (
            part.name,
            f"{part.start:.5g}" + ("" if np.isnan(part.prior_std) else f" ± {part.prior_std:.2g}"),
            f"{part.value:.5g} ± {part.error:.2g}",
            f"{part.si}, {part.origin}".lstrip(", "),
        )
        for part in result.fitted
    ]
    table(
        f"fitted to {len(result.logs)} log{'s' if len(result.logs) > 1 else ''}, {result.duration:.0f} s",
        ["number", "start ± prior std", "value ± standard error", "unit, from"],
        rows,
    )
    for part in result.fitted:
        for name, value in part.per_log.items():
            say(f"  {part.name} in {Path(name).name}: {value:.5g} {part.si}")
    for line in result.combinations:
        say(f"these logs tell {line}")
    ratios = ", ".join(
        f"{name} {before:.2f} → {after:.2f}"
        for name, before, after in zip(result.channels, result.nis_before, result.nis_after)
        if np.isfinite(after)
    )
    say(f"normalised innovations ν²/S (1 is expected): {ratios}")
    for one in result.maps.values():
        for line in one.notes:
            say(line)
    if result.compared:
        _say_left_out(result)
    for line in result.doubts:
        say(f"doubt: {line}")
    if result.verdict:
        say(result.verdict)
    if result.interrupted:
        say("interrupted: these are the best values so far")
    elif not result.converged:
        say("the search stopped before it converged; start closer, or fix what the logs cannot tell")


def _say_left_out(result: Fit) -> None:
    def cells(score: Score | None) -> tuple[str, str]:
        return ("–", "–") if score is None else (f"{np.rad2deg(score.rms):.3f}", f"{100 * score.inside:.0f} %")

    rows = [(Path(one.log).name, *cells(one.fitted), *cells(one.before), *cells(one.affine)) for one in result.compared]
    heads = [
        "log left out",
        "adaptive, fitted [°]",
        "in band",
        "rig as it came [°]",
        "in band",
        "affine [°]",
        "in band",
    ]
    table("each log left out once, RMS error by what the others teach", heads, rows)


def _say_held_out(validation: CrossValidation) -> None:
    rows = [
        (
            Path(one.log).name,
            f"{np.rad2deg(one.before.rms_error()):.3f}",
            f"{np.rad2deg(one.after.rms_error()):.3f}",
            f"{100 * one.after.inside_band():.0f} %",
        )
        for one in validation.held_out
    ]
    table("logs that were not fitted", ["log", "RMS before [°]", "RMS after [°]", "inside 95 % band"], rows)
    say(
        f"held out: mean RMS {np.rad2deg(validation.mean_rms):.3f}°, worst {np.rad2deg(validation.worst_rms):.3f}°, "
        f"{100 * validation.inside_band:.0f} % inside the band"
    )
