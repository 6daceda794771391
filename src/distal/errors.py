"""Errors and warnings: each says what came, what is allowed, and what to do; and what a user may
have meant by a name that is not known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from difflib import get_close_matches
from typing import BinaryIO, TypeAlias

Content: TypeAlias = bytes | str | Callable[[BinaryIO], object]
"""The content of a file, or a function that writes it."""


class DistalError(ValueError):
    """Base of every error that a user can cause and mend; its message is one line that a terminal
    shows as it is.
    """

    def __init__(self, message: object = "") -> None:
        super().__init__(printable(str(message)))


class UnitError(DistalError):
    """A number with a unit could not be understood, or has the wrong dimension."""


class RigError(DistalError):
    """A rig description is wrong or asks for what is not supported."""


class ScenarioError(DistalError):
    """A scenario is wrong or does not fit its rig."""


class ControlError(DistalError):
    """A controller, or what it asks of a plant, is wrong."""


class CommandError(DistalError):
    """Desired angles are wrong, or no commands can be computed for a rig."""


class LogError(DistalError):
    """A log cannot be read, or its content cannot be used."""


class EstimationError(DistalError):
    """An estimator cannot run on this rig or this sample."""


class DivergedError(EstimationError):
    """An estimate left all bounds: the rig, its units or its signs do not fit the log."""


class FitError(DistalError):
    """A rig cannot be fitted to these logs."""


class StudyError(DistalError):
    """A study is wrong, or cannot go on where it is."""


class ExportError(DistalError):
    """An estimator cannot be written as C."""


class OutputError(DistalError):
    """A file could not be written; whatever stood there before is unchanged."""


class DistalWarning(UserWarning):
    """Something is suspicious but was done as asked."""


class KernelWarning(DistalWarning):
    """Kernels are not compiled; the message says why."""


LONGEST_LINE = 400
"""Largest length of a message on one line [characters]; a longer one is cut in the middle. Source:
layout.
"""


def one_line(text: str, longest: int = LONGEST_LINE) -> str:
    """Return a message as one line of at most `longest` characters, with control characters written
    out.
    """
    plain = " ".join(printable(text).split())
    if len(plain) <= longest:
        return plain
    # its end often says what to do
    return f"{plain[: longest - 121].rstrip()} … {plain[-118:].lstrip()}"


def printable(text: str) -> str:
    """Return a text without control characters: white space becomes a space, others are written
    out.
    """
    return "".join(c if c.isprintable() else " " if c in "\n\t\r" else repr(c)[1:-1] for c in text)


def did_you_mean(word: str, allowed: Iterable[str]) -> str:
    """Return a hint that names the nearest allowed word and lists all, e.g. ``; did you mean
    'mass'? (known: …)``.
    """
    names = sorted(name if len(name) <= 40 else name[:39] + "…" for name in allowed)
    near = get_close_matches(word, names, n=1, cutoff=0.5)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    more = f" and {len(names) - 20} more" if len(names) > 20 else ""
    return f"{hint} (known: {', '.join(names[:20])}{more})" if names else hint
