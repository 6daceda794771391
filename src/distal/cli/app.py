"""The command line: its commands, and errors as one line instead of a traceback."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import typer
from typer import Option

from distal.cli import (
    doctor_command,
    estimate_command,
    fit_command,
    rig_commands,
    simulation_commands,
)
from distal.cli.shared_options import TRACEBACK, failure, fault, show_warnings
from distal.errors import DistalError

# typer raises errors of the click that it uses, which is its own copy or the package; in both cases
# ClickException is a base of BadParameter
_ClickError: Any = next(
    kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException"
)

app = typer.Typer(
    name="distal",
    help="Where a tendon-driven joint is, without a sensor in the joint.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
COMMANDS: dict[str, Callable[..., None]] = {
    "estimate": estimate_command.estimate_command,
    "learn": fit_command.learn_command,
    "fit": fit_command.fit_command,
    "calibrate": fit_command.calibrate_command,
    "simulate": simulation_commands.simulate_command,
    "command": simulation_commands.command_command,
    "control": simulation_commands.control_command,
    "study": simulation_commands.study_command,
    "studies": simulation_commands.list_studies_command,
    "reproduce": simulation_commands.reproduce_command,
    "stream": estimate_command.stream_command,
    "export-c": rig_commands.export_command,
    "export-fmu": rig_commands.fmu_command,
    "rigs": rig_commands.list_rigs_command,
    "scenarios": simulation_commands.list_scenarios_command,
    "doctor": doctor_command.doctor_command,
}
"""Name → function of the commands that are in no group, in the order of the help."""

for _name, _command in COMMANDS.items():
    app.command(_name)(_command)
app.add_typer(rig_commands.app, name="rig")
app.add_typer(simulation_commands.app, name="scenario")


def _version(desired: bool) -> None:
    if desired:
        from distal.version import __version__

        print(f"distal {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: bool = Option(
        False, "--version", callback=_version, is_eager=True, help="Print the version."
    ),
) -> None:
    pass


def main() -> None:
    """Run the command line.

    Any error is printed as one line on stderr, and the exit code says what kind of error it was;
    see `ended_by`.
    """
    show_warnings()
    if sys.stderr is None:  # it is closed: messages must not go to standard output instead
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    for output in (sys.stdout, sys.stderr):
        if isinstance(output, io.TextIOWrapper):
            output.reconfigure(errors="replace")
    try:
        code = app(standalone_mode=False)
        if sys.stdout is not None:
            sys.stdout.flush()
        if code == STOPPED:  # typer turns a KeyboardInterrupt into this code
            raise KeyboardInterrupt
    except BaseException as problem:
        code = ended_by(problem)
    sys.exit(code if isinstance(code, int) else 0)


WRONG = 2
"""Exit code of an error that the user can mend. Source: definition (exit code of wrong usage in
Unix shells).
"""

BUG = 70
"""Exit code of a fault of distal. Source: definition (EX_SOFTWARE of sysexits.h)."""

STOPPED = 130
"""Exit code where the user stopped the command. Source: definition (128 + number of SIGINT)."""

NO_READER = 141
"""Exit code where the reader of a pipe went away. Source: definition (128 + number of SIGPIPE)."""


def ended_by(problem: BaseException) -> object:
    """Print one line on stderr that says what ended a command, and return the exit code."""
    exit_code = problem.code if isinstance(problem, SystemExit) else None
    # typer ends with 1 only where the reader of a pipe went away
    if isinstance(problem, BrokenPipeError) or exit_code == 1:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return NO_READER
    if isinstance(problem, (typer.Abort, KeyboardInterrupt)) or exit_code == STOPPED:
        with suppress(OSError):
            print("stopped", file=sys.stderr)
        return STOPPED
    if isinstance(problem, SystemExit):
        return exit_code
    if type(problem).__name__ == "NoArgsIsHelpError":
        problem.show()  # type: ignore[attr-defined]
        return WRONG
    code = WRONG
    if isinstance(problem, DistalError):
        text = str(problem)
    elif isinstance(problem, _ClickError):
        text = problem.format_message()
    elif isinstance(problem, OSError):
        text = f"{problem.filename or 'output'}: {problem.strerror or problem}"
        # what is left in a buffer cannot be written either
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    elif isinstance(problem, MemoryError):
        text = "there is not enough memory; estimate fewer or shorter logs at once"
    elif os.environ.get(TRACEBACK):
        raise problem
    else:
        text = fault(problem)
        code = BUG
    with suppress(OSError):  # where nothing can be printed, only the exit code tells of the error
        failure(text)
    return code
