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
    "errs inside",
    "would explain",
]
"""What is found. The last five are no contradiction: what the log does not tell, and an error that
the band allows.
"""

SILENT: frozenset[Kind] = frozenset(
    {"hardly compared", "not tested", "cannot test", "errs inside", "would explain"}
)
"""Kinds that do not speak against the rig; they say that nothing speaks for it either."""


@dataclass(frozen=True)
class Finding:
    """A sentence on what a log contradicts, or leaves untested, about a sensor, a state, or a
    number of the rig.
    """

    kind: Kind
    subject: str
    text: str

    @property
    def contradicts(self) -> bool:
        """Whether it speaks against the rig, the sensors or the band."""
        return self.kind not in SILENT
