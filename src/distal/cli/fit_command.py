"""`distal fit`: a rig's parameters and noise from its own logs; and `distal calibrate`: the
parameters of a hand from the log of its power-on routine.
"""

from __future__ import annotations

from math import degrees, isnan, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from distal.cli.console import say, stoppable, table, warn, working
from distal.cli.shared_options import (
    LagOption,
    RigOption,
    SetOption,
    check_command_outputs,
    homing_time,
    in_si,
    to_file,
)
from distal.confidence import COVERED_TEXT

if TYPE_CHECKING:
    from distal.fitting import Fit
    from distal.rig import Rig


MinutesOption = Annotated[
    float | None,
    Option("--minutes", min=0.01, help="End after so long, with the best so far [min]."),
]

MOST_ROWS = 14
"""Number of fitted parameters printed at most; the fitted rig has all. Source: layout."""

MOST_LINES = 4
"""Number of undetermined parameters named, and of lines of advice printed, at most. Source: layout.
"""


def fit_command(
    logs: Annotated[
        list[Path],
        Argument(
            help="Logs (CSV, Parquet, HDF5, MCAP, ROS bags, LeRobot datasets); some with the "
            "joint's angle, or all, or none."
        ),
    ],
    rig: RigOption,
    *,
    out: Annotated[Path | None, Option(help="Where to write the fitted rig (TOML).")] = None,
    free: Annotated[
        list[str] | None,
        Option(
            metavar="PATH",
            help="Number to fit, e.g. tendons.left.stiffness; default: all with a std. Repeatable.",
        ),
    ] = None,
    per_log: Annotated[
        list[str] | None,
        Option(
            metavar="PATH", help="Number with one value for each log, e.g. tendons.*.pretension."
        ),
    ] = None,
    homing: Annotated[
        str | None,
        Option(
            help="Fit for this use: the reference is known for so long (e.g. 3s), then not read."
        ),
    ] = None,
    truth: Annotated[str | None, Option(help="True joint angle: a column of the logs.")] = None,
    noise: Annotated[bool, Option(help="Fit the noise too.")] = True,
    units: Annotated[
        str | None,
        Option(
            metavar="PATTERN",
            help="Logs of several instruments of one kind: what tells them apart in a log's name, "
            "e.g. 'tool_(.)'.",
        ),
    ] = None,
    reference_lag: LagOption = None,
    open_loop: Annotated[
        bool,
        Option("--open-loop", help="Fit for a simulator, in which no sensor corrects the angle."),
    ] = False,
    minutes: MinutesOption = None,
    set_: SetOption,
) -> None:
    """Fit a rig's parameters and noise to logs, say which ones the logs determine, and write a rig
    file for later logs.
    """
    from distal.fitting import fit as fitted_to
    from distal.fitting import groups_of
    from distal.logs import read_log
    from distal.rig import edited_text, load_rig

    check_command_outputs(to_file("--out", out, "a rig file"), logs=logs, rig=rig, truth=truth)
    if units is not None:
        groups_of([str(path) for path in logs], units)
    home = homing_time(homing)
    description = load_rig(rig, set_)
    read = [read_log(path, description, truth) for path in logs]
    text = edited_text(rig, set_)
    with stoppable(minutes), working("fitting") as show:
        result = fitted_to(
            read,
            description,
            free or (),
            per_log or (),
            homing=home,
            noise=noise,
            units=units,
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

    check_command_outputs(to_file("--out", out, "a rig file"), logs=[log], rig=rig)
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
