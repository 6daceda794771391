"""The command line: commands, and one line instead of a traceback."""

from __future__ import annotations

import io
import os
import sys
from typing import Any

import typer

from distal.cli import doctor, estimate, export, fit, reproduce, rigs, simulate, stream
from distal.cli.console import show_warnings
from distal.errors import DistalError

# typer raises the errors of the click that it uses, its own or the package; BadParameter leads to both
_ClickError: Any = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")

app = typer.Typer(
    name="distal",
    help="Where a tendon-driven joint is, without a sensor in the joint.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("estimate")(estimate.estimate_command)
app.command("fit")(fit.fit_command)
app.command("simulate")(simulate.simulate_command)
app.command("stream")(stream.stream_command)
app.command("export-c")(export.export_command)
app.command("reproduce")(reproduce.reproduce_command)
app.command("rigs")(rigs.list_command)
app.add_typer(rigs.app, name="rig")
app.command("scenarios")(simulate.list_command)
app.add_typer(simulate.app, name="scenario")
app.command("doctor")(doctor.doctor_command)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"distal {version('distal')}")
        raise typer.Exit


@app.callback()
def _options(
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Print the version."),
) -> None:
    pass


def main() -> None:
    """Run the command line; what a user can cause is one line on stderr and exit code 2."""
    show_warnings()
    for output in (sys.stdout, sys.stderr):
        if isinstance(output, io.TextIOWrapper):
            output.reconfigure(errors="replace")
    try:
        code = app(standalone_mode=False)
        if sys.stdout is not None:
            sys.stdout.flush()
    except DistalError as problem:
        print(f"error: {' '.join(str(problem).split())}", file=sys.stderr)
        code = 2
    except _ClickError as problem:
        if type(problem).__name__ == "NoArgsIsHelpError":
            problem.show()
        else:
            print(f"error: {' '.join(problem.format_message().split())}", file=sys.stderr)
        code = 2
    except (typer.Abort, KeyboardInterrupt):
        print("stopped", file=sys.stderr)
        code = 130
    except BrokenPipeError:
        # the reader of a pipe went away; nothing more can be said
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 141
    except OSError as problem:
        print(f"error: {problem.filename or 'output'}: {problem.strerror or problem}"[:300], file=sys.stderr)
        code = 2
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.exit(code if isinstance(code, int) else 0)
