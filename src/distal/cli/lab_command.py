"""`distal lab`: a rig with its filter in the browser."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

from typer import Option

from distal.cli.console import say, working
from distal.cli.paths import check_command_outputs, check_ending, to_file
from distal.cli.shared_options import EstimatorOption, RigArgument, SetOption


def lab_command(
    rig: RigArgument,
    *,
    out: Annotated[Path, Option(help="The page (HTML), one file.")],
    estimator: EstimatorOption = "adaptive",
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
