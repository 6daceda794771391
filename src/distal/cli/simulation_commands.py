"""Commands that simulate: `distal simulate`, `distal scenarios`, `distal scenario show`, `distal
reproduce`, `distal study`, `distal studies`, `distal control` (a controller in the loop); and
`distal command`, from desired angles to the setpoints of the drives.
"""

from __future__ import annotations

import shlex
from dataclasses import replace
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from distal.cli.shared_options import (
    RigOption,
    ScenarioArgument,
    SeedOption,
    SetOption,
    check_command_outputs,
    check_ending,
    check_folder,
    in_si,
    progress_bar,
    rigs,
    say,
    stoppable,
    studies,
    table,
    warn,
    working,
)
from distal.units import rounded

if TYPE_CHECKING:
    from distal.logs import Log
    from distal.rig import Rig


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
    logs = [out / f"{name}.csv" for name in names]
    check_command_outputs(
        [picture, *logs], rig=description.rig, scenario=scenario, makes_folder=True
    )
    runs = []
    with working("controlling") as show:
        for name in names:
            show(f"controlling, fed back by {name}")
            runs.append(closed_loop(rig, description, seed, feedback=name))
    out.mkdir(parents=True, exist_ok=True)
    for run, path in zip(runs, logs):
        write_log(run.log, rig, path)
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
    say(f"wrote {', '.join(map(str, [picture, *logs]))}")


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
    from distal.logs import read_angles
    from distal.rig import angle_names, load_rig

    check_command_outputs([out], "a table", logs=[desired], rig=rig)
    inverse = Inverse(load_rig(rig, set_), least_tension=in_si(least_tension, "N"))
    joints = inverse.rig.joint_names
    named = dict(zip(joints, angle_names(joints)))
    columns = [named[joint] for joint in inverse.joints]
    time, angles, unit = read_angles(desired, columns)
    with working("finding the commands"):
        commands = inverse(time, np.column_stack([angles[name] for name in columns]))
    commands.write(out, unit)
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


app = typer.Typer(help="Look at scenarios.", no_args_is_help=True)


SimulatedOutOption = Annotated[
    Path, Option(help="Where to write the log (CSV or Parquet); with --runs, a folder.")
]
RunsOption = Annotated[
    int | None,
    Option(min=1, max=100_000, help="Simulate with so many seeds, from --seed on, each to a file."),
]
OtherRigOption = Annotated[
    str | None,
    Option(
        "--rig",
        help="A rig instead of the scenario's; its drives have the same names.",
        autocompletion=rigs,
    ),
]
WithTruthOption = Annotated[
    bool, Option(help="Also write true values that no sensor reads, as true_… in SI.")
]


def simulate_command(
    scenario: ScenarioArgument,
    out: SimulatedOutOption,
    seed: SeedOption = 0,
    *,
    runs: RunsOption = None,
    rig_: OtherRigOption = None,
    truth: WithTruthOption = True,
    set_: SetOption,
) -> None:
    """Simulate a scenario and write what the sensors read, with the truth beside it."""
    from distal.control import simulate
    from distal.errors import ScenarioError
    from distal.logs import write_log, write_whole
    from distal.results import make_folder
    from distal.rig import named, parse_assignment
    from distal.simulation import load_scenario, rig_beside, scenario_rig, text_beside

    description = load_scenario(scenario)
    if rig_ is not None:
        description = description.model_copy(update={"rig": rig_})
    rig = scenario_rig(description, set_)
    values = description.set | dict(parse_assignment(text, ScenarioError) for text in set_)
    names = {seed: out}
    if runs is not None:
        check_folder(out, "with --runs")
        digits = len(str(seed + runs - 1))
        names = {n: out / f"run_{n:0{digits}d}.csv" for n in range(seed, seed + runs)}
    # no file can lie beside a pipe or a device
    is_regular = not out.exists() or out.is_file() or out.is_dir()
    beside = rig_beside(out, runs is not None)
    check_command_outputs(
        [*names.values(), beside if is_regular else None],
        rig=description.rig,
        scenario=scenario,
        makes_folder=runs is not None,
    )
    if runs is None:
        check_ending(out, "a table")
    else:
        make_folder(out)
    with progress_bar("simulating", len(names)) as advance:
        for done, (number, path) in enumerate(names.items(), 1):
            log = simulate(rig, description, number)
            write_log(log if truth else replace(log, truth={}), rig, path)
            advance(done)
    if is_regular:
        write_whole(beside, text_beside(description.rig, values))
    span = f"{description.duration:g} s"
    what = f"{len(log)} samples, {span}"
    written = shlex.quote(str(out))
    if runs is not None:
        what = f"{runs} runs of {span}, seeds {seed} to {seed + runs - 1}"
        written += "/*.csv"
    say(f"{rig.name}: {what}, {_ranges(log, rig)}")
    say(f"wrote {out}" + (f" and its rig, {beside}" if is_regular else ""))
    asked, own = ({named(rig, path) for path in paths} for paths in (values, description.plant))
    if asked & own:
        warn(f"the scenario's [plant] has its own {', '.join(sorted(asked & own))}")
    say(f"estimate from it: distal estimate {written}")


def list_scenarios_command() -> None:
    """List the shipped scenarios."""
    from distal.simulation import load_scenario, shipped_scenarios

    shipped = [(name, load_scenario(name)) for name in shipped_scenarios()]
    rows = [
        (name, scenario.name, scenario.rig, f"{scenario.duration:g}") for name, scenario in shipped
    ]
    table("scenarios", ["scenario", "title", "rig", "duration [s]"], rows, text=3)


@app.command("show")
def show_scenario_command(name: ScenarioArgument) -> None:
    """Print a scenario's file, to copy and change."""
    from distal.simulation import scenario_text

    print(scenario_text(name), end="")


def _ranges(log: Log, rig: Rig) -> str:
    """Return a text on the range of each joint's true angle."""
    from distal.rig import angle_names

    joints = rig.joint_names
    labels = ["angle"] if len(joints) == 1 else [f"angle of {joint}" for joint in joints]
    truths = [log.truth[name] for name in angle_names(joints)]
    return ", ".join(
        f"{label} from {degrees(theta.min()):.2f}° to {degrees(theta.max()):.2f}°"
        for label, theta in zip(labels, truths)
    )


def reproduce_command(
    out: Annotated[Path, Option(help="Folder for figures, results.json and index.html.")] = Path(
        "out/reproduce"
    ),
) -> None:
    """Simulate and filter the tests of the 2008 paper: its figures 2 to 5, its statements, and a
    page.
    """
    from itertools import count

    from distal.reports.paper_2008 import GROUPS, reproduce, steps

    done = count(1)
    with progress_bar("simulating and filtering", steps()) as advance:
        claims = reproduce(out, lambda: advance(next(done)))
    rows = [(group, str(sum(claim.group == group for claim in claims))) for group in GROUPS]
    table(f"{len(claims)} statements of the paper", ["of them", "number"], rows)
    say(f"open {out}/index.html: figures 2 to 5, all errors, and why each statement holds or not")


STUDY = "A shipped study's name (see `distal studies`) or a TOML file."
"""Help of the argument that names a study."""


def study_command(
    study: Annotated[str, Argument(help=STUDY, autocompletion=studies)],
    out: Annotated[Path, Option(help="Folder for rows and answer; one that is there goes on.")],
    workers: Annotated[
        int | None, Option(min=1, max=1024, help="Processes here; default one per core.")
    ] = None,
) -> None:
    """Ask of many designs, each built many times, whether a requirement is met, and write the
    answer as a page.
    """
    from distal.reports import study_report
    from distal.study import load_study, open_folder, run_study, space_of
    from distal.study.answer import answer_of

    plan = load_study(study)
    space = space_of(plan)
    folder = open_folder(plan, out)
    with stoppable():
        try:
            with progress_bar("runs") as show:
                run_study(plan, space, folder, workers, show)
        except KeyboardInterrupt:
            say(f"what is done is kept in {folder.path}; the same command goes on")
            raise
        answer = answer_of(plan, space, folder.gather())
        page = study_report(plan, space, answer, folder.path)
        say(answer.sentence)
        say(f"wrote {page}, {folder.path / 'answer.json'} and {folder.path / 'rows.parquet'}")


def list_studies_command() -> None:
    """List the shipped studies."""
    from distal.study import load_study, shipped_studies

    studies = [(name, load_study(name).study) for name in shipped_studies()]
    rows = [(name, study.name, study.rig, ", ".join(study.scenarios)) for name, study in studies]
    table("studies", ["study", "title", "rig", "scenarios"], rows, text=4)
