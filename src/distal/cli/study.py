"""`distal study`, `distal studies`."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from distal.cli.console import err, say, table
from distal.cli.options import studies

if TYPE_CHECKING:
    from distal.study import Folder, Plan, Space
    from distal.study.suggest import Suggestion

STUDY = "A shipped study's name (see `distal studies`) or a TOML file."


def study_command(
    study: Annotated[str, typer.Argument(help=STUDY, autocompletion=studies)],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for rows and answer; one that is there goes on.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, max=1024, help="Processes here; default one per core.")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="tcp://HOST:PORT", help="A Dask scheduler, whose workers run it instead."),
    ] = None,
    suggest: Annotated[
        bool, typer.Option("--suggest", help="Say which sensor, number or calibration narrows the band most, instead.")
    ] = False,
) -> None:
    """Ask of many designs, each built many times, whether a requirement is met, and write the answer as a page."""
    from distal.errors import StudyError
    from distal.study import load_study, open_folder, run_study, space_of

    plan = load_study(study)
    space = space_of(plan)
    if suggest:
        _suggest(plan)
        return
    if out is None:
        raise StudyError("--out is missing: give the folder for rows and answer; one that is there goes on")
    folder = open_folder(plan, out)
    with _stoppable():
        try:
            with _progress("runs") as show:
                run_study(plan, space, folder, workers, scheduler, show)
        except KeyboardInterrupt:
            say(f"what is done is kept in {folder.path}; the same command goes on")
            raise
        _answer(plan, space, folder)


def _answer(plan: Plan, space: Space, folder: Folder) -> None:
    from distal.reports import study_report
    from distal.study.answer import answer_of

    rows = folder.gather()
    columns = folder.read()
    answer = answer_of(plan, space, columns)
    page = study_report(plan, space, columns, answer, folder.path)
    say(answer.sentence)
    say(f"wrote {page}, {folder.path / 'answer.json'} and {rows}")


@contextmanager
def _progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """Show how much is done and how long the rest takes, on a terminal."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=err(), transient=True, disable=not err().is_terminal) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def _stoppable() -> Iterator[None]:
    """Let SIGTERM stop the study as Ctrl-C does."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _suggest(plan: Plan) -> None:
    from distal.study.suggest import PLANTS, suggestions

    with _progress("options") as show:
        base, found, tau = suggestions(plan, show)
    errors = sorted(one.error for one in found)
    rows = [
        (one.words, f"{degrees(one.band):.3g}", f"{k}", f"{degrees(one.error):.3g}", f"{errors.index(one.error) + 1}")
        for k, one in enumerate(found, 1)
    ]
    columns = ["option", "band ± [°]", "rank", f"RMS over {PLANTS} plants [°]", "rank"]
    table(plan.study.name or plan.rig.name, columns, [(base.words, *_of(base)), *rows])
    say(f"most by the band: {found[0].words}; Kendall's tau of the two ranks: {tau:.2f}")


def _of(base: Suggestion) -> tuple[str, str, str, str]:
    return f"{degrees(base.band):.3g}", "", f"{degrees(base.error):.3g}", ""


def list_command() -> None:
    """List the shipped studies."""
    from distal.study import load_study, shipped_studies

    rows = []
    for name in shipped_studies():
        plan = load_study(name)
        rows.append((name, plan.study.name, plan.study.rig, ", ".join(plan.study.scenarios)))
    table("studies", ["study", "title", "rig", "scenarios"], rows, text=4)
