"""What came of one hostile input."""

from __future__ import annotations

from dataclasses import dataclass

from distal.errors import DistalError


@dataclass(frozen=True)
class Outcome:
    """What came of one hostile input.

    Args:
        kind: a word: taken, refused, or broken where a promise does not hold.
        why: which promise.
    """

    kind: str
    why: str = ""

    @property
    def kept(self) -> bool:
        """Whether all that is promised held."""
        return self.kind != "broken"


TAKEN, REFUSED = Outcome("taken"), Outcome("refused")


def broken(what: object, why: object) -> Outcome:
    """Return that a promise does not hold.

    Args:
        what: the input.
        why: which promise, or the exception that came.
    """
    return Outcome("broken", f"{what!r:.100}: {why!r:.300}")


def refusal(problem: DistalError) -> Outcome:
    """Return that an input was refused, if its message is one line.

    Args:
        problem: that says so.
    """
    text = str(problem)
    return broken(text, "the message is no line") if "\n" in text or not text.strip() else REFUSED
