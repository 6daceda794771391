"""`distal control`: a controller in the loop, fed back by an encoder, by an estimate and by displacements alone."""

from __future__ import annotations

from math import degrees, isinf, isnan
from pathlib import Path
from typing import Annotated

import typer

from distal.cli.console import say, table, warn
from distal.cli.options import ScenarioArgument, SeedOption, SetOption
from distal.cli.outputs import check_outputs, to_folder


def control_command(
    scenario: ScenarioArgument,
    out: Annotated[Path, typer.Option("--out", help="Folder for the figure and the logs.")],
    seed: SeedOption = 0,
    *,
    feedback: Annotated[
        list[str] | None,
        typer.Option("--feedback", help="encoder, ratio or an estimator; repeat it. Default: all three ways."),
    ] = None,
    set_: SetOption = None,
) -> None:
    """Control a rig in a scenario with a control table, and compare what each feedback costs."""
    from distal.control import closed_loop, plot_control, track
    from distal.errors import ControlError
    from distal.logs import write_log
    from distal.simulation import load_scenario, scenario_rig

    description = load_scenario(scenario)
    if description.control is None:
        raise ControlError(f"{scenario}: has no [control]; see distal scenario show control-paper")
    rig = scenario_rig(description, set_ or ())
    own = description.control.feedback
    told = list(dict.fromkeys(feedback or ["encoder", own if own not in ("encoder", "ratio") else "adaptive", "ratio"]))
    picture, logs = out / "control.png", [out / f"{name}.csv" for name in told]
    check_outputs(
        to_folder("--out", out, [path.name for path in (picture, *logs)]), rig=description.rig, scenario=scenario
    )
    runs = [closed_loop(rig, description, seed, feedback=name) for name in told]
    out.mkdir(parents=True, exist_ok=True)
    for run, path in zip(runs, logs):
        write_log(run.log, rig, path)
    plot_control(runs, picture)
    rows = []
    for run in runs:
        for one in track(run):
            settled = "–" if isnan(one.settling) else "never" if isinf(one.settling) else f"{one.settling:.2f}"
            hunts = f"{degrees(max(each.motion for each in one.hunting)):.1f}°" if one.hunting else "no"
            numbers = ["–" if isnan(value) else f"{degrees(value):.2f}" for value in (one.rms, one.overshoot)]
            rows.append(
                (
                    run.feedback,
                    one.joint,
                    *numbers,
                    settled,
                    hunts,
                    f"{one.effort:.3g}",
                    f"{degrees(one.estimate_rms):.2f}",
                )
            )
        for held in run.held:
            warn(f"{run.feedback}: commands held from {held.begin:g} to {held.end:g} s: {held.why}")
    unit = {"slider": "N", "capstan": "N m"}[rig.drives[0].kind]
    columns = ["feedback", "joint", "RMS [°]", "overshoot [°]", "settled [s]", "limit cycle", f"effort [{unit}]"]
    table(
        f"{description.name or scenario}: true angle against reference", [*columns, "told wrong by [°]"], rows, text=2
    )
    say(f"wrote {picture} and {', '.join(path.name for path in logs)}")
