"""What several commands share: their options; their inputs and outputs, which are checked before a
command begins (`distal.logs.check_outputs`); and what they print: lines and tables on stdout,
warnings and errors on stderr.
"""

from __future__ import annotations

import os
import re
import signal
import sys
import warnings
from _thread import interrupt_main
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from glob import escape, glob
from pathlib import Path
from threading import Timer, current_thread, main_thread
from typing import Annotated

from rich import box
from rich.console import Console
from rich.table import Table
from typer import Argument, Option

from distal.errors import (
    LONGEST_LINE,
    DistalError,
    EstimationError,
    OutputError,
    UnitError,
    one_line,
    printable,
)


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
    warnings.showwarning = lambda message, *_, **__: warn(str(message))


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


ESTIMATOR_NAMES = ("adaptive", "ekf", "ekf-2008", "elastic", "inextensible", "regression")
"""Names of all estimators, the keys of `distal.ESTIMATORS`; they stand here, too, so that a shell
completes them without importing the estimators.
"""


def estimators(incomplete: str) -> list[str]:
    """Return the names of estimators that begin with an incomplete word, for a shell's
    completion.
    """
    return [name for name in ESTIMATOR_NAMES if name.startswith(incomplete)]


def _completing(package: str) -> Callable[[str], list[str]]:
    """Return a function that completes a word to the names of a package's shipped files and to TOML
    files, without importing the package.
    """
    folder = Path(__file__).parents[1] / package / "library"

    def complete(incomplete: str) -> list[str]:
        pattern = f"{escape(incomplete)}*.toml"
        return sorted(path.stem for path in folder.glob(pattern)) + sorted(glob(pattern))

    return complete


rigs = _completing("rig")
"""Completion of rigs."""

scenarios = _completing("simulation")
"""Completion of scenarios."""

studies = _completing("study")
"""Completion of studies."""

RIG = "A shipped rig's name (see `distal rigs`) or a TOML file."
RigOption = Annotated[str, Option(help=RIG, autocompletion=rigs)]
RigArgument = Annotated[str, Argument(help=RIG, autocompletion=rigs)]
SCENARIO = "A shipped scenario's name (see `distal scenarios`) or a TOML file."
ScenarioArgument = Annotated[str, Argument(help=SCENARIO, autocompletion=scenarios)]
SetOption = Annotated[
    list[str],
    Option(
        "--set",
        default_factory=list,
        show_default=False,
        metavar="PATH=VALUE",
        help=(
            "Replace a value of the rig by names of its parts, e.g. "
            "joints.link.friction.coefficient=0.3 or "
            "'tendons.left.stiffness=\"2 N/mm\"'; repeatable."
        ),
    ),
]
SeedOption = Annotated[int, Option(min=0, help="Seed of the sensors' errors.")]


EstimatorOption = Annotated[
    str | None,
    Option("--estimator", "-e", help=f"{', '.join(ESTIMATOR_NAMES)}.", autocompletion=estimators),
]


def _angle_unit(unit: str | None) -> str | None:
    """Raise where a unit is not one of angles; the packages of results are not imported for
    this.
    """
    if unit not in (None, "rad", "deg"):
        raise EstimationError(f"--unit {unit}: angles are written in rad or deg")
    return unit


UnitOption = Annotated[
    str | None,
    Option(
        callback=_angle_unit,
        help="Of the angles that are written: rad or deg. Default: as the log has them.",
    ),
]


def in_si(text: str, unit: str) -> float:
    """Return a quantity in SI, from a text such as ``500 mN``; a number without a unit is in SI
    already.

    Raises:
        UnitError: the text is no such quantity.
    """
    from distal.units import to_si

    try:
        return to_si(float(text), unit)
    except ValueError:
        return to_si(text, unit)


def joint_angle(text: str) -> tuple[str | None, float, float]:
    """Return the name of a joint, or None, its angle and the standard deviation [rad], from a text.

    The text is ``pip: -40 deg``, ``0 deg ± 1 deg`` or ``0 deg +- 1 deg``; without a standard
    deviation it is 0.

    Raises:
        UnitError: the text has no angle.
    """
    name, colon, text = text.rpartition(":")
    parts = [part.strip() for part in re.split(r"±|\+-|\+/-", text)]
    if len(parts) > 2 or not all(parts):
        raise UnitError(f"an angle is written as '0 deg' or '0 deg ± 1 deg', {text!r} came")
    mean, *stds = (in_si(part, "rad") for part in parts)
    return name.strip() if colon else None, mean, stds[0] if stds else 0.0


def homing_time(text: str | None) -> float | None:
    """Return a time from a text such as ``3s``, ``200 ms`` or a bare number [s]; None stays None.

    Raises:
        UnitError: the text is no time, or one that is not above 0.
    """
    if text is None:
        return None
    time = in_si(text, "s")
    if not time > 0.0:
        raise UnitError(f"--homing is a time above 0 s, {text} came")
    return time


LagOption = Annotated[
    str | None,
    Option(
        help="By how much the true angles are later than the drives, e.g. '40 ms', or 0; default: "
        "found in the logs.",
    ),
]


BAG = (".db3", ".mcap", ".bag", ".zstd", ".yaml")
"""Endings of the files of a ROS bag."""


def check_command_outputs(
    outputs: Iterable[Path | None],
    kind: str = "",
    *,
    logs: Iterable[Path | None] = (),
    rig: str | None = None,
    scenario: str | None = None,
    truth: str | None = None,
    makes_folder: bool = False,
) -> None:
    """Raise where an output would replace an input or another output, or cannot be written.

    Args:
        outputs: paths of what will be written; None is an option that was not given.
        kind: what they are, see `ENDINGS`.
        logs: paths of the logs that are read.
        rig: name of a shipped rig, or a path.
        scenario: name of a shipped scenario, or a path.
        truth: name of a column, or a path.
        makes_folder: whether the folder of the outputs is made where it does not exist.

    Raises:
        OutputError: see `distal.logs.check_outputs` and `distal.logs.check_format`; or a path does
            not end as its kind of output does.
    """
    from distal import logs as files
    from distal.rig import description_path

    inputs = [file for log in logs if log is not None for file in _files_of(log)]
    if rig is not None:
        inputs.append(description_path(rig, "distal.rig"))
    if scenario is not None:
        inputs.append(description_path(scenario, "distal.simulation"))
    if truth is not None and (os.path.exists(truth) or Path(truth).suffix.lower() in files.TABLES):
        inputs.append(Path(truth))
    paths = [path for path in outputs if path is not None]
    files.check_outputs(paths, inputs, makes_folder=makes_folder)
    for path in paths:
        files.check_format(path)
        check_ending(path, kind)


def check_ending(path: Path | None, kind: str) -> None:
    """Raise an `OutputError` where a path does not end as its kind of output does."""
    endings = ENDINGS.get(kind)
    if path is not None and endings is not None and path.suffix.lower() not in endings:
        raise OutputError(f"{path}: {kind} ends in {' or '.join(filter(None, endings))}")


def _files_of(log: Path) -> Iterator[Path]:
    """Yield the files from which a log is read; a ROS bag has several in its folder."""
    yield log
    folder = log.parent if log.suffix.lower() == ".db3" else log
    if folder.is_dir():
        yield from (file for file in sorted(folder.iterdir()) if file.suffix.lower() in BAG)


ENDINGS = {
    "a rig file": (".toml",),
    "a table": (".csv", ".txt", ".parquet", ".pq", ""),
}
"""Kind of output → endings of its path; a table may go to a pipe, whose path has none."""


def check_new(path: Path) -> None:
    """Raise an `OutputError` where a file exists already, since a user may have edited it."""
    if path.exists():
        raise OutputError(f"{path}: exists already; give another name or remove it")


def check_folder(out: Path, when: str) -> None:
    """Raise an `OutputError` where a folder is a file, or named like one."""
    from distal.logs import TABLES

    if os.path.isfile(out) or out.suffix.lower() in TABLES:
        raise OutputError(f"{out}: is a file, or named like one; {when}, --out is a folder")
