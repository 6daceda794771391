"""`distal control`: a controller in the loop, with several feedbacks; and `distal command`: from
desired joint angles to the setpoints of the drives.
"""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from distal.cli.console import say, table, warn, working
from distal.cli.shared_options import (
    RigOption,
    ScenarioArgument,
    SeedOption,
    SetOption,
    check_command_outputs,
    in_si,
    to_file,
    to_folder,
)
from distal.units import rounded


def control_command(
    scenario: ScenarioArgument,
    out: Annotated[Path, Option(help="Folder for the figure and the logs.")],
    seed: SeedOption = 0,
    *,
    feedback: Annotated[
        list[str] | None,
        Option(help="encoder, ratio or an estimator; repeat it. Default: all three ways."),
    ] = None,
    set_: SetOption,
) -> None:
    """Control a rig in a scenario with a control table, and compare what each feedback costs."""
    from distal.control import closed_loop, plot_control, trackings_of
    from distal.errors import ControlError
    from distal.logs import write_log
    from distal.rig import effort_unit
    from distal.simulation import load_scenario, scenario_rig

    description = load_scenario(scenario)
    if description.control is None:
        raise ControlError(f"{scenario}: has no [control]; see distal scenario show control-paper")
    rig = scenario_rig(description, set_)
    usual = description.control.feedback
    estimator = "adaptive" if usual in ("encoder", "ratio") else usual
    names = dict.fromkeys(feedback or ["encoder", estimator, "ratio"])
    picture = out / "control.png"
    logs = [f"{name}.csv" for name in names]
    outputs = to_folder("--out", out, [picture.name, *logs])
    check_command_outputs(outputs, rig=description.rig, scenario=scenario)
    runs = []
    with working("controlling") as show:
        for name in names:
            show(f"controlling, fed back by {name}")
            runs.append(closed_loop(rig, description, seed, feedback=name))
    out.mkdir(parents=True, exist_ok=True)
    for run, name in zip(runs, logs):
        write_log(run.log, rig, out / name)
    plot_control(runs, picture)
    rows = [
        (
            run.feedback,
            score.joint,
            f"{degrees(score.rms):.2f}",
            f"{score.effort:.3g}",
            f"{degrees(score.estimate_rms):.2f}",
        )
        for run in runs
        for score in trackings_of(run)
    ]
    effort = f"effort [{effort_unit(rig.drives[0])}]"
    columns = ["feedback", "joint", "RMS [°]", effort, "told wrong by [°]"]
    table(f"{description.name or scenario}: true angle against reference", columns, rows, text=2)
    say(f"wrote {picture} and {', '.join(logs)}")


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
    set_: SetOption,
) -> None:
    """Write what the drives have to do for desired angles, and the angles that they then reach with
    their band.
    """
    import numpy as np

    from distal.confidence import BAND, COVERED_TEXT
    from distal.inverse import Inverse
    from distal.logs import read_angles, unit_of_angles
    from distal.rig import angle_names, load_rig

    check_command_outputs(to_file("--out", out, "a table"), logs=[desired], rig=rig)
    inverse = Inverse(load_rig(rig, set_), least_tension=in_si(least_tension, "N"))
    joints = inverse.rig.joint_names
    named = dict(zip(joints, angle_names(joints)))
    columns = [named[joint] for joint in inverse.joints]
    time, angles = read_angles(desired, columns)
    with working("finding the commands"):
        commands = inverse(time, np.column_stack([angles[name] for name in columns]))
    # in the unit of the desired angles
    commands.write(out, unit_of_angles(desired, columns))
    errors = commands.angles - commands.desired
    for joint, *squares in zip(joints, errors.T**2, commands.stds.T**2):
        away, std = (degrees(np.sqrt(np.mean(square))) for square in squares)
        band = BAND * std
        # what does not show in the printed band is nothing
        off = f" but for {rounded(away, 3)}° RMS" if rounded(band + away) != rounded(band) else ""
        around = f"{COVERED_TEXT} band ± {rounded(band)}°"
        say(f"{joint}: reaches what is wanted{off}, {around} in an open loop")
    for note in commands.notes:
        warn(note)
    say(f"wrote {out}")
