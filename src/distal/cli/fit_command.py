"""Commands that learn a rig from logs: `distal fit` (parameters and noise of a rig file), `distal
learn` and `distal rig from-logs` (a rig from logs alone), `distal calibrate` (a hand from the
log of its power-on routine).
"""

from __future__ import annotations

import shlex
from math import degrees, isnan, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer
from typer import Argument, Option

from distal.cli.rig_commands import OutOption, app, check_new_rig
from distal.cli.shared_options import (
    LagOption,
    RigOption,
    SetOption,
    check_command_outputs,
    check_new,
    homing_time,
    in_si,
    say,
    stoppable,
    table,
    warn,
    working,
)
from distal.confidence import COVERED_TEXT
from distal.errors import DistalError, RigError

if TYPE_CHECKING:
    from distal.fitting import Fit
    from distal.from_logs import RigFromLogs
    from distal.rig import Rig


MinutesOption = Annotated[
    float | None,
    Option(min=0.01, help="End after so long, with the best so far [min]."),
]

MOST_ROWS = 14
"""Number of fitted parameters printed at most; the fitted rig has all. Source: layout."""

MOST_LINES = 4
"""Number of undetermined parameters named, and of lines of advice printed, at most. Source: layout.
"""


LogsArgument = Annotated[
    list[Path],
    Argument(
        help="Logs (CSV, Parquet, HDF5, MCAP, ROS bags, LeRobot datasets) with the same columns, "
        "some with the joints' angles."
    ),
]
FittedOutOption = Annotated[Path | None, Option(help="Where to write the fitted rig (TOML).")]
FreeOption = Annotated[
    list[str] | None,
    Option(
        metavar="PATH",
        help="Number to fit, e.g. tendons.left.stiffness; default: all with a std. Repeatable.",
    ),
]
PerLogOption = Annotated[
    list[str] | None,
    Option(metavar="PATH", help="Number with one value for each log, e.g. tendons.*.pretension."),
]
FittedHomingOption = Annotated[
    str | None,
    Option(help="Fit for this use: the reference is known for so long (e.g. 3s), then not read."),
]
TruthColumnOption = Annotated[str | None, Option(help="True joint angle: a column of the logs.")]
NoiseOption = Annotated[bool, Option(help="Fit the noise too.")]
GroupsOption = Annotated[
    str | None,
    Option(
        metavar="PATTERN",
        help="Logs of several instruments of one kind: what tells them apart in a log's name, "
        "e.g. 'tool_(.)'.",
    ),
]
OpenLoopOption = Annotated[
    bool,
    Option("--open-loop", help="Fit for a simulator, in which no sensor corrects the angle."),
]


def fit_command(
    logs: LogsArgument,
    rig: RigOption,
    *,
    out: FittedOutOption = None,
    free: FreeOption = None,
    per_log: PerLogOption = None,
    homing: FittedHomingOption = None,
    truth: TruthColumnOption = None,
    noise: NoiseOption = True,
    groups: GroupsOption = None,
    reference_lag: LagOption = None,
    open_loop: OpenLoopOption = False,
    minutes: MinutesOption = None,
    set_: SetOption,
) -> None:
    """Fit a rig's parameters and noise to logs, say which ones the logs determine, and write a rig
    file for later logs.
    """
    from distal.fitting import fit, groups_of
    from distal.logs import read_log
    from distal.rig import edited_text, load_rig

    check_command_outputs([out], "a rig file", logs=logs, rig=rig, truth=truth)
    if groups is not None:
        groups_of([str(path) for path in logs], groups)
    home = homing_time(homing)
    description = load_rig(rig, set_)
    read = [read_log(path, description, truth) for path in logs]
    text = edited_text(rig, set_)
    with stoppable(minutes), working("fitting") as show:
        result = fit(
            read,
            description,
            free or (),
            per_log or (),
            homing=home,
            noise=noise,
            groups=groups,
            progress=show,
            lag=None if reference_lag is None else in_si(reference_lag, "s"),
            open_loop=open_loop,
        )
    say_fit(result)
    if out is not None:
        result.save(out, text)
        say(f"wrote {out}")
    if result.interrupted and minutes is None:
        raise typer.Exit(130)


def say_fit(result: Fit) -> None:
    """Print the result of a fit on one screen: parameters, first those of which the logs tell most,
    scores on held-out logs, how well the joints are known, advice.
    """
    fitted = [number for number in result.fitted if result.kept and not number.noise]
    fitted.sort(key=lambda number: -number.variance_reduction)
    rows = [
        (number.name, *number.sizes, f"{100 * number.variance_reduction:.0f} %")
        for number in fitted[:MOST_ROWS]
    ]
    if rows:
        headers = ["parameter", "before", "fitted", "unit", "known from the logs"]
        table(f"fitted to {result.learned_from}", headers, rows)
    if len(fitted) > MOST_ROWS:
        say(f"and {len(fitted) - MOST_ROWS} more in the fitted rig, of which the logs tell less")
    say_scores(result)
    needed = "two logs of known angles would show errors on logs that were not learned from"
    say(f"answer: {result.answer() or needed}")
    for line in result.advice()[:MOST_LINES]:
        say(line)
    if result.interrupted:
        say("interrupted: these are the best values so far")


HOPELESS = 10.0
"""Ratio of an error to that of what is written, above which its row is left out. Source: layout."""


def say_scores(result: Fit) -> None:
    """Print a table that compares what is written with all other candidates."""
    from distal.fitting import SETTLING

    scores = result.scores()
    if not scores:
        return
    noise = result.reference_std
    # much of an error that its reference makes more than half of, squared
    shown = 2.0 * noise**2 > scores[0][1] ** 2
    rows = []
    for name, rms, inside in scores:
        if rms > HOPELESS * scores[0][1]:
            continue
        less = [f"{degrees(sqrt(max(rms**2 - noise**2, 0.0))):.3f}"] * shown
        share = "–" if isnan(inside) else f"{100 * inside:.0f} %"
        rows.append([name, f"{degrees(rms):.3f}", *less, share])
    less = ["less the encoder's noise [°]"] * shown
    columns = ["what gives the angle", "RMS error [°]", *less, f"inside the {COVERED_TEXT} band"]
    after = "its homing move" if result.homing is not None else f"its first {SETTLING:g} s"
    table(f"on each log after {after}, by what the others tell", columns, rows)


def calibrate_command(
    log: Annotated[
        Path,
        Argument(
            help="Log of the routine: each motor to both ends of its travel, three times or more."
        ),
    ],
    rig: RigOption,
    out: Annotated[Path, Option(help="Where to write the calibrated rig file.")],
    set_: SetOption,
    accept: Annotated[
        bool, Option("--accept", help="Correct what is likely wrong in the rig.")
    ] = False,
) -> None:
    """Calibrate a hand by its power-on routine: zeros, play or tension, stiffness, friction, and
    what is broken, or wrong in its rig.
    """
    from distal.hands import calibrate
    from distal.rig import edited_text, load_rig

    check_command_outputs([out], "a rig file", logs=[log], rig=rig)
    with working("calibrating"):
        found = calibrate(log, load_rig(rig, set_), accept=accept)
    _show(found.rig, {fault.drive for fault in found.faults if fault.kind not in ("slack", "zero")})
    for line in (*(fault.sentence for fault in found.faults), *found.notes):
        warn(line)
    found.save(out, log.name, edited_text(rig, set_))
    say(f"wrote {out}")


def _show(rig: Rig, faulty: set[str]) -> None:
    """Print what the routine found at each motor; a motor with a fault has no results, since its
    parameters stay as they were.
    """
    rows = []
    for drive in rig.drives:
        if drive.kind != "capstan":
            continue
        if drive.name in faulty:
            rows.append((drive.name, "not calibrated", *"––––"))
            continue
        tendons = rig.tendons_of(drive.name)
        arm = abs(next(iter(tendons[0].arms().values())))
        stiffness = tendons[0].stiffness.value
        state = "one tendon"
        if len(tendons) == 2:
            slack = sum(tendon.loose for tendon in tendons)
            tense = f"{-stiffness * slack / 2:.2g} N"
            state = f"{degrees(slack / arm):.1f}° of play" if slack > 0 else tense
        position = next(sensor for sensor in rig.sensors_of("position") if sensor.of == drive.name)
        zero = (
            f"{degrees(position.sign * position.bias.value):.1f} ± {degrees(position.bias.std):.1f}"
        )
        rub = f"{1e3 * drive.friction.constant.value:.0f}"
        rows.append(
            (drive.name, ", ".join(tendons[0].joints), zero, state, f"{1e-3 * stiffness:.3g}", rub)
        )
    table(
        "power-on routine",
        ["motor", "joints", "zero, °", "tendons", "stiffness, N/mm", "friction, mN m"],
        rows,
        text=2,
    )


JointsOption = Annotated[
    str | None,
    Option(help="Columns that are joints' angles, separated by commas."),
]
DrivesOption = Annotated[
    list[str] | None,
    Option(
        help="A column that is a drive's position, with its unit: m1=ticks. Repeatable.",
    ),
]
RateOption = Annotated[
    str | None,
    Option(help="Of evenly spaced rows, where no column is their time, e.g. 50 Hz."),
]
IgnoreOption = Annotated[
    str | None, Option(help="Columns that are none of this, separated by commas.")
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


LearnedOutOption = Annotated[Path, Option(help="Where to write what was learned (.toml).")]
BeginningRigOption = Annotated[
    Path | None,
    Option(
        help="A rig file to begin with, in place of what the logs show; columns that it does "
        "not name are found by the names of drives and joints."
    ),
]


def learn_command(
    logs: LogsArgument,
    out: LearnedOutOption = Path("learned.toml"),
    rig: BeginningRigOption = None,
    truth: JointsOption = None,
    drive: DrivesOption = None,
    ignore: IgnoreOption = None,
    rate: RateOption = None,
    reference_lag: LagOption = None,
    minutes: MinutesOption = None,
) -> None:
    """Learn from logs how well the joints can be known from the motors: rig, fit and an answer."""
    from distal.from_logs import draft_columns, rig_from_logs
    from distal.logs import read_log, sources_of, write_whole
    from distal.rig import build_rig, edited_text, load_rig, parse_toml

    check_command_outputs([out], "a rig file", logs=logs, rig=None if rig is None else str(rig))
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
    write_whole(out, text)
    say(f"wrote {out} as far as it is known before the fit, which makes it better")
    from distal.fitting import fit  # it takes a second to load

    try:
        with stoppable(minutes), working("fitting") as show:
            result = fit(
                read,
                description,
                progress=show,
                lag=None if reference_lag is None else in_si(reference_lag, "s"),
                drafted=rig is None,
            )
    except DistalError:
        out.unlink(missing_ok=True)  # what cannot be fitted is not to be used
        raise
    say_fit(result)
    result.save(out, text)
    say(f"wrote {out}; next: distal estimate LOG --rig {out}, distal export-c {out}")
    if result.interrupted and minutes is None:
        raise typer.Exit(130)
