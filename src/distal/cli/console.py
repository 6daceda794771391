"""What commands print: plain lines and tables on stdout, warnings and errors on stderr."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table


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
    out().print(text, markup=False)


def show_warnings() -> None:
    """Print each warning as one line on stderr, not with the place in the code."""

    def show(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        print(f"warning: {message}", file=sys.stderr)

    warnings.showwarning = show


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], text: int = 1) -> None:
    """Print a table; the first `text` columns are text, the others numbers. The first one is never cut."""
    made = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    for i, name in enumerate(columns):
        made.add_column(name, justify="left" if i < text else "right", no_wrap=i == 0)
    for row in rows:
        made.add_row(*row)
    out().print(made)
