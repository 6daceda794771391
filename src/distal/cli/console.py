"""What commands print: plain lines and tables on stdout, warnings and errors on stderr."""

from __future__ import annotations

import os
import signal
import sys
import warnings
from _thread import interrupt_main
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from threading import Timer, current_thread, main_thread

from rich import box
from rich.console import Console
from rich.table import Table

from distal.errors import LONGEST_LINE, DistalError, one_line, printable


def out() -> Console:
    """Return the console on which results are printed."""
    # a file or a pipe has no edge: numbers are not cut there
    width = None if sys.stdout is not None and sys.stdout.isatty() else WIDTH
    return Console(highlight=False, soft_wrap=True, width=width)


WIDTH = 120
"""Width of the output where it is no terminal [characters]. Source: layout."""


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
        longest = max((len(row[i]) for row in rows), default=0)
        if i < text:
            grid.add_column(name, no_wrap=i == 0 and longest <= LONGEST_CELL)
        else:
            grid.add_column(name, justify="right", min_width=longest)
    for row in rows:
        grid.add_row(*row)
    out().print(grid)


@contextmanager
def working(doing: str) -> Iterator[Callable[[str], None]]:
    """Show on a terminal what a command is doing. The context gives what takes a text on what comes
    next.
    """
    from rich.live import Live
    from rich.spinner import Spinner
    from rich.text import Text

    shown = Spinner("dots", Text(doing))
    is_terminal = sys.stdout is not None and sys.stdout.isatty()
    # what is printed meanwhile goes where it goes without the spinner
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    with Live(shown, console=console, transient=True, redirect_stdout=is_terminal):
        yield lambda text: shown.update(text=Text(text))


@contextmanager
def progress_bar(label: str, total: int | None = None) -> Iterator[Callable[..., None]]:
    """Show what is done, see `working`; the context gives a function that takes the number of steps
    done, and their total where it was not known.
    """
    with working(label) as show:

        def count(done: int, of: int | None = total) -> None:
            show(f"{label}: {done}" + (f" of {of}" if of else ""))

        yield count


@contextmanager
def stoppable(minutes: float | None = None) -> Iterator[None]:
    """Interrupt what is done after some minutes, as Ctrl-C does, and where the job is ended
    (SIGTERM), so that what is found by then is kept.
    """
    before = None
    if current_thread() is main_thread():
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    timer = Timer(60.0 * (minutes or 0.0), interrupt_main)
    timer.daemon = True
    if minutes is not None:
        timer.start()
    try:
        yield
    finally:
        timer.cancel()
        if before is not None:
            signal.signal(signal.SIGTERM, before)
