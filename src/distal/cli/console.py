"""What commands print: plain lines and tables on stdout, warnings and errors on stderr."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich import box
from rich.console import Console
from rich.table import Table

from distal.errors import one_line, printable


def out() -> Console:
    """Return the console for results."""
    # a file or a pipe has no edge: numbers are not cut there
    width = None if sys.stdout is not None and sys.stdout.isatty() else WIDTH
    return Console(highlight=False, soft_wrap=True, width=width)


WIDTH = 120
"""Columns where the output is no terminal."""


def err() -> Console:
    """Return the console for warnings, errors and progress."""
    return Console(stderr=True, highlight=False, soft_wrap=True)


def say(text: str) -> None:
    """Print a line as it is, without markup."""
    out().print(printable(text), markup=False)


def show_warnings() -> None:
    """Print each warning as one line on stderr, not with the place in the code."""

    def show(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
        warn(str(message))

    warnings.showwarning = show


def warn(text: str) -> None:
    """Print a warning as one line on stderr."""
    print(f"warning: {one_line(text)}", file=sys.stderr)


def failure(text: str) -> None:
    """Print an error after which the command goes on as one line on stderr."""
    print(f"error: {one_line(text)}", file=sys.stderr)


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], text: int = 1) -> None:
    """Print a table; the first `text` columns are text, the others numbers. The first one is never cut."""
    grid = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    for i, name in enumerate(columns):
        grid.add_column(name, justify="left" if i < text else "right", no_wrap=i == 0)
    for row in rows:
        grid.add_row(*row)
    out().print(grid)


@contextmanager
def progress_bar(label: str, total: int | None = None) -> Iterator[Callable[..., None]]:
    """Show how many steps are done and how long the others take, on a terminal; a file or a pipe shows nothing."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn(label), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=err(), transient=True, disable=not err().is_terminal) as bar:
        task = bar.add_task(label, total=total)
        yield lambda done, total=None: bar.update(task, completed=done, total=total)
