"""`distal export-c` and `distal export-fmu`: the filter as C for a microcontroller, and as an FMU."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from distal.cli.console import say, table, warn
from distal.cli.options import RigArgument, SetOption
from distal.cli.outputs import check_outputs, to_file, to_folder

ExportedOption = Annotated[
    str, typer.Option("--estimator", "-e", help="adaptive, ekf, ekf-2008, inextensible or elastic.")
]
NameOption = Annotated[
    str | None, typer.Option("--name", help="What all names begin with; default from the rig and the estimator.")
]


def export_command(
    rig: RigArgument,
    *,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the .c, the .h and what belongs to them.")
    ] = None,
    arduino: Annotated[
        Path | None, typer.Option("--arduino", help="Folder for a library for Arduino and PlatformIO, in float.")
    ] = None,
    single: Annotated[bool, typer.Option("--float", help="float and float functions only; else double.")] = False,
    estimator: ExportedOption = "adaptive",
    home: Annotated[
        str | None,
        typer.Option("--home", help="Home while it runs: how well a joint's angle is known there, such as '1 deg'."),
    ] = None,
    plant: Annotated[bool, typer.Option("--plant", help="Write the simulated rig with its sensors as C too.")] = False,
    name: NameOption = None,
    set_: SetOption = None,
) -> None:
    """Write an estimator of a rig as C99: no malloc, no globals, for a Cortex-M or any other processor."""
    from distal.export import c_name, check_ours, export_arduino, export_c, export_files
    from distal.export.arduino import EDITED
    from distal.rig import load_rig
    from distal.units import to_si

    if (out is None) == (arduino is None):
        raise typer.BadParameter("give one folder: --out for C, or --arduino for a library")
    name = c_name(f"{Path(rig).stem}_{estimator}") if name is None else name
    known = None if home is None else to_si(home, "rad")
    if out is not None:
        check_outputs(to_folder("--out", out, export_files(name, plant)), rig=rig)
        check_ours(out, export_files(name, plant))
        made = export_c(load_rig(rig, set_ or ()), out, estimator, single=single, name=name, home=known, plant=plant)
    else:
        assert arduino is not None
        if plant or known is not None:
            raise typer.BadParameter("--plant and --home are for --out")
        kept = [file for file in EDITED if (arduino / file).is_file()]
        made = export_arduino(load_rig(rig, set_ or ()), arduino, estimator, name=name)
    rows = [
        ("states", f"{len(made.states)}"),
        ("state, the caller's", f"{made.state_bytes:,} bytes"),
        ("arrays on the stack in a step", f"{made.scratch_bytes:,} bytes"),
        ("arithmetic operations in a step", f"{made.operations:,}"),
        ("calls of the mathematics library", f"{sum(made.library.values())}"),
    ]
    table(f"{made.estimator} for {made.rig}, in {'float' if made.single else 'double'}", ["what", "how much"], rows)
    if made.single and made.jumps:
        warn(
            f"in float, {estimator} may differ from double by more than its band, since it jumps from sticking to "
            "slipping; adaptive does not"
        )
    if out is not None:
        say(f"wrote {made.name}.c, {made.name}.h, replay.c, CMakeLists.txt and README.md to {out}")
    else:
        say(f"wrote the library {made.name} with its example joint_angle to {arduino}")
        if kept:
            say(f"kept as they were: {', '.join(kept)}; delete one to have it written anew")


def fmu_command(
    rig: RigArgument,
    *,
    out: Annotated[Path, typer.Option("--out", help="The file, which ends in .fmu.")],
    estimator: ExportedOption = "adaptive",
    name: NameOption = None,
    set_: SetOption = None,
) -> None:
    """Write an estimator of a rig as an FMU (FMI 3.0, co-simulation): for Simulink, OpenModelica, Dymola and others."""
    from distal.export import c_name, export_fmu
    from distal.rig import load_rig

    check_outputs(to_file("--out", out), rig=rig)
    name = c_name(f"{Path(rig).stem}_{estimator}") if name is None else name
    made = export_fmu(load_rig(rig, set_ or ()), out, estimator, name)
    rows = [("inputs, NaN where missing", ", ".join(made.inputs)), ("outputs", ", ".join(made.outputs))]
    rows += [("step", f"{made.exported.interval:g} s"), ("binaries", ", ".join(made.platforms) or "none")]
    table(f"{made.exported.estimator} for {made.exported.rig}, FMI 3.0 co-simulation", ["what", "which"], rows)
    if made.without:
        warn(f"no binary: {made.without}")
    say(f"wrote {out}; for other platforms a tool builds it from the sources in it")
