"""`distal calibrate`: the parameters of a hand from the log of its power-on routine."""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from distal.cli.console import say, table, warn, working
from distal.cli.paths import check_command_outputs, check_ending, to_file
from distal.cli.shared_options import RigOption, SetOption

if TYPE_CHECKING:
    from distal.rig import Rig


def calibrate_command(
    log: Annotated[
        Path,
        Argument(
            help="Log of the routine: each motor to both ends of its travel, three times or more."
        ),
    ],
    rig: RigOption,
    out: Annotated[Path, Option(help="Where to write the calibrated rig file.")],
    *,
    since: Annotated[
        Path | None, Option(help="An earlier calibration: say what moved since.")
    ] = None,
    set_: SetOption = None,
) -> None:
    """Calibrate a hand by its power-on routine: zeros, play or tension, stiffness, friction, and
    what is broken.
    """
    from distal.hands import calibrate, moved_since
    from distal.rig import edited_text, load_rig

    check_command_outputs(
        to_file("--out", out), logs=[log, *([] if since is None else [since])], rig=rig
    )
    check_ending(out, "a rig file")
    description = load_rig(rig, set_ or ())
    with working("calibrating"):
        found = calibrate(log, description)
    _show(found.rig, {fault.drive for fault in found.faults if fault.kind != "slack"})
    for fault in found.faults:
        warn(fault.sentence)
    for note in found.notes:
        warn(note)
    if since is not None:
        lines = moved_since(load_rig(since), found.rig)
        say(f"since {since}: " + ("; ".join(lines) if lines else "nothing moved clearly"))
    found.save(out, log.name, edited_text(rig, set_ or ()))
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
        tendons = [tendon for tendon in rig.tendons if tendon.drive == drive.name]
        arm = abs(next(iter(tendons[0].arms().values())))
        if len(tendons) == 2 and not tendons[0].slack.absent:
            state = f"{degrees(sum(tendon.slack.value for tendon in tendons) / arm):.1f}° of play"
        elif len(tendons) == 2:
            state = f"{sum(tendon.pretension.value for tendon in tendons) / 2:.2g} N"
        else:
            state = "one tendon"
        position = next(sensor for sensor in rig.sensors_of("position") if sensor.of == drive.name)
        zero = (
            f"{degrees(position.sign * position.bias.value):.1f} ± {degrees(position.bias.std):.1f}"
        )
        stiffness = f"{1e-3 * tendons[0].stiffness.value:.3g}"
        rub = f"{1e3 * drive.friction.constant.value:.0f}"
        rows.append((drive.name, ", ".join(tendons[0].joints), zero, state, stiffness, rub))
    table(
        "power-on routine",
        ["motor", "joints", "zero, °", "tendons", "stiffness, N/mm", "friction, mN m"],
        rows,
        text=2,
    )
