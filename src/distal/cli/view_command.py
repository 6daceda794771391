"""`distal view`: an interactive page on a log."""

from __future__ import annotations

import shutil
import tempfile
import webbrowser
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from distal.cli.console import continue_on_failure, say, working
from distal.cli.paths import check_command_outputs, check_ending, to_file
from distal.cli.shared_options import (
    EstimatorOption,
    HomingOption,
    RigOption,
    SetOption,
    TruthOption,
    homing_time,
)


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
    estimator: EstimatorOption = "adaptive",
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
    with working(f"estimating with {estimator}") as show:
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
