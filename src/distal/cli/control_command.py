"""`distal control`: a controller in the loop, with an encoder, an estimate and displacements alone
as feedback.
"""

from __future__ import annotations

from math import degrees, isinf, isnan
from pathlib import Path
from typing import Annotated

from typer import Option

from distal.cli.console import say, table, warn, working
from distal.cli.paths import check_command_outputs, to_folder
from distal.cli.shared_options import ScenarioArgument, SeedOption, SetOption


def control_command(
    scenario: ScenarioArgument,
    out: Annotated[Path, Option(help="Folder for the figure and the logs.")],
    seed: SeedOption = 0,
    *,
    feedback: Annotated[
        list[str] | None,
        Option(help="encoder, ratio or an estimator; repeat it. Default: all three ways."),
    ] = None,
    set_: SetOption = None,
) -> None:
    """Control a rig in a scenario with a control table, and compare what each feedback costs."""
    from distal.control import closed_loop, plot_control, trackings_of
    from distal.errors import ControlError
    from distal.logs import write_log
    from distal.simulation import load_scenario, scenario_rig

    description = load_scenario(scenario)
    if description.control is None:
        raise ControlError(f"{scenario}: has no [control]; see distal scenario show control-paper")
    rig = scenario_rig(description, set_ or ())
    usual = description.control.feedback
    estimator = usual if usual not in ("encoder", "ratio") else "adaptive"
    names = list(dict.fromkeys(feedback or ["encoder", estimator, "ratio"]))
    picture = out / "control.png"
    logs = [out / f"{name}.csv" for name in names]
    outputs = to_folder("--out", out, [path.name for path in (picture, *logs)])
    check_command_outputs(outputs, rig=description.rig, scenario=scenario)
    runs = []
    with working("controlling") as show:
        for name in names:
            show(f"controlling, fed back by {name}")
            runs.append(closed_loop(rig, description, seed, feedback=name))
    out.mkdir(parents=True, exist_ok=True)
    for run, path in zip(runs, logs):
        write_log(run.log, rig, path)
    plot_control(runs, picture)
    rows = []
    for run in runs:
        for score in trackings_of(run):
            settled = (
                "–"
                if isnan(score.settling)
                else "never"
                if isinf(score.settling)
                else f"{score.settling:.2f}"
            )
            hunts = f"{degrees(max(score.hunting)):.1f}°" if score.hunting else "no"
            angles = [
                "–" if isnan(angle) else f"{degrees(angle):.2f}"
                for angle in (score.rms, score.overshoot)
            ]
            wrong_by = f"{degrees(score.estimate_rms):.2f}"
            rows.append(
                (
                    run.feedback,
                    score.joint,
                    *angles,
                    settled,
                    hunts,
                    f"{score.effort:.3g}",
                    wrong_by,
                )
            )
        for span in run.held:
            warn(f"{run.feedback}: {span}")
    unit = {"slider": "N", "capstan": "N m"}[rig.drives[0].kind]
    columns = [
        "feedback",
        "joint",
        "RMS [°]",
        "overshoot [°]",
        "settled [s]",
        "limit cycle",
        f"effort [{unit}]",
    ]
    columns.append("told wrong by [°]")
    table(f"{description.name or scenario}: true angle against reference", columns, rows, text=2)
    say(f"wrote {picture} and {', '.join(path.name for path in logs)}")
