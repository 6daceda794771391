"""Commands that write the filter as C for a microcontroller or as an FMU (`distal export-c`,
`distal export-fmu`), and `distal doctor`, which says what is installed.
"""

from __future__ import annotations

import platform
from pathlib import Path
from typing import Annotated

from typer import Option

from distal.cli.console import say, table, warn, working
from distal.cli.shared_options import (
    EstimatorOption,
    RigArgument,
    SetOption,
    check_command_outputs,
    to_file,
    to_folder,
)
from distal.version import __version__

NameOption = Annotated[
    str | None,
    Option("--name", help="What all names begin with; default from the rig and the estimator."),
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
    check_command_outputs(to_folder("--out", out, files), rig=rig)
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

    check_command_outputs(to_file("--out", out), rig=rig)
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


_PACKAGES = ("numpy", "scipy", "casadi", "pydantic", "pint", "matplotlib")

_EXTRAS = {
    "pyarrow": "parquet",
    "pandas": "pandas",
    "polars": "polars",
    "mcap": "mcap",
    "rosbags": "ros",
}
"""Packages that are not needed, and the extra that installs each."""


def doctor_command() -> None:
    """Say which versions are in use, and with which compiler and where kernels are built."""
    from importlib.metadata import PackageNotFoundError, version

    from distal.kernels import cache_folder, find_compiler

    say(
        f"distal {__version__}, Python {platform.python_version()}, {platform.system()} "
        f"{platform.machine()}"
    )

    def installed(name: str, advice: str = "") -> str:
        try:
            return f"{name} {version(name)}"
        except PackageNotFoundError:
            return f"{name} not installed{advice}"

    say(f"packages: {', '.join(map(installed, _PACKAGES))}")
    extras = (installed(name, f" (pip install '.[{extra}]')") for name, extra in _EXTRAS.items())
    say(f"extras: {', '.join(extras)}")
    found = find_compiler()
    compiler = found if isinstance(found, str) else f"{found.version} ({found.command[0]})"
    say(f"C compiler: {compiler}")
    say(f"kernel cache: {cache_folder()}")
