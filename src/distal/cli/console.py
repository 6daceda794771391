"""What commands print: plain lines and tables on stdout, warnings and errors on stderr."""

from __future__ import annotations

import logging
import os
import signal
import sys
import warnings
from _thread import interrupt_main
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from threading import Event, Thread, Timer, current_thread, main_thread
from time import monotonic
from typing import TYPE_CHECKING

from rich import box
from rich.console import Console
from rich.table import Table

from distal.errors import LONGEST_LINE, DistalError, one_line, printable

if TYPE_CHECKING:
    from rich.progress import Progress

    from distal.fitting import Doing


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
    """Print an error as one line on stderr."""
    print(f"error: {one_line(text, LONGEST_LINE - len('error: '))}", file=sys.stderr)


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


LONGEST_CELL = 60
"""Length up to which a table's first column stays on one line [characters]. Source: layout."""


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], text: int = 1) -> None:
    """Print a table; nothing in it is cut off.

    A first column that is longer than `LONGEST_CELL` goes on in the next line.

    Args:
        text: how many columns, from the first one, are text; the others are numbers.
    """
    grid = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    for i, name in enumerate(columns):
        cells = [len(row[i]) for row in rows]
        if i == 0:
            grid.add_column(name, no_wrap=max(cells, default=0) <= LONGEST_CELL)
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
reference (limit of an uninterrupted flow of thought; Nielsen, Usability Engineering, 1993).
"""


class _Activity(logging.Handler):
    """What a command is doing: a bar on a terminal; elsewhere a line after `QUIET` seconds, and
    after twice the silence the next.
    """

    def __init__(self, bar: Progress, doing: str) -> None:
        super().__init__()
        self._bar = bar
        self._task = bar.add_task(doing, total=None)
        self._doing = self._text = doing
        self._ended = Event()
        if bar.disable:
            Thread(target=self._print_lines, daemon=True).start()

    def __call__(self, doing: str, done: float | None = None, total: float | None = None) -> None:
        """Say what the command does now, and how much of it is done."""
        self._doing = self._text = doing
        self._bar.update(self._task, description=doing, completed=done, total=total)

    def share(self, done: float) -> None:
        """Say which share of that is done."""
        self._text = f"{self._doing}, {done:.0%}"
        self._bar.update(self._task, description=self._text, completed=done, total=1.0)

    def emit(self, record: logging.LogRecord) -> None:
        detail = record.getMessage()  # what happens to a kernel; empty once it is done
        self._text = f"{self._doing}: {detail}" if detail else self._doing
        self._bar.update(self._task, description=self._text)

    def _print_lines(self) -> None:
        wait = QUIET
        while not self._ended.wait(wait):
            print(f"{self._text} …", file=sys.stderr, flush=True)
            wait *= 2.0

    def end(self) -> None:
        """Print nothing from now on, whatever another thread still tells."""
        self._ended.set()


@contextmanager
def working(doing: str) -> Iterator[_Activity]:
    """Show what a command is doing and for how long, on a terminal; elsewhere print a line after a
    while. The context gives what takes a text on what comes next.
    """
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = err()
    kernels = logging.getLogger("distal.kernels")
    text = TextColumn("{task.description}", markup=False)
    with Progress(
        *(text, BarColumn(), TimeElapsedColumn(), TextColumn("time left"), TimeRemainingColumn()),
        console=console,
        transient=True,
        disable=not console.is_terminal,
        redirect_stdout=sys.stdout is not None and sys.stdout.isatty(),
    ) as bar:
        shown = _Activity(bar, doing)
        kernels.addHandler(shown)
        kernels.setLevel(logging.INFO)
        try:
            yield shown
        finally:
            kernels.removeHandler(shown)
            shown.end()


@contextmanager
def progress_bar(label: str, total: int | None = None) -> Iterator[Callable[..., None]]:
    """Show what is done, see `working`; the context gives a function that takes the number of steps
    done, and their total where it was not known.
    """
    with working(label) as shown:

        def show(done: int, of: int | None = total) -> None:
            shown(f"{label}: {done}" + (f" of {of}" if of else ""), done, of)

        yield show


def time_left(passed: float, share: float) -> str:
    """Return in words how long a task will still take at its present pace.

    Args:
        passed: time that has passed [s].
        share: share of the task that is done.
    """
    seconds = passed * (1.0 - share) / max(share, 0.01)
    return f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.0f} min"


@contextmanager
def fit_progress() -> Iterator[Callable[[Doing], None]]:
    """Show what is done, see `working`; the context gives a function that takes what a fit is
    doing.
    """
    began = monotonic()
    with working("fitting") as shown:

        def show(doing: Doing) -> None:
            left = time_left(monotonic() - began, doing.share)
            text = f"{doing.stage}, about {100 * doing.share:.0f} % done, {left} left"
            shown(text, doing.share, 1.0)

        yield show


@contextmanager
def stoppable(minutes: float | None = None) -> Iterator[None]:
    """Interrupt what is done after some minutes, as Ctrl-C does, and where the job is ended
    (SIGTERM), so that what is found by then is kept.
    """
    if current_thread() is main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    timer = Timer(60.0 * (minutes or 0.0), interrupt_main)
    timer.daemon = True
    if minutes is not None:
        timer.start()
    try:
        yield
    finally:
        timer.cancel()
