"""`distal export-c`: the filter as C for a microcontroller."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from distal.cli.console import say, table, warn
from distal.cli.options import RigArgument, SetOption
from distal.cli.outputs import check_outputs, to_folder


def export_command(
    rig: RigArgument,
    out: Annotated[Path, typer.Option("--out", help="Folder for the .c, the .h and what belongs to them.")],
    single: Annotated[bool, typer.Option("--float", help="float and float functions only; else double.")] = False,
    estimator: Annotated[str, typer.Option("--estimator", "-e", help="adaptive, ekf or ekf-2008.")] = "adaptive",
    name: Annotated[
        str | None, typer.Option("--name", help="What all names begin with; default from the rig and the estimator.")
    ] = None,
    set_: SetOption = None,
) -> None:
    """Write an estimator of a rig as C99: no malloc, no globals, for a Cortex-M or any other processor."""
    from distal.export import c_name, check_ours, export_c, export_files
    from distal.rig import load_rig

    name = c_name(f"{Path(rig).stem}_{estimator}") if name is None else name
    check_outputs(to_folder("--out", out, export_files(name)), rig=rig)
    check_ours(out, export_files(name))
    described = load_rig(rig, set_ or ())
    made = export_c(described, out, estimator, single, name)
    rows = [
        ("states", f"{len(made.states)}"),
        ("state, the caller's", f"{made.state_bytes:,} bytes"),
        ("arrays on the stack in a step", f"{made.scratch_bytes:,} bytes"),
        ("arithmetic operations in a step", f"{made.operations:,}"),
        ("calls of the mathematics library", f"{sum(made.library.values())}"),
    ]
    table(f"{made.estimator} for {made.rig}, in {'float' if single else 'double'}", ["what", "how much"], rows)
    if made.single and made.jumps:
        warn(
            f"in float, {estimator} may differ from double by more than its band, since it jumps from sticking to "
            "slipping; adaptive does not"
        )
    say(f"wrote {made.name}.c, {made.name}.h, replay.c, CMakeLists.txt and README.md to {out}")
