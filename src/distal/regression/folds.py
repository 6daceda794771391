"""Folds: which logs are held out together."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from distal.errors import FitError

FEWEST_LOGS = 3
"""With fewer logs nobody knows which of them is odd. Source: definition."""

MOST_FOLDS = 6
"""Largest number of folds: for each of them everything is learned anew. Source: judgement."""


def folds_of(groups: Sequence[str]) -> list[int]:
    """Return the fold of each log, numbered from 0: logs of one group are in one fold.

    There are at most `MOST_FOLDS`; with more groups several share a fold.
    """
    every = list(dict.fromkeys(groups))
    return [every.index(name) % MOST_FOLDS for name in groups]


def splits(folds: Sequence[int]) -> Iterator[tuple[list[int], list[int]]]:
    """Yield, for each fold, the indices of the logs that it holds out and of all other logs."""
    for fold in sorted(set(folds)):
        out = [i for i, fold_of_log in enumerate(folds) if fold_of_log == fold]
        yield out, [i for i, fold_of_log in enumerate(folds) if fold_of_log != fold]


def groups_of(names: Sequence[str], pattern: str | None, least: int = 2) -> list[str]:
    """Return the group of each log: its own name, or what a regular expression finds in its file
    name.

    The first parenthesis of the `pattern` finds the group, e.g. ``run_(.)``. Without a pattern,
    None, each log is a group of its own.

    Raises:
        FitError: the pattern is no regular expression, has no parenthesis or does not match a name,
            or there are fewer groups than `least`.
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
