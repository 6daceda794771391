"""Logs in groups: of one unit, one class of motion, one day."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from distal.errors import FitError


def groups_of(names: Sequence[str], pattern: str | None, least: int = 2) -> list[str]:
    """Return the group of each log: its own name, or what a regular expression finds in it.

    Args:
        names: of the logs.
        pattern: regular expression whose first parenthesis names the group, e.g. ``run_(.)``; None for one log each.
        least: so many groups there must be.

    Raises:
        FitError: it is no such expression, does not match a name, or leaves fewer groups.
    """
    if pattern is None:
        groups = list(names)
    else:
        try:
            expression = re.compile(pattern)
        except re.error as problem:
            raise FitError(f"'{pattern}': not a regular expression ({problem})") from None
        if expression.groups < 1:
            raise FitError(f"'{pattern}': needs a parenthesis around what names a group, e.g. 'run_(.)'")
        groups = []
        for name in names:
            found = expression.search(Path(name).name)
            if found is None:
                raise FitError(f"'{pattern}': does not match '{Path(name).name}'")
            groups.append(str(found.group(1)))
    if len(set(groups)) < least:
        raise FitError(f"logs of at least {least} groups are needed; {len(names)} logs came, of {len(set(groups))}")
    return groups


MOST_FOLDS = 6
"""Logs are left out in so many groups at most."""


def folds_of(names: Sequence[str]) -> list[int]:
    """Return the fold of each log: logs of one group are in one fold, and there are `MOST_FOLDS` at most.

    Args:
        names: group of each log.
    """
    every = list(dict.fromkeys(names))
    return [every.index(name) % MOST_FOLDS for name in names]
