"""One thing that a diagnosis has to say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "against the truth",
    "disagrees",
    "too large",
    "drifts",
    "friction",
    "left its prior",
    "overconfident",
    "other estimate",
    "cannot be there",
    "looks like",
    "out of range",
    "hardly compared",
    "not tested",
    "cannot test",
]
"""What is found. The last three are no contradiction: they say what the log does not tell."""

SILENT: frozenset[Kind] = frozenset({"hardly compared", "not tested", "cannot test"})
"""Kinds that do not speak against the rig; they say that nothing speaks for it either."""


@dataclass(frozen=True)
class Finding:
    """A sentence on what a log contradicts, or leaves untested, about a sensor, a state, or a number of the rig."""

    kind: Kind
    subject: str
    text: str

    @property
    def contradicts(self) -> bool:
        """Whether it speaks against the rig, the sensors or the band."""
        return self.kind not in SILENT
