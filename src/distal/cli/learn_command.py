"""`distal rig from-logs` and `distal learn`: from logs alone to a rig file, and to angles."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer
from typer import Argument, Option

from distal.cli.console import say, stoppable, working
from distal.cli.fit_command import (
    MinutesOption,
    say_fit,
)
from distal.cli.rig_commands import OutOption, app, check_new_rig
from distal.cli.shared_options import (
    LagOption,
    check_command_outputs,
    check_new,
    in_si,
    to_file,
)
from distal.errors import RigError

if TYPE_CHECKING:
    from distal.from_logs import RigFromLogs

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
RateOption = Annotated[
    str | None,
    Option("--rate", help="Of evenly spaced rows, where no column is their time, e.g. 50 Hz."),
]
IgnoreOption = Annotated[
    str | None, Option("--ignore", help="Columns that are none of this, separated by commas.")
]


class Roles(TypedDict):
    """What is said of columns, as the arguments of `rig_from_logs`."""

    truth: list[str]
    drives: dict[str, str]
    ignore: list[str]
    rate: float | None


def roles_of(
    truth: str | None, drive: list[str] | None, ignore: str | None, rate: str | None
) -> Roles:
    """Return what the options of a command say of columns, as `rig_from_logs` takes it."""
    drives = dict[str, str]()
    for text in drive or ():
        column, _, unit = text.partition("=")
        if not column:
            raise RigError(f"--drive is a column and its unit, such as m1=ticks; '{text}' came")
        drives[column] = unit
    return {
        "truth": _listed(truth),
        "drives": drives,
        "ignore": _listed(ignore),
        "rate": None if rate is None else in_si(rate, "Hz"),
    }


def _listed(text: str | None) -> list[str]:
    """Return the names in a text, separated by commas."""
    return [part.strip() for part in (text or "").split(",") if part.strip()]


def say_found(found: RigFromLogs) -> None:
    """Print what logs say of a rig: columns, structure, what they cannot tell, what was guessed."""
    for column in found.columns:
        say(f"  {column.in_words}")
    for line in (*found.structure, *found.untellable, *found.notes):
        say(line)
    if found.rig.taken:
        which = " and ".join(found.rig.taken)
        say(f"the scale of {which} is assumed: angles do not depend on it (distal rig check)")
    say(f"no log tells these, so they are guesses with wide stds: {', '.join(found.guesses)}")


@app.command("from-logs")
def from_logs_command(
    logs: LogsArgument,
    out: OutOption = Path("rig.toml"),
    truth: JointsOption = None,
    drive: DrivesOption = None,
    ignore: IgnoreOption = None,
    rate: RateOption = None,
) -> None:
    """Write the rig file that logs show: which columns are what, which drive moves which joint,
    sizes.
    """
    from distal.from_logs import rig_from_logs
    from distal.logs import sources_of, write_whole

    check_new_rig(out, *logs)
    roles = roles_of(truth, drive, ignore, rate)
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
    rate: RateOption = None,
    reference_lag: LagOption = None,
    minutes: MinutesOption = None,
) -> None:
    """Learn from logs how well the joints can be known from the motors: rig, fit and an answer."""
    from distal.fitting import fit
    from distal.from_logs import draft_columns, rig_from_logs
    from distal.logs import read_log, sources_of
    from distal.rig import build_rig, edited_text, load_rig, parse_toml

    outputs = to_file("--out", out, "a rig file")
    check_command_outputs(outputs, logs=logs, rig=None if rig is None else str(rig))
    check_new(out)
    say(f"reading {len(logs)} log{'s' if len(logs) > 1 else ''}")
    sources = sources_of(logs)
    roles = roles_of(truth, drive, ignore, rate)
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
            progress=show,
            lag=None if reference_lag is None else in_si(reference_lag, "s"),
            drafted=rig is None,
        )
    say_fit(result)
    result.save(out, text)
    say(f"wrote {out}; next: distal estimate LOG --rig {out}, distal export-c {out}")
    if result.interrupted and minutes is None:
        raise typer.Exit(130)
