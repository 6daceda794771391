"""Where the truth of a log comes from: what kind of source it is, for the program, and what it is
called, for people.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class TruthKind(Enum):
    """What kind of source a log's truth has."""

    UNKNOWN = "unknown"
    """Nobody said."""

    SENSOR = "sensor"
    """The rig's own angle sensors."""

    HOME = "home"
    """Angles at which joints are known to stand while homing; they are read as sensors, see
    `distal.homing`.
    """

    SIMULATION = "simulation"
    """The plant of a simulation that has just run."""

    COLUMN = "column"
    """Another column of the log, such as what a simulation wrote."""

    FILE = "file"
    """A file beside the log."""

    @property
    def by_sensor(self) -> bool:
        """Whether the truth is what sensors of the rig read, with their errors."""
        return self in (TruthKind.SENSOR, TruthKind.HOME)


@dataclass(frozen=True)
class TruthSource:
    """Where a log's truth comes from; its `position` is for people: which column, file or mark."""

    kind: TruthKind = TruthKind.UNKNOWN
    position: str = ""

    def __str__(self) -> str:
        """Return it in words."""
        parts = (self.position, "the reference sensor" if self.kind.by_sensor else "")
        return ", ".join(part for part in parts if part)


NO_SOURCE = TruthSource()
"""Nobody said where the truth comes from, or there is none."""

FROM_SENSOR = TruthSource(TruthKind.SENSOR)
"""The truth is what the rig's own angle sensor reads."""


def truth_source_of(source: TruthSource | str) -> TruthSource:
    """Return where a truth comes from; of a text alone the kind is not known."""
    return TruthSource(position=source) if isinstance(source, str) else source
