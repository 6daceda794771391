"""A finding: one statement of the diagnosis."""

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
"""Kinds of findings. The last five are no contradictions: what the log does not test, and an error
that the band allows.
"""

SILENT: frozenset[Kind] = frozenset(
    {"hardly compared", "not tested", "cannot test", "errs inside", "would explain"}
)
"""Kinds of findings that speak neither against the rig nor for it."""


@dataclass(frozen=True)
class Finding:
    """One statement of the diagnosis: what a log contradicts, or leaves untested.

    Args:
        kind: of the finding.
        subject: sensor, state, drive or parameter that it is about.
        text: the statement in words.
    """

    kind: Kind
    subject: str
    text: str

    @property
    def contradicts(self) -> bool:
        """Whether the finding speaks against the rig, the sensors or the band."""
        return self.kind not in SILENT
