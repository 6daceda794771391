"""`distal reproduce`: the reproduction of the 2008 paper with one command."""

from __future__ import annotations

from itertools import count
from pathlib import Path
from typing import Annotated

import typer
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
    search: Annotated[
        bool,
        Option(
            "--search",
            help="Search for the rig that the authors may have had instead (15 minutes).",
        ),
    ] = False,
) -> None:
    """Simulate and filter the 2008 paper's two test series; write its figures, results and a
    page.
    """
    from distal.paper.map import SEARCH_FILES
    from distal.paper.paper_page import REPRODUCTION_FILES

    check_command_outputs(to_folder("--out", out, SEARCH_FILES if search else REPRODUCTION_FILES))
    if lab is not None and search:
        raise typer.BadParameter("--lab is for the reproduction; leave it out with --search")
    if search:
        _search(out)
    else:
        _reproduce(out, lab)


def _reproduce(out: Path, lab: Path | None) -> None:
    """Run the reproduction and print its results."""
    from distal.paper.claims import GROUPS
    from distal.paper.paper_page import DRAWN, reproduce, rms_of
    from distal.paper.positioned import FEEDBACKS
    from distal.paper.series import PLANTS, SEEDS, SERIES_2, series_count

    done = count(1)
    total = series_count() + len(FEEDBACKS) + len(DRAWN)
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
        (text, *(f"{rms_of(runs, observed, series, name):.1f}°" for series in SERIES_2))
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


def _search(out: Path) -> None:
    """Search for the rig that the authors may have had, and print which statements hold on it."""
    from distal.paper.map import SEARCH_FILES, search_in_words, write_search
    from distal.paper.rig_search import DRAWN, search_rigs

    with progress_bar("simulating plants", sum(DRAWN)) as show:
        searched = search_rigs(show)
    write_search(searched, out)
    for line in search_in_words(searched):
        say(line)
    say(f"wrote {', '.join(f'{out}/{name}' for name in SEARCH_FILES)}")
