"""`distal rig from-table`, `from-orca`, `from-aero` and `from-mjcf`: a rig file from a table or
from a maker's or a simulator's files.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from distal.cli.console import say, table
from distal.cli.paths import check_command_outputs, check_ending, check_new, to_file
from distal.cli.rig_commands import app as app

if TYPE_CHECKING:
    from distal.rig import Imported, Rig

OutOption = Annotated[Path, Option(help="Where to write the rig file (.toml).")]
"""Option for the path of the new rig file."""


def _write(imported: Imported, out: Path, source: str) -> None:
    """Write an imported rig, and print which of its parameters are guesses."""
    from distal.logs import write_whole

    write_whole(out, imported.text)
    say(f"{imported.rig}")
    for note in imported.notes:
        say(f"  {note}")
    say(f"not in the {source}, so written with a guess and a wide std:")
    say(f"  {', '.join(imported.missing)}")
    say(f"wrote {out}; look for 'not in the {source}' in it, then `distal rig check {out}`")


def _check(out: Path, *inputs: Path | None) -> None:
    given: Sequence[Path] = [path for path in inputs if path is not None]
    check_command_outputs(to_file("--out", out), logs=list(given))
    check_ending(out, "a rig file")
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

    _check(out, hand)
    _write(from_table(hand), out, "table")


@app.command("from-orca")
def from_orca_command(
    config: Annotated[Path, Argument(help="The hand's config.yaml.")],
    calibration: Annotated[Path | None, Argument(help="Its calibration.yaml.")] = None,
    out: OutOption = Path("rig.toml"),
) -> None:
    """Write the rig file of an ORCA hand from its own configuration and calibration."""
    from distal.rig import from_orca

    _check(out, config, calibration)
    _write(from_orca(config, calibration), out, "config")


@app.command("from-aero")
def from_aero_command(
    folder: Annotated[
        Path | None, Argument(help="Where the SDK was cloned; default: the installed one.")
    ] = None,
    out: OutOption = Path("rig.toml"),
) -> None:
    """Write the rig file of an Aero Hand: its own SDK says how far each motor turns for each
    joint.
    """
    from distal.rig import from_aero

    _check(out)
    _write(from_aero(folder), out, "SDK")


LENGTH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
"""Unit of length of a model → its size [m]."""


@app.command("from-mjcf")
def from_mjcf_command(
    model: Annotated[Path, Argument(help="A MuJoCo model (.xml).")],
    out: OutOption = Path("rig.toml"),
    chain: Annotated[
        str | None, Option(help="Only joints of this body and what it carries.")
    ] = None,
    joints: Annotated[str | None, Option(help="Only these joints, separated by commas.")] = None,
    length_unit: Annotated[str, Option(help="Unit of length of the model: m, cm or mm.")] = "m",
    compare: Annotated[
        Path | None, Option(help="A table of joints' angles and tendons' lengths (.csv).")
    ] = None,
) -> None:
    """Write a rig file from a MuJoCo model, with what the model does not say marked in it."""
    from distal.errors import RigError
    from distal.rig import from_mujoco

    check_command_outputs(
        to_file("--out", out), rig=str(model), logs=[compare] if compare is not None else []
    )
    if length_unit not in LENGTH_UNITS:
        raise RigError(f"--length-unit must be m, cm or mm, '{length_unit}' came")
    chosen = [name.strip() for name in joints.split(",")] if joints else None
    imported = from_mujoco(model, chain, chosen, LENGTH_UNITS[length_unit])
    _write(imported, out, "model")
    if compare is not None:
        _compare(imported.rig, compare)


def _compare(rig: Rig, path: Path) -> None:
    from distal.logs import open_table, table_of
    from distal.rig import compare_lengths

    units = {joint.name: "rad" for joint in rig.joints} | {
        tendon.name: "m" for tendon in rig.tendons
    }
    cells = open_table(path, list(units))
    rows = []
    lengths = table_of(cells, [name for name in cells.names if name in units])
    for pair in compare_lengths(
        rig, {name: lengths.in_si(name, units[name]) for name in lengths.columns}
    ):
        arms = f"{1e3 * pair.arm:.2f}", f"{1e3 * pair.other:.2f}"
        rows.append(
            (
                pair.tendon,
                pair.joint,
                *arms,
                "differs" if pair.differs else "",
                f"{1e3 * pair.rms:.2f}",
            )
        )
    columns = [
        "tendon",
        "joint",
        "arm here, mm",
        f"arm in {path.name}, mm",
        "",
        "length differs by, mm RMS",
    ]
    table("lengths", columns, rows, text=2)
