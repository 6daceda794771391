"""What a fit is doing, for a progress bar."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

TYPICAL_ITERATIONS = 8.0
"""A search takes about so many iterations: only a bar goes by it."""

BEFORE_SEARCH = 0.05
AFTER_SEARCH = 0.35
"""Shares of the time that what comes before a search takes, and what has passed after it;
candidates take the rest.
"""


@dataclass(frozen=True)
class Doing:
    """What a fit is doing now: a search in its `iteration`, else 0, of which a share of this part
    is done, about.

    Part 0 is the fit to all logs, then comes a fold after the other.
    """

    stage: str
    within: float
    iteration: int = 0
    part: int = 0
    parts: int = 1

    @property
    def share(self) -> float:
        """Share of the whole fit that is done, about."""
        return (self.part + self.within) / self.parts


Progress = Callable[[Doing], None]


def searching(progress: Progress | None, stage: str) -> Callable[[int, float], None] | None:
    """Return what a search calls after each iteration; None where nobody asks for progress."""
    if progress is None:
        return None
    room = AFTER_SEARCH - BEFORE_SEARCH
    return lambda iteration, _: progress(
        Doing(stage, BEFORE_SEARCH + room * iteration / (iteration + TYPICAL_ITERATIONS), iteration)
    )


def judging(progress: Progress | None, stage: str, done: int, count: int) -> None:
    """Say that a candidate is judged next, after those that are done."""
    if progress is not None:
        progress(Doing(stage, AFTER_SEARCH + (1.0 - AFTER_SEARCH) * done / count))


def of_part(progress: Progress | None, part: int, parts: int) -> Progress | None:
    """Return the progress of one part of a fit: 0 for the fit to all logs, then a fold after the
    other.
    """
    return (
        None if progress is None else lambda doing: progress(replace(doing, part=part, parts=parts))
    )
