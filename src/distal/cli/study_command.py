"""`distal study`, `distal studies`."""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from distal.cli.console import progress_bar, say, stoppable, table
from distal.cli.shared_options import studies

if TYPE_CHECKING:
    from distal.study import Folder, Plan, Space

STUDY = "A shipped study's name (see `distal studies`) or a TOML file."
"""Help of the argument that names a study."""


def study_command(
    study: Annotated[str, Argument(help=STUDY, autocompletion=studies)],
    out: Annotated[
        Path | None, Option(help="Folder for rows and answer; one that is there goes on.")
    ] = None,
    workers: Annotated[
        int | None, Option(min=1, max=1024, help="Processes here; default one per core.")
    ] = None,
    scheduler: Annotated[
        str | None,
        Option(metavar="tcp://HOST:PORT", help="A Dask scheduler, whose workers run it instead."),
    ] = None,
    suggest: Annotated[
        bool,
        Option(
            "--suggest",
            help="Say which sensor, number or calibration narrows the band most, instead.",
        ),
    ] = False,
) -> None:
    """Ask of many designs, each built many times, whether a requirement is met, and write the
    answer as a page.
    """
    from distal.errors import StudyError
    from distal.study import load_study, open_folder, run_study, space_of

    plan = load_study(study)
    space = space_of(plan)
    if suggest:
        _suggest(plan)
        return
    if out is None:
        raise StudyError(
            "--out is missing: give the folder for rows and answer; one that is there goes on"
        )
    folder = open_folder(plan, out)
    with stoppable():
        try:
            with progress_bar("runs") as show:
                run_study(plan, space, folder, workers, scheduler, show)
        except KeyboardInterrupt:
            say(f"what is done is kept in {folder.path}; the same command goes on")
            raise
        _answer(plan, space, folder)


def _answer(plan: Plan, space: Space, folder: Folder) -> None:
    from distal.reports import study_report
    from distal.study.answer import answer_of

    columns = folder.gather()
    answer = answer_of(plan, space, columns)
    page = study_report(plan, space, columns, answer, folder.path)
    say(answer.sentence)
    say(f"wrote {page}, {folder.path / 'answer.json'} and {folder.path / 'rows.parquet'}")


def _suggest(plan: Plan) -> None:
    from distal.study.suggest import PLANTS, suggestions

    with progress_bar("options") as show:
        base, options = suggestions(plan, show)
    rows = [
        (option.words, f"{degrees(option.band):.3g}", f"{degrees(option.error):.3g}")
        for option in (base, *options)
    ]
    columns = ["option", "band ± [°]", f"RMS over {PLANTS} plants [°]"]
    table(plan.study.name or plan.rig.name, columns, rows)
    say(f"narrowest band: {options[0].words}")


def list_studies_command() -> None:
    """List the shipped studies."""
    from distal.study import load_study, shipped_studies

    studies = [(name, load_study(name).study) for name in shipped_studies()]
    rows = [(name, study.name, study.rig, ", ".join(study.scenarios)) for name, study in studies]
    table("studies", ["study", "title", "rig", "scenarios"], rows, text=4)
