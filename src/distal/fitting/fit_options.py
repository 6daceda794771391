"""The options of a fit as one frozen object: all its inputs beside the logs and the rig.

What a fit is doing now, for a progress bar.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from distal.rig import Rig

TYPICAL_ITERATIONS = 8.0
"""Typical number of iterations of a search, for the bar alone. Source: layout."""

BEFORE_SEARCH = 0.05
"""Share of the time that has passed when the search begins. Source: layout."""

AFTER_SEARCH = 0.35
"""Share of the time that has passed when the search ends and candidates are judged. Source: layout.
"""


@dataclass(frozen=True)
class Doing:
    """What a fit is doing now.

    Args:
        stage: the stage in words.
        share: about which share of the fit is done.
        iteration: of the search; 0 outside a search.
    """

    stage: str
    share: float
    iteration: int = 0


Progress = Callable[[Doing], None]
"""A function that is called with what the fit is doing."""


def searching(progress: Progress | None, stage: str) -> Callable[[int, float], None] | None:
    """Return the function that a search calls after each iteration, with the iteration and −ln p;
    None without progress.
    """
    if progress is None:
        return None
    room = AFTER_SEARCH - BEFORE_SEARCH
    return lambda iteration, _: progress(
        Doing(stage, BEFORE_SEARCH + room * iteration / (iteration + TYPICAL_ITERATIONS), iteration)
    )


def judging(progress: Progress | None, stage: str, done: int, count: int) -> None:
    """Report that a candidate is judged next, after `done` of `count` candidates."""
    if progress is not None:
        progress(Doing(stage, AFTER_SEARCH + (1.0 - AFTER_SEARCH) * done / count))


@dataclass(frozen=True, kw_only=True)
class Options:
    """The options of a fit, the arguments of the same names of `fit`; `start` is a rig."""

    free: tuple[str, ...] = ()
    per_log: tuple[str, ...] = ()
    homing: float | None = None
    noise: bool = True
    units: str | None = None
    seed: int = 0
    start: Rig | None = None
    workers: int = 2
    compiled: bool = True
    guessed: bool = False
