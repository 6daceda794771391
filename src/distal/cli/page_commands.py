"""Commands that write or show pages: `distal lab`, `distal view` and `distal reproduce`; and
`distal doctor`, which says what is installed.
"""

from __future__ import annotations

import platform
import shlex
import shutil
import tempfile
import webbrowser
from itertools import count
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from distal.cli.console import continue_on_failure, progress_bar, say, table, working
from distal.cli.shared_options import (
    EstimatorOption,
    HomingOption,
    RigArgument,
    RigOption,
    SetOption,
    TruthOption,
    check_command_outputs,
    check_ending,
    homing_time,
    to_file,
    to_folder,
)
from distal.version import __version__

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
    """Say which versions and which kernels are in use, and why."""
    from importlib.metadata import PackageNotFoundError, version

    from distal.kernels import cache_folder, find_compiler, lanes_here, probe

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
    backend, reason, difference = probe()
    say(f"kernels: {backend} ({reason})")
    if backend == "compiled":
        say(f"compiled against interpreted: largest difference {difference:.1e}")
        say(f"batches: {lanes_here()} runs in the vector lanes of each core")


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

    check_ending(out, "a page")
    check_command_outputs(to_file("--out", out), rig=rig)
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
        Path | None, Option(help="Where to write the page (HTML); default a temporary file.")
    ] = None,
    estimator: EstimatorOption = None,
    truth: TruthOption = None,
    homing: HomingOption = None,
    open_: Annotated[
        bool | None,
        Option(
            "--open/--no-open",
            help="Open the page in the browser; default where --out is not given.",
        ),
    ] = None,
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
    check_ending(out, "a page")
    check_command_outputs(to_file("--out", out), logs=[log], rig=rig, truth=truth)
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
    if (out is None if open_ is None else open_) and not webbrowser.open(
        position.resolve().as_uri()
    ):
        say("no browser could be opened; open the file yourself")


def reproduce_command(
    out: Annotated[Path, Option(help="Folder for figures, results.json and index.html.")] = Path(
        "out/reproduce"
    ),
    lab: Annotated[
        Path | None, Option(help="A page of distal lab, to be linked from the page.")
    ] = None,
) -> None:
    """Simulate and filter the 2008 paper's two test series; write its figures, results and a
    page.
    """
    from distal.paper.claims import GROUPS
    from distal.paper.paper_figures import CAPTIONS
    from distal.paper.paper_page import FEEDBACKS, REPRODUCTION_FILES, reproduce
    from distal.paper.series import series_count

    check_command_outputs(to_folder("--out", out, REPRODUCTION_FILES))
    done = count(1)
    total = series_count() + len(FEEDBACKS) + len(CAPTIONS)
    with progress_bar("simulating and filtering", total) as show:
        claims, _ = reproduce(out, lambda: show(next(done)), lab)
    rows = [(group, str(sum(claim.group == group for claim in claims))) for group in GROUPS]
    table(f"{len(claims)} statements of the paper", ["of them", "number"], rows)
    say(
        f"open {out}/index.html: a moving link, the rig, figures 2 to 5, all errors, and why each "
        "statement holds or does not"
    )
