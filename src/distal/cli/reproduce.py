"""`distal reproduce`: the 2008 paper from one command."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from distal.cli.console import err, say, table
from distal.cli.outputs import check_outputs, to_folder


def reproduce_command(
    out: Annotated[Path, typer.Option("--out", help="Folder for figures, results.json and index.html.")] = Path(
        "out/reproduce"
    ),
) -> None:
    """Simulate and filter the 2008 paper's two test series; write its figures, results and a page."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from distal.analysis import PLANTS, run_count
    from distal.reports import FIGURES, REPRODUCTION_FILES, reproduce

    check_outputs(to_folder("--out", out, REPRODUCTION_FILES))
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err()) as progress:
        task = progress.add_task("simulating and filtering", total=run_count() + len(FIGURES))
        claims = reproduce(out, lambda: progress.advance(task))
    rows = []
    for claim in claims:
        main = claim.measures[0]
        values = [f"{main.values[plant]:.2f} {'✓' if main.holds(plant) else '✗'}" for plant in PLANTS]
        rows.append((claim.key, claim.statement, *values, claim.verdict))
    table("the paper's statements", ["", "statement", "as printed", "as observed", "verdict"], rows, text=2)
    say(f"wrote {out}/index.html, results.json and figures 2 to 5 (PNG and SVG)")
