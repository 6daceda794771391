"""`distal rig from-logs`: a rig file from logs alone."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

from typer import Argument, Option

from distal.cli.console import say
from distal.cli.paths import check_command_outputs, check_ending, check_new, to_file
from distal.cli.rig_commands import app as app
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
    out: Annotated[Path, Option(help="Where to write the rig file (.toml).")] = Path("rig.toml"),
    truth: JointsOption = None,
    drive: DrivesOption = None,
    ignore: IgnoreOption = None,
) -> None:
    """Write the rig file that logs show: which columns are what, which drive moves which joint,
    sizes.
    """
    from distal.from_logs import rig_from_logs
    from distal.logs import sources_of, write_whole

    check_command_outputs(to_file("--out", out), logs=list(logs))
    check_ending(out, "a rig file")
    check_new(out)
    roles = roles_of(truth, drive, ignore)
    found = rig_from_logs(sources_of(logs), **roles, name=out.stem)
    say_found(found)
    write_whole(out, found.text)
    asked = shlex.join(["distal", "fit", *map(str, logs), "--rig", str(out), "--out"])
    say(f"wrote {out}; guesses are marked in it. Next: {asked} {out.stem}_fitted.toml")
