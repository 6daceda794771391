"""Commands that write or show pages: `distal lab` and `distal view`; that write the filter as C for
a microcontroller or as an FMU: `distal export-c` and `distal export-fmu`; and `distal doctor`,
which says what is installed.
"""

from __future__ import annotations

import platform
import shlex
import shutil
import tempfile
import webbrowser
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from distal.cli.console import continue_on_failure, say, table, warn, working
from distal.cli.shared_options import (
    EstimatorOption,
    HomingOption,
    RigArgument,
    RigOption,
    SetOption,
    TruthOption,
    check_command_outputs,
    homing_time,
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
    out: Annotated[
        Path | None, Option(help="Folder for the .c, the .h and what belongs to them.")
    ] = None,
    arduino: Annotated[
        Path | None, Option(help="Folder for a library for Arduino and PlatformIO, in float.")
    ] = None,
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
    plant: Annotated[
        bool, Option("--plant", help="Write the simulated rig with its sensors as C too.")
    ] = False,
    command: Annotated[
        bool,
        Option(
            "--command",
            help="Write the inverse as C too: from wanted angles to what the drives do.",
        ),
    ] = False,
    name: NameOption = None,
    set_: SetOption = None,
) -> None:
    """Write an estimator of a rig as C99: no malloc, no globals, for a Cortex-M or any other
    processor.
    """
    from distal.estimators import usual_estimator
    from distal.export import c_name, check_ours, export_arduino, export_c, export_files
    from distal.export.arduino import EDITED
    from distal.rig import load_rig
    from distal.units import to_si

    if (out is None) == (arduino is None):
        raise typer.BadParameter("give one folder: --out for C, or --arduino for a library")
    described = load_rig(rig, set_ or ())
    estimator = estimator or usual_estimator(described)
    name = c_name(f"{Path(rig).stem}_{estimator}") if name is None else name
    home_std = None if home is None else to_si(home, "rad")
    if out is not None:
        check_command_outputs(to_folder("--out", out, export_files(name, plant, command)), rig=rig)
        check_ours(out, export_files(name, plant, command))
        with working("writing C"):
            exported = export_c(
                described,
                out,
                estimator,
                single=single,
                name=name,
                home=home_std,
                plant=plant,
                command=command,
            )
    else:
        assert arduino is not None
        if plant or command or home_std is not None:
            raise typer.BadParameter("--plant, --command and --home are for --out")
        edited = [file for file in EDITED if (arduino / file).is_file()]
        with working("writing C"):
            exported = export_arduino(described, arduino, estimator, name=name)
    rows = [
        ("states", f"{len(exported.estimator.state_names)}"),
        ("state, the caller's", f"{exported.state_bytes:,} bytes"),
        ("arrays on the stack in a step", f"{exported.scratch_bytes:,} bytes"),
    ]
    title = f"{estimator} for {exported.estimator.rig.name}, in {exported.real.type}"
    table(title, ["what", "how much"], rows)
    if out is not None:
        say(
            f"wrote {exported.name}.c, {exported.name}.h, replay.c, CMakeLists.txt and README.md "
            f"to {out}"
        )
    else:
        say(f"wrote the library {exported.name} with its example joint_angle to {arduino}")
        if edited:
            say(f"kept as they were: {', '.join(edited)}; delete one to have it written anew")


def fmu_command(
    rig: RigArgument,
    *,
    out: Annotated[Path, Option(help="The file, which ends in .fmu.")],
    estimator: EstimatorOption = None,
    name: NameOption = None,
    here: Annotated[bool, Option("--here", help="A binary for this platform alone.")] = False,
    set_: SetOption = None,
) -> None:
    """Write an estimator of a rig as an FMU (FMI 3.0, co-simulation): for Simulink, OpenModelica,
    Dymola and others.
    """
    from distal.estimators import usual_estimator
    from distal.export import c_name, export_fmu
    from distal.rig import load_rig

    check_command_outputs(to_file("--out", out), rig=rig)
    described = load_rig(rig, set_ or ())
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
    ]
    rows += [
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
    "plotly": "view",
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
    compiler = find_compiler()
    if isinstance(compiler, str):
        say(f"C compiler: {compiler}")
    else:
        say(f"C compiler: {compiler.version} ({compiler.command[0]})")
    say(f"kernel cache: {cache_folder()}")


def lab_command(
    rig: RigArgument,
    *,
    out: Annotated[Path, Option(help="The page (HTML), one file.")],
    estimator: EstimatorOption = None,
    set_: SetOption = None,
) -> None:
    """Write a page in which the rig moves and is estimated: change what is true, and see when an
    encoder is needed.
    """
    from distal.lab import check_ziglang, lab_page
    from distal.rig import load_rig

    check_command_outputs(to_file("--out", out, "a page"), rig=rig)
    described = load_rig(rig, set_ or ())
    check_ziglang()
    settings = (f"--set {shlex.quote(setting)}" for setting in set_ or ())
    with working("writing plant and filter as C and compiling them to WebAssembly"):
        lab_page(described, out, estimator, " ".join([shlex.quote(rig), *settings]))
    say(f"wrote {out}: one file of {out.stat().st_size / 1000:.0f} kB; open it in a browser")


def view_command(
    log: Annotated[
        Path,
        Argument(help="CSV, Parquet, MCAP or a bag, with the columns that the rig's sensors name."),
    ],
    rig: RigOption,
    *,
    out: Annotated[
        Path | None,
        Option(help="Where to write the page (HTML); default a temporary file, which is opened."),
    ] = None,
    estimator: EstimatorOption = None,
    truth: TruthOption = None,
    homing: HomingOption = None,
    set_: SetOption = None,
) -> None:
    """Estimate over a log and show it in the browser: zoom with the wheel, point at a curve to read
    it.
    """
    from distal.diagnosis import diagnose
    from distal.logs import read_log
    from distal.reports import check_plotly, view_page
    from distal.rig import load_rig
    from distal.run import estimate

    check_plotly()
    check_command_outputs(to_file("--out", out, "a page"), logs=[log], rig=rig, truth=truth)
    description = load_rig(rig, set_ or ())
    samples = read_log(log, description, truth)
    home = homing_time(homing)
    sentences = list[str]()
    with working("estimating") as show:
        result = estimate(samples, description, estimator, homing=home, covariances=False)
        doing = "testing what the log says of the rig"
        show(doing)
        with continue_on_failure(doing):
            sentences.append(diagnose(result, samples, description, home).text)
    position = out if out is not None else Path(tempfile.mkdtemp(prefix="distal-")) / "view.html"
    try:
        with working("drawing the page"):
            view_page(result, samples, description, position, sentences)
    except BaseException:
        if out is None:
            shutil.rmtree(position.parent, ignore_errors=True)
        raise
    for line in (result.in_words(), *sentences):
        say(line)
    say(f"wrote {position}")
    if out is None and not webbrowser.open(position.resolve().as_uri()):
        say("no browser could be opened; open the file yourself")
