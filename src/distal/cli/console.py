"""What commands print: plain lines and tables on stdout, warnings and errors on stderr."""

from __future__ import annotations

import logging
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from threading import Timer

from rich import box
from rich.console import Console
from rich.table import Table

from distal.errors import DistalError, one_line, printable


def out() -> Console:
    """Return the console on which results are printed."""
    # a file or a pipe has no edge: numbers are not cut there
    width = None if sys.stdout is not None and sys.stdout.isatty() else WIDTH
    return Console(highlight=False, soft_wrap=True, width=width)


WIDTH = 120
"""Width of the output where it is no terminal [characters]. Source: layout."""


def err() -> Console:
    """Return the console on which warnings, errors and progress are printed."""
    return Console(stderr=True, highlight=False, soft_wrap=True)


def say(text: str) -> None:
    """Print a line on stdout; nothing in it is taken as markup."""
    out().print(printable(text), markup=False)


def show_warnings() -> None:
    """Let Python print each warning as one line on stderr, without its position in the code."""

    def show(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
        warn(str(message))

    warnings.showwarning = show


def warn(text: str) -> None:
    """Print a warning as one line on stderr."""
    print(f"warning: {one_line(text)}", file=sys.stderr)


def failure(text: str) -> None:
    """Print an error as one line on stderr; the command goes on after it."""
    print(f"error: {one_line(text)}", file=sys.stderr)


TRACEBACK = "DISTAL_TRACEBACK"
"""Environment variable that lets Python print the traceback of a fault of distal."""


def fault(problem: BaseException) -> str:
    """Return the text of an error that no user can mend."""
    return (
        f"{type(problem).__name__}: {str(problem)[:200]}; this is a fault of distal, please report "
        f"it with what {TRACEBACK}=1 distal … prints"
    )


@contextmanager
def continue_on_failure(part: str) -> Iterator[None]:
    """Go on where a part of an answer fails, with one line on stderr that says so.

    Args:
        part: what is made within the context, for the line.
    """
    try:
        yield
    except Exception as problem:
        if os.environ.get(TRACEBACK):
            raise
        reason = str(problem) if isinstance(problem, DistalError) else fault(problem)
        failure(f"{part} failed; the rest holds: {reason}")


LONGEST = 60
"""Length up to which a table's first column stays on one line [characters]. Source: layout."""


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], text: int = 1) -> None:
    """Print a table; nothing in it is cut off.

    A first column that is longer than `LONGEST` goes on in the next line.

    Args:
        text: how many columns, from the first one, are text; the others are numbers.
    """
    grid = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    for i, name in enumerate(columns):
        cells = [len(row[i]) for row in rows]
        if i == 0:
            grid.add_column(name, no_wrap=max(cells, default=0) <= LONGEST)
        elif i < text:
            grid.add_column(name)
        else:
            grid.add_column(name, justify="right", min_width=max(cells, default=0))
    for row in rows:
        grid.add_row(*row)
    out().print(grid)


QUIET = 1.0
"""Time of silence after which a command says what it does, where stderr is no terminal [s]; with
the start of Python it is two seconds. Each time after that it is silent for twice as long. Source:
judgement.
"""


class _Activity(logging.Handler):
    """What a command is doing, which is passed to `show`.

    Where stderr is no terminal, it is also printed as a line after `QUIET` seconds.
    """

    def __init__(self, show: Callable[[str], None], *, silent: bool) -> None:
        super().__init__()
        self._show = show
        self._silent = silent
        self._doing = ""
        self._text = ""
        self._wait = QUIET
        self.timer = Timer(0.0, self._print)

    def now(self, doing: str) -> None:
        self._doing = doing
        self._tell(doing)

    def emit(self, record: logging.LogRecord) -> None:
        detail = record.getMessage()  # what happens to a kernel; empty once it is done
        self._tell(f"{self._doing}: {detail}" if detail else self._doing)

    def _tell(self, text: str) -> None:
        self._text = text
        self._show(text)
        if not self._silent and not self.timer.is_alive():
            self._begin()

    def _begin(self) -> None:
        self.timer = Timer(self._wait, self._print)
        self.timer.daemon = True
        self.timer.start()

    def end(self) -> None:
        """Print nothing from now on, whatever another thread still tells."""
        self._silent = True
        self.timer.cancel()

    def _print(self) -> None:
        if self._silent:
            return
        self._wait *= 2.0
        print(f"{self._text} …", file=sys.stderr, flush=True)
        self._begin()


@contextmanager
def working(doing: str) -> Iterator[Callable[[str], None]]:
    """Show what a command is doing and for how long, on a terminal; elsewhere print a line after a
    while.

    The context gives a function that takes a text on what the command does next.
    """
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    shown = err()
    kernels = logging.getLogger("distal.kernels")
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    with Progress(
        *columns,
        console=shown,
        transient=True,
        disable=not shown.is_terminal,
        redirect_stdout=False,
    ) as bar:
        task = bar.add_task(doing, total=None)
        activity = _Activity(
            lambda text: bar.update(task, description=text), silent=shown.is_terminal
        )
        kernels.addHandler(activity)
        kernels.setLevel(logging.INFO)
        try:
            activity.now(doing)
            yield activity.now
        finally:
            kernels.removeHandler(activity)
            activity.end()


@contextmanager
def progress_bar(label: str, total: int | None = None) -> Iterator[Callable[..., None]]:
    """Show on a terminal how many steps are done and how long the others will take; elsewhere print
    a line now and then.

    The context gives a function that takes the number of steps done, and their total where it was
    not known.
    """
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn(label), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    is_terminal = err().is_terminal
    activity = _Activity(lambda _: None, silent=is_terminal)
    with Progress(
        *columns, console=err(), transient=True, disable=not is_terminal, redirect_stdout=False
    ) as bar:
        task = bar.add_task(label, total=total)

        def show(done: int, of: int | None = None) -> None:
            bar.update(task, completed=done, total=of)
            activity.now(f"{label}: {done}" + (f" of {of or total}" if of or total else ""))

        try:
            activity.now(label)
            yield show
        finally:
            activity.end()
