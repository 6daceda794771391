"""`distal command`: from desired joint angles to the setpoints of the drives."""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from distal.cli.console import say, warn, working
from distal.cli.paths import check_command_outputs, check_ending, to_file
from distal.cli.shared_options import RigOption, SetOption, newtons
from distal.rounded import rounded


def command_command(
    desired: Annotated[
        Path,
        Argument(help="Wanted angles: a file with t and theta (theta_JOINT)."),
    ],
    rig: RigOption,
    out: Annotated[
        Path,
        Option(
            help="Where to write the commands (CSV or Parquet), by the rig's own columns and units."
        ),
    ],
    *,
    least_tension: Annotated[
        str,
        Option(
            "--least-tension",
            help="Tension that every tendon keeps where the drives can choose it.",
        ),
    ] = "1 N",
    plot: Annotated[
        Path | None, Option("--plot", help="Draw a picture (PNG, SVG or PDF) of angles and drives.")
    ] = None,
    set_: SetOption = None,
) -> None:
    """Write what the drives have to do for desired angles, and the angles that they then reach with
    their band.
    """
    import numpy as np

    from distal.confidence import BAND
    from distal.inverse import Inverse
    from distal.logs import read_angles, unit_of_angles
    from distal.results import plot_kind
    from distal.rig import angle_names, load_rig

    if plot is not None:
        plot_kind(plot)
    check_command_outputs(
        [*to_file("--out", out), *to_file("--plot", plot)], logs=[desired], rig=rig
    )
    check_ending(out, "a table")
    inverse = Inverse(load_rig(rig, set_ or ()), least_tension=newtons(least_tension))
    joints = inverse.rig.joint_names
    columns = {
        joint: name for joint, name in zip(joints, angle_names(joints)) if joint in inverse.joints
    }
    time, angles = read_angles(desired, list(columns.values()))
    with working("finding the commands"):
        commands = inverse(time, {joint: angles[name] for joint, name in columns.items()})
    # in the unit of the desired angles
    commands.write(out, unit_of_angles(desired, list(columns.values())))
    for j, joint in enumerate(joints):
        away = degrees(
            float(np.sqrt(np.mean((commands.angles[:, j] - commands.desired[:, j]) ** 2)))
        )
        band = BAND * degrees(float(np.sqrt(np.mean(commands.stds[:, j] ** 2))))
        # what does not show in the printed band is nothing
        off = f" but for {rounded(away, 3)}° RMS" if rounded(band + away) != rounded(band) else ""
        say(f"{joint}: reaches what is wanted{off}, 95 % band ± {rounded(band)}° in an open loop")
    for note in commands.notes:
        warn(note)
    if plot is not None:
        commands.plot(plot)
    say(f"wrote {out}" + (f" and {plot}" if plot is not None else ""))
