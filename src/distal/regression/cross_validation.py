"""Cross-validation: which logs are left out together. Nothing else in the package leaves a log
out.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from distal.errors import FitError

MOST_FOLDS = 6
"""Logs are left out in so many folds at most: each costs what is learned from the others."""


def folds_of(groups: Sequence[str]) -> list[int]:
    """Return the fold of each log: logs of one group are in one fold, and there are `MOST_FOLDS` at
    most.
    """
    every = list(dict.fromkeys(groups))
    return [every.index(name) % MOST_FOLDS for name in groups]


def splits(folds: Sequence[int]) -> Iterator[tuple[list[int], list[int]]]:
    """Yield for each fold which logs are left out and which are left, by their indices."""
    for fold in sorted(set(folds)):
        out = [i for i, fold_of_log in enumerate(folds) if fold_of_log == fold]
        yield out, [i for i, fold_of_log in enumerate(folds) if fold_of_log != fold]


def groups_of(names: Sequence[str], pattern: str | None, least: int = 2) -> list[str]:
    """Return the group of each log: its own name, or what a regular expression finds in it.

    The first parenthesis of the pattern names the group, e.g. ``run_(.)``; None is one log each.

    Raises:
        FitError: it is no such expression, does not match a name, or leaves less than the least
            number of groups.
    """
    groups = list(names)
    if pattern is not None:
        try:
            expression = re.compile(pattern)
        except re.error as problem:
            raise FitError(f"'{pattern}': not a regular expression ({problem})") from None
        if expression.groups < 1:
            raise FitError(
                f"'{pattern}': needs a parenthesis around what names a group, e.g. 'run_(.)'"
            )
        groups = []
        for name in names:
            match = expression.search(Path(name).name)
            if match is None:
                raise FitError(f"'{pattern}': does not match '{Path(name).name}'")
            groups.append(str(match[1]))
    if len(set(groups)) < least:
        raise FitError(
            f"logs of at least {least} groups are needed; {len(names)} logs came, of "
            f"{len(set(groups))}"
        )
    return groups
