"""The command line: one file for each group of commands, thin over Python functions.

In: arguments and files; out: files, and lines for people; an error is one line and an exit code.

    from distal.cli import app

    print(sorted(command.name for command in app.registered_commands if command.name)[:3])
"""

from distal.cli.app import app, main

__all__ = ["app", "main"]
