"""What a fit is doing, for a progress bar."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

TYPICAL_ITERATIONS = 40.0
"""A part of a fit takes about so many iterations: only a bar goes by it."""


@dataclass(frozen=True)
class Doing:
    """What a fit is doing now.

    Args:
        stage: of the search.
        iteration: in it.
        cost: −ln p.
        part: 0 for the fit to all logs, then a fold after the other.
        parts: how many there are.
        done: iterations of this part so far.
    """

    stage: str
    iteration: int
    cost: float
    part: int = 0
    parts: int = 1
    done: int = 0

    @property
    def share(self) -> float:
        """Share of the whole fit that is done, about."""
        return (self.part + self.done / (self.done + TYPICAL_ITERATIONS)) / self.parts


Progress = Callable[[Doing], None]


def staged(progress: Progress | None, stage: str) -> Callable[[int, float], None] | None:
    """Return what a search calls after each iteration.

    Args:
        progress: called with what is done; None for nothing.
        stage: its name.
    """
    return None if progress is None else lambda iteration, cost: progress(Doing(stage, iteration, cost))


def of_part(progress: Progress | None, part: int, parts: int) -> Progress | None:
    """Return the progress of one part of a fit.

    Args:
        progress: of the whole fit; None for nothing.
        part: 0 for the fit to all logs, then a fold after the other.
        parts: how many there are.
    """
    if progress is None:
        return None
    done = 0

    def say(doing: Doing) -> None:
        nonlocal done
        done += 1
        progress(replace(doing, part=part, parts=parts, done=done))

    return say
