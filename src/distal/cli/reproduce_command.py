"""`distal reproduce`: the reproduction of the 2008 paper with one command."""

from __future__ import annotations

from itertools import count
from pathlib import Path
from typing import Annotated

from typer import Option

from distal.cli.console import progress_bar, say, table
from distal.cli.paths import check_command_outputs, to_folder


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
    from distal.paper.claims import GROUPS, rms
    from distal.paper.paper_figures import CAPTIONS
    from distal.paper.paper_page import FEEDBACKS, REPRODUCTION_FILES, reproduce
    from distal.paper.series import PLANTS, SEEDS, SERIES_2, series_count

    check_command_outputs(to_folder("--out", out, REPRODUCTION_FILES))
    done = count(1)
    total = series_count() + len(FEEDBACKS) + len(CAPTIONS)
    with progress_bar("simulating and filtering", total) as show:
        claims, runs = reproduce(out, lambda: show(next(done)), lab)
    observed = PLANTS[1].name
    weights = {
        run.series: run.log.source.removeprefix("Series 2: ").replace(" against ", " / ")
        for run in runs
    }
    names = {
        "inextensible": "tendons taken as inextensible",
        "ekf-2008": "the filter of 2008",
        "adaptive": "adaptive",
    }
    rows = [
        (text, *(f"{rms(runs, series, name, observed):.1f}°" for series in SERIES_2))
        for name, text in names.items()
    ]
    title = f"RMS error of the link's angle, plant with {observed}, {len(SEEDS)} seeds"
    table(title, ["weights on the tendons", *(weights[series] for series in SERIES_2)], rows)
    say(
        "Every estimate knows the paper's Table 1 only; the plant has more friction than Table 1 "
        "says.\n"
    )
    say(
        f"{len(claims)} statements of the paper, each against a threshold that was written down "
        "beforehand:"
    )
    for group in GROUPS:
        texts = [claim.statement.text for claim in claims if claim.group == group]
        say(f"  {group}: {len(texts)}")
        for text in texts:
            say(f"    {text}")
    say(
        f"\nopen {out}/index.html: a moving link, the rig, figures 2 to 5, and why each statement "
        "holds or does not"
    )
