"""`distal rig from-logs` and `distal learn`: from logs alone to a rig file, and to angles."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer
from typer import Argument, Option

from distal.cli.console import say, stoppable, table, working
from distal.cli.fit_command import (
    MOST_LINES,
    MinutesOption,
    is_mostly_noise,
    save_fit,
    say_scores,
)
from distal.cli.rig_commands import OutOption, app, check_new_rig
from distal.cli.shared_options import (
    LagOption,
    check_command_outputs,
    check_new,
    in_si,
    to_file,
    to_folder,
)
from distal.errors import RigError

if TYPE_CHECKING:
    from distal.fitting import Fit
    from distal.from_logs import RigFromLogs
    from distal.logs import Log

LogsArgument = Annotated[
    list[Path],
    Argument(
        help="Logs with the same columns (CSV, Parquet, HDF5, MCAP, ROS bags, LeRobot "
        "datasets), some with the joints' angles."
    ),
]
JointsOption = Annotated[
    str | None,
    Option("--truth", help="Columns that are joints' angles, separated by commas."),
]
DrivesOption = Annotated[
    list[str] | None,
    Option(
        "--drive",
        help="A column that is a drive's position, with its unit: m1=ticks. Repeatable.",
    ),
]
IgnoreOption = Annotated[
    str | None, Option("--ignore", help="Columns that are none of this, separated by commas.")
]


class Roles(TypedDict):
    """What is said of columns, as the arguments of `rig_from_logs`."""

    truth: list[str]
    drives: dict[str, str]
    ignore: list[str]


def roles_of(truth: str | None, drive: list[str] | None, ignore: str | None) -> Roles:
    """Return what the options of a command say of columns, as `rig_from_logs` takes it."""
    drives = dict[str, str]()
    for text in drive or ():
        column, _, unit = text.partition("=")
        if not column:
            raise RigError(f"--drive is a column and its unit, such as m1=ticks; '{text}' came")
        drives[column] = unit
    return {"truth": _listed(truth), "drives": drives, "ignore": _listed(ignore)}


def _listed(text: str | None) -> list[str]:
    """Return the names in a text, separated by commas."""
    return [part.strip() for part in (text or "").split(",") if part.strip()]


def say_found(found: RigFromLogs) -> None:
    """Print what logs say of a rig: columns, structure, what they cannot tell, what was guessed."""
    from distal.rig import scales_in_words

    for column in found.columns:
        say(f"  {column.in_words}")
    for line in found.structure:
        say(line)
    for line in (*found.untellable, *found.notes):
        say(line)
    if found.rig.taken:
        say(scales_in_words(found.rig))
    say(f"no log tells these, so they are guesses with wide stds: {', '.join(found.guesses)}")


@app.command("from-logs")
def from_logs_command(
    logs: LogsArgument,
    out: OutOption = Path("rig.toml"),
    truth: JointsOption = None,
    drive: DrivesOption = None,
    ignore: IgnoreOption = None,
) -> None:
    """Write the rig file that logs show: which columns are what, which drive moves which joint,
    sizes.
    """
    from distal.from_logs import rig_from_logs
    from distal.logs import sources_of, write_whole

    check_new_rig(out, *logs)
    roles = roles_of(truth, drive, ignore)
    found = rig_from_logs(sources_of(logs), **roles, name=out.stem)
    say_found(found)
    write_whole(out, found.text)
    asked = shlex.join(["distal", "fit", *map(str, logs), "--rig", str(out), "--out"])
    say(f"wrote {out}; guesses are marked in it. Next: {asked} {out.stem}_fitted.toml")


def learn_command(
    logs: LogsArgument,
    out: Annotated[Path, Option(help="Where to write what was learned (.toml).")] = Path(
        "learned.toml"
    ),
    rig: Annotated[
        Path | None,
        Option(
            help="A rig file to begin with, in place of what the logs show; columns that it does "
            "not name are found by the names of drives and joints."
        ),
    ] = None,
    truth: JointsOption = None,
    drive: DrivesOption = None,
    ignore: IgnoreOption = None,
    reference_lag: LagOption = None,
    minutes: MinutesOption = None,
    report: Annotated[
        Path | None, Option(help="Folder for the answer as a page; default: beside --out.")
    ] = None,
) -> None:
    """Learn from logs how well the joints can be known from the motors: rig, fit and an answer."""
    from distal.fitting import fit
    from distal.from_logs import draft_columns, rig_from_logs
    from distal.logs import read_log, sources_of
    from distal.reports import FIT_PAGES
    from distal.rig import build_rig, edited_text, load_rig, parse_toml

    folder = report if report is not None else out.with_name(f"{out.stem}_page")
    outputs = [*to_file("--out", out, "a rig file"), *to_folder("--report", folder, FIT_PAGES)]
    check_command_outputs(outputs, logs=list(logs), rig=None if rig is None else str(rig))
    check_new(out)
    say(f"reading {len(logs)} log{'s' if len(logs) > 1 else ''}")
    sources = sources_of(logs)
    roles = roles_of(truth, drive, ignore)
    if rig is None:
        found = rig_from_logs(sources, **roles, name=out.stem)
        say_found(found)
        text = found.text
    else:
        columns = draft_columns(load_rig(rig), sources, **roles)
        for line in columns.in_words:
            say(f"  {line}")
        text = edited_text(rig, columns.assignments)
    raw = parse_toml(text, str(out), RigError)
    raw.pop("map", None)  # it is learned anew
    description = build_rig(raw, out.stem)
    read = [read_log(source, description) for source in sources]
    with stoppable(minutes), working("fitting") as show:
        result = fit(
            read,
            description,
            progress=lambda doing: show(f"{doing.stage}, about {doing.share:.0%} done"),
            lag=None if reference_lag is None else in_si(reference_lag, "s"),
            guessed=rig is None,
        )
    _answer(result, read)
    then = f"; next: distal estimate LOG --rig {out}, distal lab {out}, export-c"
    save_fit(result, read, text, out, folder, then, ": the same as a page with curves")
    if result.interrupted and minutes is None:
        raise typer.Exit(130)


def _answer(result: Fit, logs: Sequence[Log]) -> None:
    """Print how well the joints can be known, what limits that, and what to log next."""
    import numpy as np

    from distal.fitting import WRITTEN

    scores = [
        score
        for comparison in result.compared
        if (score := comparison.scores.get(WRITTEN)) is not None
    ]
    if scores:
        errors = np.sqrt(np.nanmean(np.square([score.joint_rms for score in scores]), axis=0))
        halves = np.nanmean([score.joint_halves for score in scores], axis=0)
        rows = [
            (joint, f"{degrees(error):.3f}", f"±{degrees(half):.3f}")
            for joint, error, half in zip(result.rig.joint_names, errors, halves)
        ]
        columns = ["joint", "RMS error [°]", "95 % band [°]"]
        table("how well the joints are known from the motors, on logs left out", columns, rows)
        say_scores(result)
        for line in _limits(result, float(np.mean(errors))):
            say(line)
    elif result.interrupted:
        say("interrupted before anything was judged: nothing is known of errors on unseen logs")
    else:
        say(
            "with two logs of known angles the answer has errors on logs that were not learned "
            f"from; {len(logs)} came"
        )
    for line in result.advice()[:MOST_LINES]:
        say(line)
    if scores:
        say(f"answer: {result.answer()}")
    undetermined = [part.name for part in result.fitted if not part.identified and not part.noise]
    if undetermined:
        say(
            f"log next: slow motions under other loads, and over the whole range; these logs do "
            f"not tell {', '.join(undetermined[:MOST_LINES])}"
        )


def _limits(result: Fit, error: float) -> list[str]:
    """Return sentences on what limits the angle."""
    lines = []
    if is_mostly_noise(result, error):
        lines.append(
            f"the reference's own noise ({degrees(result.reference_std):.2g}°) is much of this "
            "error: a better camera or encoder would show how good the estimate is"
        )
    read = {sensor.of for sensor in result.rig.sensors if sensor.measures == "force"}
    without = [name for name in result.rig.drive_names if name not in read]
    if without:
        lines.append(
            f"no force is read of {', '.join(without)}: stretch and friction are not seen, so "
            "that the band contains them; a current or a load cell would tell them"
        )
    return lines
