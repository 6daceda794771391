"""Commands on rig files: `distal rigs`; `distal rig check`, `draw`, `show`, `new`; `from-table`,
`from-orca` and `from-mjcf` make one from the files of a maker or a simulator, `to-mjcf` a model
for MuJoCo; `distal export-c` and `export-fmu` write the rig's filter.
"""

from __future__ import annotations

import re
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from distal.cli.shared_options import (
    EstimatorOption,
    RigArgument,
    SetOption,
    check_command_outputs,
    check_new,
    say,
    table,
    warn,
    working,
)
from distal.units import rounded

if TYPE_CHECKING:
    from distal.model import Mechanism
    from distal.rig import Imported, Rig, Sensor

GEOMETRY = re.compile(
    r"\.(offset|link\.centre|link\.inertia)\.\d$|\.friction\.reference$|\.terms\.\d+\.coefficient$"
)
"""Pattern of parameters that are drawn or follow from others; they are not listed as exact."""

app = typer.Typer(help="Look at rig files and make new ones.", no_args_is_help=True)


def list_rigs_command() -> None:
    """List the shipped rigs."""
    from distal.rig import load_rig, shipped_rigs

    rows = [
        (
            name,
            rig.name,
            f"{len(rig.tendons)}",
            ", ".join(dict.fromkeys(drive.kind for drive in rig.drives)),
            ", ".join(rig.sensor_names),
        )
        for name, rig in ((name, load_rig(name)) for name in shipped_rigs())
    ]
    table("rigs", ["rig", "title", "tendons", "drives", "sensors"], rows, text=5)


@app.command("check")
def check_command(rig: RigArgument, set_: SetOption) -> None:
    """Check a rig file and say what it holds."""
    from distal.model import Mechanism, stiffest_frequency, substeps
    from distal.rig import (
        doubts,
        in_words,
        load_rig,
        scales_in_words,
    )

    description = load_rig(rig, set_)
    mechanism = Mechanism(description)
    rate = max((sensor.rate for sensor in description.sensors), default=100.0)
    count = substeps(mechanism, 1.0 / rate)
    values = mechanism.parameters
    say(f"{rig}: ok, '{description.name}'")
    if description.taken:
        say(f"  {scales_in_words(description)}")
    say(f"  {description.count_in_words()}")
    uncertain = _uncertain(description, mechanism)
    say(
        f"  stiffest mode {stiffest_frequency(mechanism):.4g} rad/s: {count} sub-steps per sample "
        f"at {rate:g} Hz"
    )
    for name, each in {} if description.map is None else description.map.named().items():
        source = "a homing move" if each.logs == 0 else f"{each.logs} log{'s' * (each.logs > 1)}"
        say(f"  map.{name}: {', '.join(each.joints)} by {', '.join(each.channels)}, from {source}")
    if description.left_out is not None:
        say(f"  {description.left_out.in_words()}")
    say(f"  uncertain: {in_words(description, *uncertain) or 'nothing (no parameter has a std)'}")
    exact = [
        name
        for name, value, std in zip(values.names, values.values, values.stds)
        if std == 0.0
        and value != 0.0
        and not name.startswith(("sensors.", "base."))
        and not GEOMETRY.search(name)
    ]
    say(f"  taken as exact: {in_words(description, *exact) or 'nothing'}")
    for sensor in description.sensors:
        gear = getattr(sensor, "gear", 1.0)
        if sensor.measures == "position" and gear != 1.0:
            _say_gear(sensor, gear)
    for doubt in doubts(description):
        warn(doubt)


def _uncertain(rig: Rig, mechanism: Mechanism) -> list[str]:
    """Return the paths of all that has a std, those of the equations of motion first."""
    from distal.rig import parameters_below

    values = mechanism.parameters
    uncertain = [name for name, std in zip(values.names, values.stds) if std > 0.0]
    for kind, parts in rig.components.items():
        for i, part in enumerate(parts):
            at = f"{kind}.{i}"
            # initial angles and errors of sensors are no parameters of the equations of motion
            stds = {path: number.filter_std for path, number in parameters_below(part, at)}
            stds[f"{at}.linearity"] = getattr(part, "linearity", 0.0)
            uncertain += [path for path, std in stds.items() if std > 0.0 and path not in uncertain]
    return uncertain


def _say_gear(sensor: Sensor, gear: float) -> None:
    """Print what a sensor before a gear reads of the capstan."""
    from distal.rig import step_of

    sides = [
        f"{_degrees(sensor.resolution)} at the motor, {_degrees(step_of(sensor))} at the capstan"
    ]
    sides += [
        f"{name} {_degrees(gear * value)} at the motor, {_degrees(value)} at the capstan"
        for name, value in (("noise", sensor.noise), ("linearity", sensor.linearity))
        if value > 0.0
    ]
    say(f"  {sensor.name} is before a gear of {gear:g}: resolution {'; '.join(sides)}")


def _degrees(angle: float) -> str:
    return f"{rounded(degrees(angle), 3)}°"


@app.command("draw")
def draw_command(
    rig: RigArgument,
    out: Annotated[Path, Option(help="Where to save it (.png, .svg or .pdf).")] = Path("rig.png"),
    *,
    set_: SetOption,
) -> None:
    """Draw a rig: which drive pulls which tendon, which joints it turns and which way, with
    springs, stops, sensors and their numbers.
    """
    from distal.reports import draw_rig
    from distal.results import plot_kind, save_figure
    from distal.rig import load_rig

    plot_kind(out)
    check_command_outputs([out], rig=rig)
    description = load_rig(rig, set_)
    with working("drawing"):
        save_figure(draw_rig(description), out)
    say(f"wrote {out}")


@app.command("show")
def show_rig_command(name: RigArgument, set_: SetOption) -> None:
    """Print a rig's file, with the values of --set put in, to copy and change."""
    from distal.rig import edited_text

    print(edited_text(name, set_), end="")


OutOption = Annotated[Path, Option(help="Where to write the rig file (.toml).")]
"""Option for the path of the new rig file."""


def _write(imported: Imported, out: Path, source: str) -> None:
    """Write an imported rig, and print which of its parameters are guesses."""
    from distal.logs import write_whole

    write_whole(out, imported.text)
    say(str(imported.rig))
    for note in imported.notes:
        say(f"  {note}")
    then = ""
    if imported.missing:
        say(f"not in the {source}, so written with a guess and a wide std:")
        say(f"  {', '.join(imported.missing)}")
        then = f"; look for 'not in the {source}' in it, then `distal rig check {out}`"
    say(f"wrote {out}{then}")


def check_new_rig(out: Path, *inputs: Path | None) -> None:
    """Raise an `OutputError` where a new rig file cannot be written beside what is read."""
    check_command_outputs([out], "a rig file", logs=inputs)
    check_new(out)


@app.command("from-table")
def from_table_command(
    hand: Annotated[Path, Argument(help="A table of joints and motors (.csv).")],
    out: OutOption = Path("rig.toml"),
) -> None:
    """Write the rig file of a hand from a table: joint, motor, spool_radius, joint_radius,
    direction, low, high.
    """
    from distal.rig import from_table

    check_new_rig(out, hand)
    _write(from_table(hand), out, "table")


@app.command("from-orca")
def from_orca_command(
    config: Annotated[Path, Argument(help="The hand's config.yaml.")],
    calibration: Annotated[Path | None, Argument(help="Its calibration.yaml.")] = None,
    out: OutOption = Path("rig.toml"),
) -> None:
    """Write the rig file of an ORCA hand from its own configuration and calibration."""
    from distal.rig import from_orca

    check_new_rig(out, config, calibration)
    _write(from_orca(config, calibration), out, "config")


@app.command("from-mjcf")
def from_mjcf_command(
    model: Annotated[Path, Argument(help="A MuJoCo model (.xml).")],
    out: OutOption = Path("rig.toml"),
    chain: Annotated[
        str | None, Option(help="Only joints of this body and what it carries.")
    ] = None,
    joints: Annotated[str | None, Option(help="Only these joints, separated by commas.")] = None,
    length_unit: Annotated[str, Option(help="Unit of length of the model, e.g. mm.")] = "m",
) -> None:
    """Write a rig file from a MuJoCo model, with what the model does not say marked in it."""
    from distal.rig import from_mujoco
    from distal.units import unit_factor

    check_new_rig(out, model)
    chosen = [name.strip() for name in joints.split(",")] if joints else None
    _write(from_mujoco(model, chain, chosen, unit_factor(length_unit, "m")), out, "model")


@app.command("to-mjcf")
def to_mjcf_command(
    rig: RigArgument,
    out: Annotated[Path, Option(help="Where to write the model.")] = Path("model.xml"),
    into: Annotated[
        Path | None, Option(help="A model with the rig's joints, which gets its numbers.")
    ] = None,
    draws: Annotated[int, Option(min=0, help="Number of models, drawn by the rig's stds.")] = 0,
    *,
    set_: SetOption,
) -> None:
    """Write a rig as a MuJoCo model."""
    from distal.logs import write_whole
    from distal.rig import load_rig
    from distal.rig.mjcf_bodies import mujoco_module
    from distal.study.design_space import built_values, draws_of, scores

    mujoco_module()
    from distal.bridges.mujoco import to_mjcf

    described = load_rig(rig, set_).bare()
    paths = [out.with_stem(f"{out.stem}-{n + 1}") for n in range(draws)] or [out]
    drawn = draws_of(described) if draws else ()
    for n, path in enumerate(paths):
        check_command_outputs([path], rig=rig, logs=[into])
        values = built_values(described, drawn, scores(drawn, [n]))
        write_whole(path, to_mjcf(described.with_values(values), into))
        say(f"wrote {path}")


NameOption = Annotated[
    str | None,
    Option(help="What all names begin with; default from the rig and the estimator."),
]
"""Option for the prefix of all C names."""


def export_command(
    rig: RigArgument,
    *,
    out: Annotated[Path, Option(help="Folder for the .c, the .h and a README.")],
    arduino: Annotated[
        bool, Option("--arduino", help="Lay it out as a library for Arduino and PlatformIO.")
    ] = False,
    single: Annotated[
        bool, Option("--float", help="float and float functions only; else double.")
    ] = False,
    estimator: EstimatorOption = None,
    home: Annotated[
        str | None,
        Option(
            help="Home while it runs: how well a joint's angle is known there, such as '1 deg'."
        ),
    ] = None,
    command: Annotated[
        bool,
        Option(
            "--command",
            help="Write the inverse as C too: from wanted angles to what the drives do.",
        ),
    ] = False,
    name: NameOption = None,
    set_: SetOption,
) -> None:
    """Write an estimator of a rig as C99: no malloc, no globals, for a Cortex-M or any other
    processor.
    """
    from distal.estimators import usual_estimator
    from distal.export import c_name, check_ours, export_c, export_files
    from distal.rig import load_rig
    from distal.units import to_si

    described = load_rig(rig, set_)
    estimator = estimator or usual_estimator(described)
    name = c_name(f"{Path(rig).stem}_{estimator}") if name is None else name
    home_std = None if home is None else to_si(home, "rad")
    files = export_files(name, command, arduino)
    check_command_outputs([out / file for file in files], rig=rig, makes_folder=True)
    check_ours(out, files)
    with working("writing C"):
        exported = export_c(
            described,
            out,
            estimator,
            single=single,
            name=name,
            home=home_std,
            command=command,
            arduino=arduino,
        )
    rows = [
        ("states", f"{len(exported.estimator.state_names)}"),
        ("state, the caller's", f"{exported.state_bytes:,} bytes"),
        ("arrays on the stack in a step", f"{exported.scratch_bytes:,} bytes"),
    ]
    title = f"{estimator} for {exported.estimator.rig.name}, in {exported.real.type}"
    table(title, ["what", "how much"], rows)
    say(f"wrote {', '.join(files)} to {out}")


def fmu_command(
    rig: RigArgument,
    *,
    out: Annotated[Path, Option(help="The file, which ends in .fmu.")],
    estimator: EstimatorOption = None,
    name: NameOption = None,
    here: Annotated[bool, Option("--here", help="A binary for this platform alone.")] = False,
    set_: SetOption,
) -> None:
    """Write an estimator of a rig as an FMU (FMI 3.0, co-simulation): for Simulink, OpenModelica,
    Dymola and others.
    """
    from distal.estimators import usual_estimator
    from distal.export import c_name, export_fmu
    from distal.rig import load_rig

    check_command_outputs([out], rig=rig)
    described = load_rig(rig, set_)
    estimator = estimator or usual_estimator(described)
    name = c_name(f"{Path(rig).stem}_{estimator}") if name is None else name
    what = (
        "writing C and compiling it"
        if here
        else "compiling; with ziglang for all platforms: minutes the first time"
    )
    with working(what):
        fmu = export_fmu(described, out, estimator, name, everywhere=not here)
    rows = [
        ("inputs, NaN where missing", ", ".join(fmu.inputs)),
        ("outputs", ", ".join(fmu.outputs)),
        ("step", f"{fmu.exported.estimator.interval:g} s"),
        ("binaries", ", ".join(fmu.platforms) or "none"),
    ]
    table(
        f"{estimator} for {fmu.exported.estimator.rig.name}, FMI 3.0 co-simulation",
        ["what", "which"],
        rows,
    )
    if fmu.without:
        warn(f"no {'other ' * bool(fmu.platforms)}binary: {fmu.without}")
    say(f"wrote {out}; for other platforms a tool builds it from the sources in it")
