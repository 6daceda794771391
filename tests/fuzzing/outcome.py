"""Hostile values, and what came of one hostile input."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass

from distal.errors import DistalError

BYTES = (
    b"\x00",
    b"\xff",
    b"\n",
    b"\r",
    b'"',
    b",",
    b"\n\n",
    b"\x80" * 8,
    b"\x00" * 64,
    b"\xef\xbb\xbf",
)


ODD_CELLS = (
    *("", "nan", "1e400", "-1e308", '"', '"1"', "1,5", "0x10", "1_000", "١٢", "²", "\x00"),
    "\x1b[2J",
)
"""Cells of a table that are no number, or an odd one."""

JSON = (
    *(None, True, False, "", "x", "1", "nan", "²", [], [1], [[1], [1, 2]], {}, {"a": 1}),
    *(1e308, -1e308, 2**63, 10**30, "1" * 5000),
)
"""Values of JSON that are no number, or an odd one."""


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


def damaged(rng: random.Random, data: bytes, marks: Sequence[bytes] = BYTES) -> bytes:
    """Return bytes of which some are changed, lost, doubled or moved, or marks."""
    for _ in range(rng.choice([1, 1, 1, 2, 5])):
        at = rng.randrange(len(data) + 1)
        if rng.random() < 0.4:
            at = max(
                len(data) - rng.randrange(min(len(data), 400) + 1), 0
            )  # footers are where it hurts
        size = rng.choice([0, 1, 1, 1, 4, 60])
        what = rng.randrange(6)
        if what <= 2 and at < len(data):
            data = data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]
        elif what == 3:
            data = data[:at] + rng.choice(marks) + data[at + size :]
        elif what == 4:
            data = data[:at] if rng.random() < 0.3 else data[:at] + data[at + size :]
        else:
            data = data[:at] + data[at : at + size] * 2 + data[at + size :]
    return data
